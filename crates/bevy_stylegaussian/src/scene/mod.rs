//! Scenes: the asset, the component that shows it, and its data on the GPU.
//!
//! This is the bottom room: it imports no other room. `PostUpdate` attaches loaded scenes to entities
//! ([`attach`]), the extraction copies them to the render world ([`extract`]), and there they are uploaded
//! ([`gpu`]).

use bevy::{
    asset::{AsAssetId, AssetEventSystems},
    camera::visibility::{VisibilityClass, VisibilitySystems, add_visibility_class},
    prelude::*,
    render::{ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems},
};

use crate::{reports::Reports, systems::StyleGaussianSystems};

mod asset;
mod attach;
mod device;
mod extract;
mod failure;
mod gpu;
mod loader;
mod per_scene;

pub use asset::GaussianScene;
pub use failure::{GaussianSceneError, GaussianSceneFailed};
pub use loader::SceneSettings;

pub(crate) use attach::{LoadedScene, NextScene, UploadsInBackground};
pub(crate) use device::{DeviceServes, device_serves};
use extract::NextScenes;
pub(crate) use extract::RenderClouds;
pub(crate) use failure::SceneRefused;
pub(crate) use gpu::{GpuScenes, upload_scenes};
use loader::SceneLoader;
pub(crate) use per_scene::PerScene;

/// Shows a [`GaussianScene`] at the entity's `Transform`, which may scale and shear it. A scale of 0 along an
/// axis has no inverse, and shows nothing; a small one, such as 0.001, shows the scene flat.
///
/// If a scene lies on its side or stands on its head, its file does not say which way is up:
/// [`SceneSettings::axes`] turns it while it is loaded, and so does the `Transform`.
///
/// Splats are depth-tested against opaque meshes and drawn before transparent ones. They have the colors they
/// were captured with; lights do not change them. Any number of entities may share a scene. Splats of
/// overlapping scenes blend in the right order.
#[derive(Component, Clone, Debug, Default, PartialEq, Eq, Reflect)]
#[require(Transform, Visibility, VisibilityClass)]
#[component(on_add = add_visibility_class::<GaussianSplats>)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct GaussianSplats(pub Handle<GaussianScene>);

impl AsAssetId for GaussianSplats {
    type Asset = GaussianScene;

    fn as_asset_id(&self) -> AssetId<GaussianScene> {
        self.0.id()
    }
}

/// Loads scenes and uploads them.
pub(crate) struct ScenePlugin;

impl Plugin for ScenePlugin {
    fn build(&self, app: &mut App) {
        let reports = Reports::<SceneRefused>::default();
        app.init_asset::<GaussianScene>()
            .init_asset_loader::<SceneLoader>()
            .insert_resource(reports.clone())
            .add_message::<GaussianSceneFailed>()
            .register_type::<GaussianScene>()
            .register_type::<GaussianSplats>()
            .register_type::<GaussianSceneFailed>()
            .add_systems(
                PostUpdate,
                (
                    // Chained, so that the commands of one are applied before the next: an asset that is gone
                    // detaches its scene first.
                    (
                        attach::detach_scenes,
                        attach::attach_scenes,
                        attach::attach_uploaded_scenes,
                        attach::report_failed_loads,
                    )
                        .chain(),
                    failure::report_refused_scenes,
                )
                    .in_set(StyleGaussianSystems::Scenes)
                    // `AssetChanged` sees the changes of this frame only after them.
                    .after(AssetEventSystems)
                    // A scene's bounds must be there before it is culled, or its first frame would be lost.
                    .before(VisibilitySystems::CheckVisibility),
            );
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app
                .insert_resource(reports)
                // Not a GPU resource: it is filled by changes alone, so a lost device must leave it as it is.
                .init_resource::<RenderClouds>()
                .init_resource::<NextScenes>()
                // Rebuilt from `RenderClouds` after a lost device.
                .init_gpu_resource::<GpuScenes>()
                .init_gpu_resource::<DeviceServes>()
                .add_systems(ExtractSchedule, (extract::extract_clouds, extract::extract_next_scenes))
                .add_systems(
                    Render,
                    (upload_scenes.run_if(device_serves), device::refuse_scenes)
                        .in_set(RenderSystems::PrepareResources),
                );
        }
    }
}
