//! Depth of splats for cameras that ask for it: iso depth in the camera's depth texture, and in the one of its
//! depth prepass.
//!
//! The prepass is written before the opaque pass, so that ambient occlusion and contact shadows see splats, and
//! its depth is read by nothing that draws opaque meshes themselves. Only deferred lighting takes places from
//! it, so those of a deferred camera are written after that. The camera's own depth is written once the splats
//! are drawn, after the air of Bevy's `Atmosphere`, which splats have by themselves. Transparent meshes, depth
//! of field, motion blur and volumetric fog come later.

use bevy::{
    core_pipeline::{
        core_3d::CORE_3D_DEPTH_FORMAT,
        prepass::{DeferredPrepass, ViewPrepassTextures},
    },
    ecs::system::SystemParam,
    platform::collections::HashMap,
    prelude::*,
    render::{
        extract_component::ExtractComponent,
        renderer::{RenderDevice, ViewQuery},
        view::{ExtractedView, RetainedViewEntity, ViewDepthTexture},
    },
};
use stylegaussian_gpu::splat::{DepthPipeline, IsoDepth};
use wgpu::{LoadOp, Operations, RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp};

use crate::{
    colors::PipelinesReady,
    commands::GpuCommands,
    work::{Background, SynchronousCompilation},
};

use super::{pipelines::SplatPipelines, view::SplatViews};

/// Lets splats write depth, so that the game knows where they are: depth of field, ambient occlusion, contact
/// shadows, decals and all that reads the depth prepass, and transparent meshes, which splats hide from then
/// on. A component of the camera. Cameras without it pay nothing.
///
/// A pixel's depth is that of the splat, from the nearest on, behind which less than `threshold` of the light
/// passes. Where there is none, such as in thin smoke, and where a mesh is nearer, nothing is written. Fog and
/// the air of Bevy's `Atmosphere` are on splats with it as without.
///
/// A transparent mesh is drawn over all splats of a pixel if it is before that depth, and not at all if it is
/// behind. So it is as sharp as an opaque mesh where the splats are a surface.
#[derive(Component, ExtractComponent, Clone, Copy, Debug, PartialEq, Reflect)]
#[extract_component_filter(With<Camera3d>)]
#[require(Camera3d)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SplatDepth {
    /// Share of the light, 0.02 to 1; 0.5 by default. Less moves the surface deeper into soft splats, and finds
    /// none in more of them.
    pub threshold: f32,
}

impl Default for SplatDepth {
    fn default() -> Self {
        Self { threshold: stylegaussian::splat::ISO_THRESHOLD }
    }
}

/// The depths of the views that ask for them.
#[derive(Resource, Default)]
pub(super) struct SplatDepths {
    of_view: HashMap<RetainedViewEntity, IsoDepth>,
    /// The pipelines for attachments of so many samples.
    pipelines: HashMap<u32, Background<DepthPipeline>>,
}

#[cfg(test)]
impl SplatDepths {
    /// Number of views that have depths.
    pub(super) fn n_views(&self) -> usize {
        self.of_view.len()
    }
}

/// Requests the pipelines of cameras that ask for depth, and forgets those that do not any more.
pub(super) fn prepare_depths(
    cameras: Query<(&ExtractedView, &Msaa), With<SplatDepth>>,
    mut depths: ResMut<SplatDepths>,
    pipelines: Res<SplatPipelines>,
    mut all_ready: ResMut<PipelinesReady>,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
) {
    let SplatDepths { of_view, pipelines: writes } = &mut *depths;
    of_view.retain(|view, _| cameras.iter().any(|(camera, _)| camera.retained_view_entity == *view));
    for (camera, msaa) in &cameras {
        of_view.entry(camera.retained_view_entity).or_default();
        // Requested for every camera, so they are on their way.
        let Some(passes) = pipelines.shared() else { continue };
        let samples = msaa.samples();
        let write = writes.entry(samples).or_insert_with(|| {
            let device = device.wgpu_device().clone();
            Background::start(*synchronous, move || {
                passes.splat.prepare_depth(&device);
                passes.splat.depth_pipeline(&device, samples, CORE_3D_DEPTH_FORMAT)
            })
        });
        all_ready.0 &= write.get().is_some();
    }
}

/// Everything that writing depth takes.
#[derive(SystemParam)]
pub(super) struct Writer<'w, 's> {
    views: ResMut<'w, SplatViews>,
    depths: ResMut<'w, SplatDepths>,
    pipelines: Res<'w, SplatPipelines>,
    gpu: GpuCommands<'w, 's>,
}

impl Writer<'_, '_> {
    /// Writes the depths of a view, whose splats are sorted, into an attachment of `samples` samples. `span` is
    /// its name among the diagnostics.
    fn write(
        &mut self,
        span: &'static str,
        (view, depth): (&RetainedViewEntity, &SplatDepth),
        samples: u32,
        attachment: RenderPassDepthStencilAttachment,
    ) {
        let Some(splats) = self.views.get_mut(view).filter(|splats| splats.plan.is_some()) else { return };
        let SplatDepths { of_view, pipelines } = &mut *self.depths;
        let (Some(iso), Some(passes)) = (of_view.get_mut(view), self.pipelines.passes()) else { return };
        let Some(pipeline) = pipelines.get(&samples).and_then(Background::get) else { return };
        self.gpu.timed(splats.span(span), |gpu| {
            passes.splat.find_depth(gpu, &mut splats.buffers, depth.threshold, iso);
            let mut pass = gpu.encoder.begin_render_pass(&RenderPassDescriptor {
                label: Some("splat_depth"),
                depth_stencil_attachment: Some(attachment),
                ..default()
            });
            passes.splat.write_depth(&mut pass, iso, pipeline);
        });
    }
}

/// Writes a view's depths into the depth of its prepass.
pub(super) fn write_prepass_depth(
    view: ViewQuery<(&ExtractedView, &SplatDepth, &Msaa, &ViewPrepassTextures), Without<DeferredPrepass>>,
    mut writer: Writer,
) {
    let (extracted, depth, msaa, textures) = view.into_inner();
    write_into_prepass(&mut writer, (&extracted.retained_view_entity, depth), msaa, textures);
}

/// A view whose depth texture gets the depths of splats.
type Deep = (
    &'static ExtractedView,
    &'static SplatDepth,
    &'static Msaa,
    &'static ViewDepthTexture,
    Option<&'static ViewPrepassTextures>,
    Has<DeferredPrepass>,
);

/// Writes a view's depths into its depth texture, and those of a deferred camera into its prepass.
pub(super) fn write_view_depth(view: ViewQuery<Deep>, mut writer: Writer) {
    let (extracted, depth, msaa, texture, prepass, is_deferred) = view.into_inner();
    let view = (&extracted.retained_view_entity, depth);
    let attachment = texture.get_attachment(StoreOp::Store);
    writer.write("splat_depth", view, msaa.samples(), attachment);
    if let Some(textures) = prepass.filter(|_| is_deferred) {
        write_into_prepass(&mut writer, view, msaa, textures);
    }
}

fn write_into_prepass(
    writer: &mut Writer,
    view: (&RetainedViewEntity, &SplatDepth),
    msaa: &Msaa,
    textures: &ViewPrepassTextures,
) {
    let Some(texture) = textures.depth_view() else { return };
    let attachment = RenderPassDepthStencilAttachment {
        view: texture,
        depth_ops: Some(Operations { load: LoadOp::Load, store: StoreOp::Store }),
        stencil_ops: None,
    };
    writer.write("splat_prepass_depth", view, msaa.samples(), attachment);
}
