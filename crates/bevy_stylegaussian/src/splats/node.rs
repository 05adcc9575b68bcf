//! The splat pass of a view: projected, sorted, drawn into its layer, and the layer over the picture.

use bevy::{
    prelude::*,
    render::{
        renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery},
        view::{ExtractedView, ViewDepthTexture, ViewTarget},
    },
};
use stylegaussian_gpu::splat;
use wgpu::{LoadOp, Operations, RenderPassColorAttachment, RenderPassDescriptor, StoreOp};

use crate::style::{CloudLooks, GpuReport, GpuReports, LookClock};

use super::{
    extract::RenderClouds,
    pipelines::{Ready, SplatPipelines},
    prepare::GpuScenes,
    view::{SplatViews, ViewSplats},
};

/// Draws a view's splats into its layer, and unless it is meant for later, the layer over the picture.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn draw_splats(
    view: ViewQuery<(&ExtractedView, &ViewTarget, &ViewDepthTexture)>,
    mut views: ResMut<SplatViews>,
    pipelines: Res<SplatPipelines>,
    clouds: Res<RenderClouds>,
    scenes: Res<GpuScenes>,
    looks: Res<CloudLooks>,
    clock: Res<LookClock>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    reports: Res<GpuReports>,
    mut context: RenderContext,
) {
    let (extracted, target, depth) = view.into_inner();
    let Some(splats) = views.get_mut(&extracted.retained_view_entity) else { return };
    let Some(plan) = splats.plan else { return };
    let Some(ready) = pipelines.get(plan.samples, plan.composite) else { return };
    let camera = splat::Camera {
        world_from_view: extracted.world_from_view.affine(),
        clip_from_view: extracted.clip_from_view,
        viewport: plan.viewport,
    };
    let drawn: Vec<splat::Cloud> = splats
        .clouds
        .iter()
        .filter_map(|entity| {
            let cloud = clouds.0.get(entity)?;
            let (scene, colors) = (scenes.get(&cloud.scene)?, looks.colors(*entity, clock.0));
            Some(splat::Cloud { scene, colors, world_from_scene: cloud.world_from_scene })
        })
        .collect();
    let prepared = ready.passes.splat.prepare(
        device.wgpu_device(),
        &queue,
        context.command_encoder(),
        &mut splats.buffers,
        &camera,
        &drawn,
        &plan.settings,
    );
    if let Err(error) = prepared {
        refuse(splats, &reports, &error.to_string());
        return;
    }
    splats.refused = false;
    let (device, encoder) = (device.wgpu_device(), context.command_encoder());
    draw_layer(device, &queue, encoder, &ready, splats, depth);
    if !plan.after_tonemapping {
        let attachment = target.get_color_attachment();
        composite(encoder, &ready, splats, attachment);
    }
}

/// Tells once why the view shows no splats.
fn refuse(splats: &mut ViewSplats, reports: &GpuReports, reason: &str) {
    splats.plan = None;
    if std::mem::replace(&mut splats.refused, true) {
        return;
    }
    for entity in &splats.clouds {
        reports.push(GpuReport::SceneRefused { entity: entity.id(), reason: reason.into() });
    }
}

/// Blends splats in the view's layer.
fn draw_layer(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    encoder: &mut wgpu::CommandEncoder,
    ready: &Ready,
    splats: &mut ViewSplats,
    depth: &ViewDepthTexture,
) {
    let Some((layer, buffers)) = splats.layer_and_buffers() else { return };
    let layer =
        splat::Layer { color: &layer.color, resolved: layer.resolved.as_ref(), depth: Some(depth.view()) };
    ready.passes.splat.draw_layer(device, queue, encoder, buffers, &layer, ready.draw);
}

/// Puts the view's layer over a picture.
fn composite(
    encoder: &mut wgpu::CommandEncoder,
    ready: &Ready,
    splats: &ViewSplats,
    picture: RenderPassColorAttachment,
) {
    let (Some((_, input)), Some(plan)) = (splats.layer(), splats.plan) else { return };
    let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
        label: Some("splat_composite"),
        color_attachments: &[Some(picture)],
        ..default()
    });
    ready.passes.composite.draw(&mut pass, ready.composite, input, plan.viewport);
}

/// Puts the layer of a view that bypasses tonemapping over the picture, after it.
///
/// Takes the target for itself: effects that follow tonemapping swap its textures, which must not happen meanwhile.
pub(super) fn composite_after_tonemapping(
    view: ViewQuery<(&ExtractedView, &mut ViewTarget)>,
    views: Res<SplatViews>,
    pipelines: Res<SplatPipelines>,
    mut context: RenderContext,
) {
    let (extracted, target) = view.into_inner();
    let Some(splats) = views.get(&extracted.retained_view_entity) else { return };
    let Some(plan) = splats.plan.filter(|plan| plan.after_tonemapping) else { return };
    let Some(ready) = pipelines.get(plan.samples, plan.composite) else { return };
    let picture = RenderPassColorAttachment {
        view: target.main_texture_view(),
        depth_slice: None,
        resolve_target: None,
        ops: Operations { load: LoadOp::Load, store: StoreOp::Store },
    };
    composite(context.command_encoder(), &ready, splats, picture);
}
