//! Colors: the meeting place of styling and drawing.
//!
//! An entity's [`ColorLayers`] say which colors its splats should have, and are extracted to the render world
//! ([`extract`]). [`ShownColors`] holds the colors on the GPU: each style once ([`styles`]), and the mix of
//! each entity's layers ([`mix`]). Paintings have [`strokes`] as well, which go the same way. Styles that come
//! as colors are uploaded here; folded ones are decoded by the style pass. The splat pass reads `ShownColors`
//! and knows nothing of styles.
//!
//! Strokes that are the same in two styles, such as those of a bake and of the paint that it began with, are
//! one set of buffers, and stay as they are while colors fade under them. How strokes are drawn
//! (`StrokeKnobs`) belongs to the entity; a change of it is a change of uniforms and computes nothing. How they
//! move belongs to the layer, and the time is a uniform.
//!
//! A painting whose image changes while it is shown has its texture made anew ([`living`]).
//!
//! [`tint`]s change colors when they are drawn, for whole entities and for parts of them.

use bevy::{
    core_pipeline::schedule::camera_driver,
    prelude::*,
    render::{
        ExtractSchedule, GpuResourceAppExt, RenderApp,
        renderer::{RenderGraph, RenderGraphSystems},
    },
};

use crate::{
    reports::Reports,
    scene::{GaussianSplats, device_serves},
    systems::StyleGaussianSystems,
};

mod extract;
mod layers;
mod living;
mod mix;
mod ready;
mod shown;
mod strokes;
mod styles;
mod tint;

pub use ready::GaussianSceneReady;
pub use tint::SplatTint;

pub(crate) use extract::{RenderColors, WantedColors};
pub(crate) use layers::{ColorLayer, ColorLayers, LayerColors, Mix};
#[cfg(feature = "images")]
pub(crate) use living::{LivingPainting, check_image};
pub(crate) use living::{LivingPaintings, LivingReport, Redrawing, RedrawingGpu};
pub(crate) use mix::mix_colors;
pub(crate) use shown::{PipelinesReady, ShownColors, update_colors};
pub(crate) use strokes::{StrokeClock, StrokeTextures, StrokesReady};
pub(crate) use styles::{ColorSource, FoldedStyle, StyleColors};
pub(crate) use tint::TintedParts;

/// Keeps the colors on the GPU up to date.
pub(crate) struct ColorsPlugin;

impl Plugin for ColorsPlugin {
    fn build(&self, app: &mut App) {
        let reports = Reports::<LivingReport>::default();
        app.init_resource::<WantedColors>()
            .init_resource::<LivingPaintings>()
            .init_resource::<TintedParts>()
            .insert_resource(reports.clone())
            .add_message::<GaussianSceneReady>()
            .register_type::<GaussianSceneReady>()
            .register_type::<SplatTint>()
            .register_required_components::<GaussianSplats, ColorLayers>();
        app.add_systems(
            PostUpdate,
            (ready::renew_layers, ready::report_ready_scenes)
                .chain()
                .after(StyleGaussianSystems::Scenes)
                .before(StyleGaussianSystems::Styles),
        );
        // After the styles: they say which colors the entities should have.
        let ask_for_frames = ready::ask_for_frames.after(ready::report_ready_scenes);
        app.add_systems(PostUpdate, ask_for_frames.after(StyleGaussianSystems::Styles));
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app
                // Not GPU resources: they are filled by changes alone, so a lost device must leave them as they
                // are.
                .init_resource::<RenderColors>()
                .init_resource::<WantedColors>()
                .init_resource::<PipelinesReady>()
                .init_resource::<StrokesReady>()
                .init_resource::<StrokeClock>()
                .init_resource::<LivingPaintings>()
                .insert_resource(reports)
                // Rebuilt from `RenderColors` after a lost device.
                .init_gpu_resource::<ShownColors>()
                .init_gpu_resource::<StrokeTextures>()
                .init_gpu_resource::<Redrawing>()
                .init_gpu_resource::<mix::Mixer>()
                .add_systems(
                    ExtractSchedule,
                    (
                        extract::extract_layers,
                        extract::extract_wanted,
                        strokes::extract_clock,
                        living::extract_living,
                    ),
                )
                // Once per frame, before the first camera: views that share an entity must see the same colors.
                .add_systems(
                    RenderGraph,
                    (
                        shown::refuse_colors,
                        (update_colors, mix_colors).chain().run_if(device_serves).before(camera_driver),
                        living::begin_redrawing.before(camera_driver),
                        // What a camera draws in this frame is read in it.
                        living::read_living
                            .run_if(device_serves)
                            .after(camera_driver)
                            .in_set(RenderGraphSystems::Render),
                    ),
                );
        }
    }
}
