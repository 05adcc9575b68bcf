//! Textures of paintings that change, made before the first view of a frame that draws splats.

use bevy::{
    prelude::*,
    render::{render_asset::RenderAssets, renderer::ViewQuery, texture::GpuImage, view::ExtractedView},
};

use crate::{
    colors::{LivingPaintings, LivingReport, Redrawing, RedrawingGpu, StrokeTextures},
    commands::GpuCommands,
    reports::Reports,
    work::SynchronousCompilation,
};

use super::view::SplatViews;

/// Makes textures anew whose images changed, unless an earlier view of the frame did.
///
/// Cameras draw one after another, so an image that one of them draws is complete when a later one shows
/// splats.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn redraw_living(
    view: ViewQuery<&ExtractedView>,
    views: Res<SplatViews>,
    living: Res<LivingPaintings>,
    mut redrawing: ResMut<Redrawing>,
    images: Res<RenderAssets<GpuImage>>,
    textures: Res<StrokeTextures>,
    synchronous: Res<SynchronousCompilation>,
    reports: Res<Reports<LivingReport>>,
    mut gpu: GpuCommands,
) {
    if living.shown.is_empty() {
        return;
    }
    let shows_splats = views.get(&view.into_inner().retained_view_entity).is_some_and(|v| v.plan.is_some());
    if shows_splats {
        let from = RedrawingGpu {
            images: &images,
            textures: &textures,
            synchronous: *synchronous,
            reports: &reports,
        };
        redrawing.redraw(&living, &from, &mut gpu);
    }
}
