//! The splat pass of a view: projects and sorts the splats, draws them into the view's layer, and composites
//! the layer.

use bevy::{
    prelude::*,
    render::{
        renderer::{RenderContext, ViewQuery},
        view::{ExtractedView, ViewDepthTexture, ViewTarget},
    },
};
use stylegaussian_gpu::splat;
use wgpu::{LoadOp, Operations, RenderPassColorAttachment, RenderPassDescriptor, StoreOp};

use crate::{
    colors::{ShownColors, StrokeClock},
    commands::GpuCommands,
    mask::RenderMasks,
    reports::Reports,
    scene::{GaussianSceneError, GpuScenes, RenderClouds, SceneRefused},
};

use super::{
    air::Atmospheres,
    eyes::Pair,
    fade::CloudFades,
    light::Lights,
    pipelines::{Ready, SplatPipelines},
    view::{SplatViews, ViewSplats, Whole},
};

/// Projects and sorts a view's splats, and with them those of the other eye, if there is one.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn sort_splats(
    view: ViewQuery<&ExtractedView, (With<ViewTarget>, With<ViewDepthTexture>)>,
    mut views: ResMut<SplatViews>,
    pipelines: Res<SplatPipelines>,
    clouds: Res<RenderClouds>,
    scenes: Res<GpuScenes>,
    colors: Res<ShownColors>,
    clock: Res<StrokeClock>,
    masks: Res<RenderMasks>,
    lights: Lights,
    atmospheres: Atmospheres,
    fades: Res<CloudFades>,
    reports: Res<Reports<SceneRefused>>,
    mut gpu: GpuCommands,
) {
    let key = view.into_inner().retained_view_entity;
    // Nothing to draw here is not an error: splats, pipelines or the table are still on their way.
    let Some((plan, pair)) = views.get(&key).and_then(|splats| Some((splats.plan?, splats.pair))) else {
        return;
    };
    let Some(ready) = pipelines.get(plan.composite) else { return };
    // Taken out while this one is changed.
    let mut other = pair.and_then(|pair| Some((pair, views.take(&pair.other)?)));
    if let Some(splats) = views.get_mut(&key)
        && let Some(camera) = splats.camera.clone()
    {
        // The view keeps names and no borrows: a resource cannot hold references into other resources.
        let mut entities = Vec::with_capacity(splats.clouds.len());
        let seen: Vec<splat::Cloud> = splats
            .clouds
            .iter()
            .filter_map(|entity| {
                let cloud = clouds.0.get(entity)?;
                let (scene, colors) = (scenes.get(&cloud.scene)?, colors.get(*entity)?.at(clock.0));
                let visibility =
                    masks.visibility(*entity, scene.n_gaussians()).filter(|_| pipelines.has_masks());
                entities.push(*entity);
                Some(splat::Cloud { scene, colors, world_from_scene: cloud.world_from_scene, visibility })
            })
            .collect();
        splats.buffers.set_light(lights.of(&key, &entities, &atmospheres));
        splats.buffers.set_faded(fades.of(&entities));
        if let Some((pair, other)) = &mut other {
            other.buffers.set_faded(fades.of(&entities));
            other.buffers.set_light(lights.of(&pair.other, &entities, &atmospheres));
        }
        let beside = other.as_mut().map(|(pair, other)| (*pair, other));
        match sort(&mut gpu, &ready, splats, beside, &camera, &seen, &plan.settings) {
            Err(error) => refuse(splats, &reports, &error.to_string()),
            // A later refusal is reported again, since it has another cause: other clouds, or a larger target.
            Ok(()) => splats.refused = false,
        }
    }
    if let Some((pair, other)) = other {
        views.insert(pair.other, other);
    }
}

/// Draws a view's sorted splats into its layer, and composites the layer unless that happens after tonemapping.
pub(super) fn draw_splats(
    view: ViewQuery<(&ExtractedView, &ViewTarget, &ViewDepthTexture)>,
    mut views: ResMut<SplatViews>,
    pipelines: Res<SplatPipelines>,
    mut gpu: GpuCommands,
) {
    let (extracted, target, depth) = view.into_inner();
    let Some(splats) = views.get_mut(&extracted.retained_view_entity) else { return };
    let (Some(plan), Some(camera)) = (splats.plan, splats.camera.clone()) else { return };
    let Some(ready) = pipelines.get(plan.composite) else { return };
    draw_layer(&mut gpu, &ready, splats, &camera, depth);
    if !plan.after_tonemapping {
        composite(&mut gpu, &ready, splats, target.get_color_attachment());
    }
}

