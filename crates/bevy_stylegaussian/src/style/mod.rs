//! Styles: what an entity wishes for, how a change is shown, and what is reported of it.
//!
//! - The wish: [`StyleSource`] is a mix of [`WeightedStyle`]s, each of a [`StyleInput`], with a
//!   [`StylePalette`] and [`StylePins`] if an artist wants them. [`StyleMethod`] chooses between paint and the
//!   [`decoder`]. [`StylePrepare`] prepares a scene for its first style. [`StrokeDirection`] says where strokes
//!   run, [`StyleMotion`] lets them boil and flow, and [`StyleRelief`] lights their thickness. [`StyleLiving`]
//!   lets them follow an image that changes.
//! - The change: [`StyleTransition`] and [`HiddenUntilStyled`]. A [`StyleVolume`] gives a part of space a
//!   style, or changes its strokes by [`VolumeStrokes`].
//! - The report: [`StyleRecolored`], [`StyleApplied`] and [`StyleFailed`] are events, [`StyleProgress`] and
//!   [`AppliedStyle`] components.
//! - The assets: [`StyleStatistics`] are presets, a [`StyleLook`] is baked.
//!
//! With the feature `refine`, `StyleRefine` bakes a shown style further, and `StyleRefined` is its event.

// From a `StyleSource` to the layers of colors that an entity shows.
//
// A changed `StyleSource`, or a changed asset that it names, makes the entity's job (`make::job`) want a new
// style. The job waits for the assets and has presets (`make::presets`) and images (`make::images`) prepared;
// meanwhile it shows first colors (`make::first`). Then a task, shared by all who want the same
// (`make::shared`), paints the scene on its surface (`make::surfaces`), or folds the style into the decoder's
// weights and, on the CPU backend, decodes the colors too (`make::request`). Folded weights are decoded on the
// GPU by the style pass (`pass`). Once the GPU has the colors, the entity puts them on (`show::worn`), by a
// transition (`show::transition`). The styles that an entity wears and the volumes that touch it
// (`show::volume`) become its layers (`show::compose`). A shown style may be baked further (`make::refine`),
// and it follows images that change (`make::following`).

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

pub mod decoder;
mod make;
mod pass;
mod show;
#[cfg(test)]
mod tests;
mod wish;

pub use make::prepare::StylePrepare;
pub use make::progress::StyleProgress;
#[cfg(feature = "refine")]
pub use make::refine::{StyleRefine, StyleRefined};
pub use show::transition::{StyleTransition, TransitionCenter, TransitionClock, TransitionShape};
pub use show::volume::{StyleVolume, VolumeShape};
pub use wish::applied::AppliedStyle;
pub use wish::asset::{StyleLook, StyleStatistics};
pub use wish::error::StyleError;
pub use wish::event::{StyleApplied, StyleFailed, StyleRecolored};
pub use wish::hand::{StylePalette, StylePin, StylePins, StylePinsFile};
pub use wish::living::StyleLiving;
pub use wish::motion::StyleMotion;
pub use wish::relief::{PaintLight, StyleRelief};
pub use wish::settings::StyleMethod;
pub use wish::source::{HiddenUntilStyled, StyleInput, StyleSource, WeightedStyle};
pub use wish::strokes::{StrokeDirection, VolumeStrokes};

pub(crate) use make::{
    beside::{Beside, PaintedBeside},
    job::StyleJobs,
    shared::SharedStyle,
};
#[cfg(feature = "meshes")]
pub(crate) use {
    make::{
        brushwork::Brushwork,
        inputs::Inputs as StyleInputs,
        later::{Failure, settled},
    },
    wish::event::StyleEvents,
};

use decoder::{GaussianDecoder, StyleBackend, StyleBudget, StyleDecoder};

/// Styles the entities that show a scene.
pub(crate) struct StylePlugin;

impl Plugin for StylePlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<StyleStatistics>()
            .init_asset::<StyleLook>()
            .init_asset::<GaussianDecoder>()
            .init_asset::<StylePinsFile>()
            .init_asset_loader::<FileLoader<StyleStatistics>>()
            .init_asset_loader::<FileLoader<StyleLook>>()
            .init_asset_loader::<FileLoader<GaussianDecoder>>()
            .init_asset_loader::<FileLoader<StylePinsFile>>()
            .init_resource::<StyleBackend>()
            .init_resource::<StyleBudget>()
            .init_resource::<StyleMethod>()
            .init_resource::<make::packed::PackedInputs>()
            .init_resource::<make::presets::Presets>()
            .init_resource::<make::surfaces::Surfaces>()
            .init_resource::<show::sun::Sun>()
            .register_required_components::<StyleVolume, StyleSource>()
            // On the source and not on the splats: entities that are never styled carry none.
            .register_required_components::<StyleSource, make::job::StyleJobs>()
            .init_resource::<make::shared::SharedStyles>()
            .add_message::<StyleApplied>()
            .add_message::<StyleRecolored>()
            .add_message::<StyleFailed>()
            .add_systems(
                PostUpdate,
                (
                    // In this order: old canvases and statistics are gone before a style is wanted, everything
                    // that is wanted is known, and reports have made jobs idle, before `advance_jobs` starts
                    // anything.
                    make::presets::forget_changed_presets,
                    show::compose::find_scenes_of_clouds,
                    show::compose::find_scenes_of_volumes,
                    make::want::want_changed_styles,
                    make::want::want_changed_assets,
                    make::want::drop_removed_styles,
                    show::compose::advance_transitions,
                    make::job::advance_jobs,
                    // Here the styles that are shown are refined (`make::refine`), and follow their images
                    // (`make::following`).
                    make::prepare::prepare_surfaces,
                    make::progress::report_progress,
                    make::surfaces::forget_unused_surfaces,
                    show::compose::compose_layers,
                    make::job::report_drawn_styles,
                    make::frames::ask_for_frames,
                    make::shared::forget_unused_styles,
                    make::packed::forget_unused_inputs,
                )
                    .chain()
                    .in_set(StyleGaussianSystems::Styles)
                    // Volumes and waves are where they are in this frame.
                    .after(TransformSystems::Propagate),
            );
        #[cfg(feature = "pbr")]
        app.add_systems(
            PostUpdate,
            show::sun::find_sun
                .in_set(StyleGaussianSystems::Styles)
                .after(TransformSystems::Propagate)
                .before(show::compose::compose_layers),
        );
        register_types(app);
        #[cfg(feature = "images")]
        app.add_plugins((make::images::ImagesPlugin, make::following::FollowingPlugin));
        #[cfg(feature = "refine")]
        app.add_plugins(make::refine::RefinePlugin);
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

/// Number of styles that are computed or kept.
#[cfg(all(test, feature = "images"))]
pub(crate) fn n_known_styles(world: &World) -> usize {
    world.resource::<make::shared::SharedStyles>().n_known()
}

fn register_types(app: &mut App) {
    app.register_type::<StyleStatistics>()
        .register_type::<StyleLook>()
        .register_type::<GaussianDecoder>()
        .register_type::<StylePinsFile>()
        .register_type::<StyleSource>()
        .register_type::<StyleDecoder>()
        .register_type::<StyleTransition>()
        .register_type::<StyleVolume>()
        .register_type::<HiddenUntilStyled>()
        .register_type::<StyleBackend>()
        .register_type::<StyleBudget>()
        .register_type::<StyleMethod>()
        .register_type::<StyleLiving>()
        .register_type::<StylePrepare>()
        .register_type::<StyleApplied>()
        .register_type::<StyleRecolored>()
        .register_type::<StyleFailed>();
}
