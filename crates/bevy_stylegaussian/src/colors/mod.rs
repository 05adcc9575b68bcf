//! Colors: the meeting place of styling and drawing.
//!
//! An entity's [`ColorWish`] says which colors its splats should have. It is extracted to the render world
//! ([`extract`]), and [`ShownColors`] holds the colors on the GPU and fades from the old colors to the new ([`fade`]).
//! Captured and known colors are applied here ([`shown`]); folded styles are decoded by the style pass, which reports back
//! through [`ColorReport`]. The splat pass reads `ShownColors` and knows nothing of styles.

use bevy::{
    core_pipeline::schedule::camera_driver,
    prelude::*,
    render::{ExtractSchedule, GpuResourceAppExt, RenderApp, renderer::RenderGraph},
};

use crate::reports::Reports;

mod extract;
mod fade;
mod shown;
mod wish;

pub use fade::StyleTransition;

pub(crate) use extract::RenderWishes;
pub(crate) use fade::FadeClock;
pub(crate) use shown::{EntityColors, ShownColors, update_colors};
pub(crate) use wish::{ColorReport, ColorSource, ColorWish, FoldedStyle};

/// Keeps the colors on the GPU up to date.
pub(crate) struct ColorsPlugin;

impl Plugin for ColorsPlugin {
    fn build(&self, app: &mut App) {
        // One queue, cloned into both worlds: the render world cannot write to the main world.
        let reports = Reports::<ColorReport>::default();
        app.register_type::<StyleTransition>().insert_resource(reports.clone());
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app
                .insert_resource(reports)
                // Not GPU resources: they are filled by changes alone, so a lost device must leave them as they are.
                .init_resource::<RenderWishes>()
                .init_resource::<FadeClock>()
                // Rebuilt from `RenderWishes` after a lost device.
                .init_gpu_resource::<ShownColors>()
                .add_systems(ExtractSchedule, (extract::extract_wishes, fade::extract_clock))
                // Once per frame, before the first camera: views that share an entity must see the same colors.
                .add_systems(RenderGraph, update_colors.before(camera_driver));
        }
    }
}