/// Projects and sorts one view's splats, or those of two eyes.
fn sort(
    gpu: &mut GpuCommands,
    ready: &Ready,
    splats: &mut ViewSplats,
    other: Option<(Pair, &mut ViewSplats)>,
    camera: &splat::Camera,
    seen: &[splat::Cloud],
    settings: &splat::SplatSettings,
) -> Result<(), splat::SplatError> {
    // The other eye's camera came first in this frame.
    if std::mem::take(&mut splats.is_sorted) {
        return Ok(());
    }
    let pass = &ready.passes.splat;
    let other = other.and_then(|(pair, other)| Some((pair, other.camera.clone()?, other)));
    gpu.timed(splats.span("splat_project_and_sort"), |gpu| match other {
        None => pass.project_and_sort(gpu, &mut splats.buffers, camera, seen, settings),
        Some((pair, beside, other)) => {
            other.is_sorted = true;
            let (mut views, mut cameras) = ([&mut splats.buffers, &mut other.buffers], [camera, &beside]);
            if !pair.is_first {
                views.reverse();
                cameras.reverse();
            }
            pass.project_and_sort_eyes(gpu, views, cameras, seen, settings)
        }
    })
}

/// Reports why the view shows no splats, unless it did so before.
fn refuse(splats: &mut ViewSplats, reports: &Reports<SceneRefused>, reason: &str) {
    // Without a plan, what comes later leaves the view alone in this frame too.
    splats.plan = None;
    if std::mem::replace(&mut splats.refused, true) {
        return;
    }
    for entity in &splats.clouds {
        let error = GaussianSceneError::Gpu(reason.into());
        reports.push(SceneRefused { entity: entity.id(), error });
    }
}

/// Blends splats in the view's layer.
fn draw_layer(
    gpu: &mut GpuCommands,
    ready: &Ready,
    splats: &mut ViewSplats,
    camera: &splat::Camera,
    depth: &ViewDepthTexture,
) {
    let name = splats.span("splat_draw");
    let Some((layer, buffers)) = splats.layer_and_buffers() else { return };
    let (pass, depth) = (&ready.passes.splat, depth.view());
    gpu.timed(name, |gpu| match (&layer.whole, &layer.half) {
        (Whole::Single(color, _), None) => {
            let layer = splat::Layer { color, depth: Some(depth) };
            pass.draw_layer(gpu, buffers, &layer, ready.draw);
        }
        (Whole::Single(color, _), Some(half)) => {
            let target = (half, color, &**depth);
            pass.draw_half_layer(gpu, buffers, camera, target, ready.draw);
        }
        (Whole::Edges(layers), None) => {
            let target = (&**layers, &**depth);
            pass.draw_edge_layers(gpu, buffers, camera, target, ready.draw);
        }
        (Whole::Edges(layers), Some(half)) => {
            let target = (half, &**layers, &**depth);
            pass.draw_half_edge_layers(gpu, buffers, camera, target, ready.draw);
        }
    });
}

/// Composites the view's layer over an image.
fn composite(gpu: &mut GpuCommands, ready: &Ready, splats: &ViewSplats, image: RenderPassColorAttachment) {
    let (Some((_, input)), Some(plan)) = (splats.layer(), splats.plan) else { return };
    gpu.timed(splats.span("splat_composite"), |gpu| {
        let mut pass = gpu.encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some("splat_composite"),
            color_attachments: &[Some(image)],
            ..default()
        });
        ready.passes.composite.draw(&mut pass, ready.composite, input, plan.viewport);
    });
}

/// Lifts what is exactly black before tonemapping, by less than a screen shows, in views whose layer comes
/// after a tonemapping that would make no number of it: a product with that is none either, whatever lies over
/// it.
///
/// The mutable target keeps other systems away, as below.
pub(super) fn lift_before_tonemapping(
    view: ViewQuery<(&ExtractedView, &mut ViewTarget)>,
    views: Res<SplatViews>,
    pipelines: Res<SplatPipelines>,
    mut context: RenderContext,
) {
    let (extracted, target) = view.into_inner();
    let Some(splats) = views.get(&extracted.retained_view_entity) else { return };
    let Some(plan) = splats.plan.filter(|plan| plan.lifts) else { return };
    let Some(lift) = pipelines.lift(plan.composite.format) else { return };
    let mut pass = context.command_encoder().begin_render_pass(&RenderPassDescriptor {
        label: Some("splat_lift"),
        color_attachments: &[Some(resolved(&target))],
        ..default()
    });
    lift.draw(&mut pass);
}

/// The picture of one sample per pixel. The target's own attachment would be the multisampled texture, which
/// effects after the main pass have left behind.
fn resolved(target: &ViewTarget) -> RenderPassColorAttachment<'_> {
    RenderPassColorAttachment {
        view: target.main_texture_view(),
        depth_slice: None,
        resolve_target: None,
        ops: Operations { load: LoadOp::Load, store: StoreOp::Store },
    }
}

/// Composites the layer of a view that bypasses tonemapping.
///
/// The mutable target keeps other systems away: effects after tonemapping swap its textures, which must not
/// happen meanwhile.
pub(super) fn composite_after_tonemapping(
    view: ViewQuery<(&ExtractedView, &mut ViewTarget)>,
    views: Res<SplatViews>,
    pipelines: Res<SplatPipelines>,
    mut gpu: GpuCommands,
) {
    let (extracted, target) = view.into_inner();
    let Some(splats) = views.get(&extracted.retained_view_entity) else { return };
    let Some(plan) = splats.plan.filter(|plan| plan.after_tonemapping) else { return };
    let Some(ready) = pipelines.get(plan.composite) else { return };
    composite(&mut gpu, &ready, splats, resolved(&target));
}
