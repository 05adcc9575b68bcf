//! The plugin: assets, settings, and the two features, splats and style.

use std::path::PathBuf;

use bevy::{prelude::*, render::RenderApp};

use crate::{
    asset::{GaussianDecoder, GaussianScene, StyleStatistics},
    loader::{GaussianDecoderLoader, GaussianSceneLoader, StyleStatisticsLoader},
    pipeline::AtOnce,
    splats::SplatsPlugin,
    style::{StyleBackend, StyleEncoder, StylePlugin},
};

/// Loads, draws and styles captured scenes. Add it after `DefaultPlugins`.
#[derive(Clone, Debug, Default)]
pub struct StyleGaussianPlugin {
    /// Where styles are decoded; the resource [`StyleBackend`] changes it later.
    pub backend: StyleBackend,
    /// The encoder of style images, where it is neither the one that `STYLEGAUSSIAN_ENCODER` names nor the default one; the
    /// resource [`StyleEncoder`] changes it later. Presets need none.
    pub encoder: Option<PathBuf>,
    /// Whether a frame that needs new pipelines, or a scene that is not on the GPU yet, waits for them, instead of going
    /// without these splats until they are ready: for pictures without a window, where every frame counts. Bevy's
    /// `RenderPlugin` has the same switch.
    pub synchronous_pipeline_compilation: bool,
}

/// When the plugin works, in `PostUpdate`: changes made before are on the screen in the same frame, as far as they take
/// no computing.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum StyleGaussianSystems {
    /// Entities get their loaded scene and its bounds.
    Scenes,
    /// Styles are asked for, computed in the background and taken over; [`StyleApplied`](crate::StyleApplied) and
    /// [`StyleFailed`](crate::StyleFailed) are sent.
    Styles,
}

impl Plugin for StyleGaussianPlugin {
    fn build(&self, app: &mut App) {
        let encoder = self.encoder.clone().map_or_else(StyleEncoder::default, StyleEncoder::at);
        app.insert_resource(self.backend)
            .insert_resource(encoder)
            .init_asset::<GaussianScene>()
            .init_asset::<StyleStatistics>()
            .init_asset::<GaussianDecoder>()
            .init_asset_loader::<GaussianSceneLoader>()
            .init_asset_loader::<StyleStatisticsLoader>()
            .init_asset_loader::<GaussianDecoderLoader>()
            .register_type::<GaussianScene>()
            .register_type::<StyleStatistics>()
            .register_type::<GaussianDecoder>()
            .configure_sets(PostUpdate, (StyleGaussianSystems::Scenes, StyleGaussianSystems::Styles).chain())
            .add_plugins((SplatsPlugin, StylePlugin));
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app.insert_resource(AtOnce(self.synchronous_pipeline_compilation));
        }
    }
}
