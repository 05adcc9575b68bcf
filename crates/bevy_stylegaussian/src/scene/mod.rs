//! Scenes: the asset [`GaussianScene`], the component [`GaussianSplats`] that shows it,
//! [`FitScene`] that places it, the [`SceneSettings`] of loading it, and what a GPU needs to draw it.
//!
//! An entity gets a [`GaussianSceneReady`](crate::GaussianSceneReady) once its scene can be drawn, or a
//! [`GaussianSceneFailed`].

// This is the bottom room: it imports no other room. `PostUpdate` attaches loaded scenes to entities
// (`attach`), the extraction copies them to the render world (`extract`), and there they are uploaded (`gpu`).

use bevy::{
    asset::AssetEventSystems,
    camera::visibility::VisibilitySystems,
    prelude::*,
    render::{ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems},
    window::RequestRedraw,
};

use crate::{reports::Reports, systems::StyleGaussianSystems};

mod asset;
mod attach;
mod component;
mod device;
mod extract;
mod failure;
mod fit;
mod frames;
mod gpu;
mod loader;
mod per_scene;
mod progress;

pub use asset::GaussianScene;
pub use component::{GaussianSplats, WorldPart};
pub use failure::{GaussianSceneError, GaussianSceneFailed};
pub use fit::FitScene;
pub use loader::SceneSettings;
pub use progress::{SceneProgress, SceneReadings};
/// The limits that a GPU must have: [`NEEDS`](gpu_needs::NEEDS). On a GPU without them, the app goes on and no
/// splats are drawn: each of their entities gets a [`GaussianSceneFailed`], and the log has one error.
pub use stylegaussian_gpu::needs as gpu_needs;

pub(crate) use attach::{LoadedScene, NextScene, UploadsInBackground};
pub(crate) use device::{DeviceServes, device_serves};
use extract::NextScenes;
pub(crate) use extract::RenderClouds;
pub(crate) use failure::SceneRefused;
pub(crate) use gpu::{GpuScenes, upload_scenes};
use loader::SceneLoader;
pub(crate) use loader::beside;
pub(crate) use per_scene::PerScene;

/// Loads scenes and uploads them.
pub(crate) struct ScenePlugin;

impl Plugin for ScenePlugin {
    fn build(&self, app: &mut App) {
        let reports = Reports::<SceneRefused>::default();
        app.init_asset::<GaussianScene>()
            .init_resource::<progress::SceneReadings>()
            .init_asset_loader::<SceneLoader>()
            .insert_resource(reports.clone())
            .add_message::<GaussianSceneFailed>()
            .register_type::<GaussianScene>()
            .register_type::<GaussianSplats>()
            .register_type::<FitScene>()
            .register_type::<SceneProgress>()
            .register_type::<GaussianSceneFailed>()
            // `WindowPlugin` adds it too, but not every app has one.
            .add_message::<RequestRedraw>()
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
            )
            .add_systems(
                PostUpdate,
                fit::fit_scenes.after(StyleGaussianSystems::Scenes).before(TransformSystems::Propagate),
            )
            .add_systems(
                PostUpdate,
                (progress::report_progress, progress::forget_progress).after(StyleGaussianSystems::Scenes),
            )
            .add_systems(PostUpdate, frames::ask_for_frames.after(StyleGaussianSystems::Scenes));
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
