//! Style: what an entity should look like, and how it comes to.
//!
//! A change of a [`StyleSource`] (or of an asset it names) asks its [`job`] for a new look. The job waits for the assets,
//! has images encoded ([`images`]), and folds the transfer into weights, or decodes the colors too, in the background
//! ([`transfer`]). Then the entity's [`Look`] changes, and with it what the render world draws.

use bevy::{
    core_pipeline::schedule::camera_driver,
    prelude::*,
    render::{
        ExtractSchedule, GpuResourceAppExt, RenderApp, extract_resource::ExtractResourcePlugin,
        renderer::RenderGraph,
    },
};

use crate::plugin::StyleGaussianSystems;

mod decoder;
mod event;
mod images;
mod inputs;
mod job;
mod look;
mod looks;
mod node;
mod packed;
mod settings;
mod source;
#[cfg(test)]
mod tests;
mod transfer;

pub use event::{AppliedStyle, StyleApplied, StyleError, StyleFailed, StylePassCount};
pub use settings::{StyleBackend, StyleBudget, StyleEncoder};
pub use source::{StyleDecoder, StyleInput, StyleSource, StyleTransition, WeightedStyle};

pub(crate) use look::{GpuReport, GpuReports, Look};
pub(crate) use looks::{CloudLooks, LookClock};

/// Styles [`GaussianSplats`](crate::GaussianSplats).
pub(crate) struct StylePlugin;

impl Plugin for StylePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<images::ImageStatistics>()
            .init_resource::<packed::PackedInputs>()
            .init_resource::<GpuReports>()
            .init_resource::<StylePassCount>()
            .init_resource::<StyleBudget>()
            .add_plugins(ExtractResourcePlugin::<StyleBudget>::default())
            .add_message::<StyleApplied>()
            .add_message::<StyleFailed>()
            .register_type::<StyleSource>()
            .register_type::<StyleTransition>()
            .register_type::<StyleDecoder>()
            .register_type::<StyleBackend>()
            .register_type::<StyleBudget>()
            .register_type::<StyleEncoder>()
            .register_type::<StyleApplied>()
            .register_type::<StyleFailed>()
            .register_type::<AppliedStyle>()
            .register_type::<StylePassCount>()
            .add_systems(
                PostUpdate,
                (
                    images::forget_changed_images,
                    job::ask_for_changed_styles,
                    job::ask_for_changed_assets,
                    job::drop_removed_styles,
                    job::hear_from_gpu,
                    job::advance_jobs,
                )
                    .chain()
                    .in_set(StyleGaussianSystems::Styles),
            );
        let reports = app.world().resource::<GpuReports>().clone();
        let count = app.world().resource::<StylePassCount>().clone();
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app
                .insert_resource(reports)
                .insert_resource(count)
                .init_resource::<LookClock>()
                .add_systems(ExtractSchedule, looks::extract_clock)
                // Rebuilt from `RenderClouds` after a lost device.
                .init_gpu_resource::<CloudLooks>()
                .init_gpu_resource::<node::StylePasses>()
                .add_systems(RenderGraph, node::update_looks.before(camera_driver));
        }
    }
}
