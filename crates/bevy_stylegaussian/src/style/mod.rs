//! Styling: from a [`StyleSource`] to the layers of colors that an entity shows.
//!
//! A changed [`StyleSource`], or a changed asset that it names, makes the entity's [`job`](make::job) want a
//! new style. The job waits for the assets and has images prepared ([`canvases`](make::canvases)) or encoded
//! ([`images`](make::images)); meanwhile it shows [`first`](make::first) colors. Then a task, shared by all who
//! want the same ([`shared`](make::shared)), paints the scene on its surface ([`surfaces`](make::surfaces)), or
//! folds the style into the decoder's weights and, on the CPU backend, decodes the colors too
//! ([`request`](make::request)). Folded weights are decoded on the GPU by the style pass ([`pass`]). Once the
//! GPU has the colors, the entity puts them on ([`worn`](show::worn)), by a [`transition`](show::transition).
//! The styles that an entity wears and the [`volume`](show::volume)s that touch it become its layers
//! ([`compose`](show::compose)). A shown style may be baked further ([`refine`](make::refine)).

use bevy::{
    prelude::*,
    render::{GpuResourceAppExt, RenderApp, extract_resource::ExtractResourcePlugin, renderer::RenderGraph},
};

use crate::{
    colors::{mix_colors, update_colors},
    loader::FileLoader,
    scene::device_serves,
    systems::StyleGaussianSystems,
};

mod make;
mod pass;
mod show;
#[cfg(test)]
mod tests;
mod wish;

pub use make::prepare::StylePrepare;
pub use make::progress::StyleProgress;
pub use make::refine::StyleRefine;
pub use show::transition::{StyleTransition, TransitionCenter, TransitionClock, TransitionShape};
pub use show::volume::{StyleVolume, VolumeShape};
pub use wish::applied::AppliedStyle;
pub use wish::asset::{GaussianDecoder, ImageEncoder, StyleLook, StyleStatistics};
pub use wish::error::StyleError;
pub use wish::event::{StyleApplied, StyleFailed, StyleRecolored, StyleRefined};
pub use wish::settings::{StyleBackend, StyleBudget, StyleEncoder, StyleMethod};
pub use wish::source::{HiddenUntilStyled, StyleDecoder, StyleInput, StyleSource, WeightedStyle};

/// Styles the entities that show a scene.
pub(crate) struct StylePlugin;

impl Plugin for StylePlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<StyleStatistics>()
            .init_asset::<StyleLook>()
            .init_asset::<GaussianDecoder>()
            .init_asset::<ImageEncoder>()
            .init_asset_loader::<FileLoader<StyleStatistics>>()
            .init_asset_loader::<FileLoader<StyleLook>>()
            .init_asset_loader::<FileLoader<GaussianDecoder>>()
            .init_asset_loader::<FileLoader<ImageEncoder>>()
            .init_resource::<StyleBackend>()
            .init_resource::<StyleBudget>()
            .init_resource::<StyleMethod>()
            .init_resource::<StyleEncoder>()
            .init_resource::<make::canvases::Canvases>()
            .init_resource::<make::images::ImageStatistics>()
            .init_resource::<make::packed::PackedInputs>()
            .init_resource::<make::surfaces::Surfaces>()
            .register_required_components::<StyleVolume, StyleSource>()
            // On the source and not on the splats: entities that are never styled carry none.
            .register_required_components::<StyleSource, make::job::StyleJobs>()
            .init_resource::<make::shared::SharedStyles>()
            .init_resource::<make::refine::Engine>()
            .add_message::<StyleApplied>()
            .add_message::<StyleRecolored>()
            .add_message::<StyleRefined>()
            .add_message::<StyleFailed>()
            .add_systems(
                PostUpdate,
                (
                    // In this order: old canvases and statistics are gone before a style is wanted, everything
                    // that is wanted is known, and reports have made jobs idle, before `advance_jobs` starts
                    // anything.
                    make::canvases::forget_changed_canvases,
                    make::images::forget_changed_images,
                    show::compose::find_scenes_of_clouds,
                    show::compose::find_scenes_of_volumes,
                    make::want::want_changed_styles,
                    make::want::want_changed_assets,
                    make::want::drop_removed_styles,
                    show::compose::advance_transitions,
                    make::job::advance_jobs,
                    // After the styles: a style that has just been applied is refined, and a changed one no
                    // longer.
                    make::refine::want_refinements,
                    make::refine::advance_refinements,
                    make::prepare::prepare_surfaces,
                    make::progress::report_progress,
                    make::surfaces::forget_unused_surfaces,
                    show::compose::compose_layers,
                    make::job::report_drawn_styles,
                    make::frames::ask_for_frames,
                    make::shared::forget_unused_styles,
                )
                    .chain()
                    .in_set(StyleGaussianSystems::Styles)
                    // Volumes and waves are where they are in this frame.
                    .after(TransformSystems::Propagate),
            );
        register_types(app);
        #[cfg(feature = "bundled_models")]
        // After `init_asset`, whose collection it is added to.
        wish::asset::add_bundled_encoder(app.world_mut());
        if app.get_sub_app(RenderApp).is_some() {
            // Without a render app, Bevy would log an error.
            app.add_plugins(ExtractResourcePlugin::<StyleBudget>::default());
        }
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app.init_gpu_resource::<pass::StylePasses>().add_systems(
                RenderGraph,
                // `update_colors` makes the entries that styles are decoded into, and `mix_colors` shows them
                // in the same frame.
                pass::decode_styles.after(update_colors).before(mix_colors).run_if(device_serves),
            );
        }
    }
}

/// Whether a style is under way or about to be drawn.
#[cfg(test)]
pub(crate) fn has_unsettled_styles(world: &mut World) -> bool {
    let mut jobs = world.query::<&make::job::StyleJobs>();
    jobs.iter(world).any(|jobs| jobs.of_scene.iter().any(|job| !job.is_shown()))
}

fn register_types(app: &mut App) {
    app.register_type::<StyleStatistics>()
        .register_type::<StyleLook>()
        .register_type::<GaussianDecoder>()
        .register_type::<ImageEncoder>()
        .register_type::<StyleSource>()
        .register_type::<StyleDecoder>()
        .register_type::<StyleTransition>()
        .register_type::<StyleVolume>()
        .register_type::<HiddenUntilStyled>()
        .register_type::<StyleBackend>()
        .register_type::<StyleBudget>()
        .register_type::<StyleMethod>()
        .register_type::<StyleEncoder>()
        .register_type::<StyleRefine>()
        .register_type::<StylePrepare>()
        .register_type::<StyleApplied>()
        .register_type::<StyleRecolored>()
        .register_type::<StyleRefined>()
        .register_type::<StyleFailed>();
}
