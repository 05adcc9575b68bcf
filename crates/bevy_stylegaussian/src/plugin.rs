//! The plugin: the four rooms, put together.

use bevy::{prelude::*, render::RenderApp};

use crate::{
    colors::ColorsPlugin,
    mask::MaskPlugin,
    picking::PickingPlugin,
    scene::{ScenePlugin, UploadsInBackground},
    splats::SplatsPlugin,
    style::StylePlugin,
    systems::StyleGaussianSystems,
    work::{SynchronousCompilation, WorkPlugin},
};

/// Loads, draws and styles captured scenes. Add it after `DefaultPlugins`.
///
/// Settings that an app may change while it runs are resources: [`StyleBackend`], [`StyleBudget`] and
/// [`StyleEncoder`]. Insert them before or after the plugin; without them, their defaults apply.
///
/// [`StyleBackend`]: crate::StyleBackend
/// [`StyleBudget`]: crate::StyleBudget
/// [`StyleEncoder`]: crate::StyleEncoder
#[derive(Clone, Debug, Default)]
pub struct StyleGaussianPlugin {
    /// If true, a frame that needs a new pipeline or a scene that is not on the GPU yet waits for it. If false,
    /// which is the default, the frame is drawn without these splats. Use it to render images where every frame
    /// counts. Bevy's `RenderPlugin` has the same switch.
    pub synchronous_pipeline_compilation: bool,
}

impl Plugin for StyleGaussianPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(GaussianSplatsPlugin {
            synchronous_pipeline_compilation: self.synchronous_pipeline_compilation,
        })
        // Scenes first: a style that is requested in the same frame needs the attached scene.
        .configure_sets(PostUpdate, (StyleGaussianSystems::Scenes, StyleGaussianSystems::Styles).chain())
        .add_plugins(StylePlugin);
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
