//! The plugin: the four rooms, put together.

use bevy::{
    image::{CompressedImageFormats, ImageLoader},
    prelude::*,
    render::RenderApp,
    tasks::AsyncComputeTaskPool,
};

use crate::{
    colors::ColorsPlugin,
    mask::MaskPlugin,
    picking::PickingPlugin,
    scene::{ScenePlugin, UploadsInBackground},
    splats::SplatsPlugin,
    style::StylePlugin,
    systems::StyleGaussianSystems,
    work::{SynchronousCompilation, WorkPlugin},
    world::WorldPlugin,
};

/// Loads, draws and styles captured scenes. Add it after `DefaultPlugins`.
///
/// Without a renderer, scenes are loaded and styled and nothing is drawn, for example in a server or a test:
/// with `DefaultPlugins` whose `RenderPlugin` has no backend, or with `MinimalPlugins` and `AssetPlugin`.
/// Styles are computed by the CPU then.
///
/// # Panics
/// When the app is built, with a message that says what to add and in which order, if `AssetPlugin` is missing
/// or comes later, if `RenderPlugin` comes later, or if `TaskPoolPlugin` or `TimePlugin` is missing.
///
/// Settings that an app may change while it runs are resources: [`StyleBackend`], [`StyleBudget`] and
/// `StyleEncoder`. Insert them before or after the plugin; without them, their defaults apply.
///
/// [`StyleBackend`]: crate::style::decoder::StyleBackend
/// [`StyleBudget`]: crate::style::decoder::StyleBudget
#[derive(Clone, Debug, Default)]
pub struct StyleGaussianPlugin {
    /// If true, a frame that needs a new pipeline or a scene that is not on the GPU yet waits for it. If false,
    /// which is the default, the frame is drawn without these splats. Use it to render images where every frame
    /// counts. Bevy's `RenderPlugin` has the same switch.
    pub synchronous_pipeline_compilation: bool,
}

impl Plugin for StyleGaussianPlugin {
    fn build(&self, app: &mut App) {
        assert!(
            app.world().contains_resource::<AssetServer>(),
            "StyleGaussianPlugin found no AssetPlugin: add it after DefaultPlugins, as in \
             `.add_plugins((DefaultPlugins, StyleGaussianPlugin::default()))`, or after MinimalPlugins and \
             AssetPlugin in an app that does not draw"
        );
        app.add_plugins(GaussianSplatsPlugin {
            synchronous_pipeline_compilation: self.synchronous_pipeline_compilation,
        })
        // Scenes first: a style that is requested in the same frame needs the attached scene.
        .configure_sets(PostUpdate, (StyleGaussianSystems::Scenes, StyleGaussianSystems::Styles).chain())
        .add_plugins((StylePlugin, WorldPlugin));
        #[cfg(feature = "meshes")]
        app.add_plugins(crate::meshes::MeshesPlugin);
    }

    fn finish(&self, app: &mut App) {
        let render_app = app.get_sub_app(RenderApp);
        assert!(
            render_app.is_none_or(|app| app.world().contains_resource::<SynchronousCompilation>()),
            "StyleGaussianPlugin was added before RenderPlugin: add it after DefaultPlugins"
        );
        for (name, is_there) in [
            // Not by the plugins' types: an app may start pools and clocks by itself.
            ("TaskPoolPlugin", AsyncComputeTaskPool::try_get().is_some()),
            ("TimePlugin", app.world().contains_resource::<Time<Real>>()),
        ] {
            assert!(
                is_there,
                "StyleGaussianPlugin found no {name}: add DefaultPlugins or MinimalPlugins before it"
            );
        }
        // Not while plugins are built: Bevy's `ImagePlugin` may come later, and would replace the collection.
        if !app.world().contains_resource::<Assets<Image>>() {
            app.init_asset::<Image>();
            app.register_asset_reflect::<Image>();
            // Pictures for the CPU, which no GPU has to understand.
            app.register_asset_loader(ImageLoader::new(CompressedImageFormats::NONE));
        }
    }
}

/// Loads and draws captured scenes in the colors they were captured with. [`StyleGaussianPlugin`] contains it.
#[derive(Clone, Debug, Default)]
pub(crate) struct GaussianSplatsPlugin {
    /// As in [`StyleGaussianPlugin`].
    pub(crate) synchronous_pipeline_compilation: bool,
}

impl Plugin for GaussianSplatsPlugin {
    fn build(&self, app: &mut App) {
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app.insert_resource(SynchronousCompilation(self.synchronous_pipeline_compilation));
            if !self.synchronous_pipeline_compilation {
                app.insert_resource(UploadsInBackground);
            }
        }
        app.add_plugins((WorkPlugin, ScenePlugin, ColorsPlugin, MaskPlugin, PickingPlugin, SplatsPlugin));
    }
}
