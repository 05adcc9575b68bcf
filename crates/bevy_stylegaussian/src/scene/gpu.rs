//! Scenes on the GPU: one per asset, however many entities show it.

use std::sync::Arc;

use bevy::{
    prelude::*,
    render::{renderer::RenderDevice, sync_world::MainEntityHashSet},
};
use stylegaussian::work::{Canceled, Work};
use stylegaussian_gpu::splat::GpuScene;

use crate::{
    reports::Reports,
    work::{Background, Lane, SynchronousCompilation, Workers},
};

use super::{
    asset::GaussianScene,
    attach::LoadedScene,
    extract::{NextScenes, RenderClouds},
    failure::{GaussianSceneError, SceneRefused},
    per_scene::PerScene,
};

/// The scenes on the GPU.
#[derive(Resource, Default)]
pub(crate) struct GpuScenes {
    of_scene: PerScene<UploadedScene>,
    /// Whether all scenes are uploaded. False on a new device and while a scene is being packed.
    settled: bool,
}

/// A scene that is on the GPU or on its way there.
struct UploadedScene {
    asset: GaussianScene,
    /// The scene, or the reason why the device cannot take it.
    gpu: Background<Result<GpuScene, String>>,
    /// Entities for which the refusal was reported.
    reported: MainEntityHashSet,
}

impl GpuScenes {
    /// A scene on the GPU, or `None` if it is not there yet or too large.
    pub(crate) fn get(&self, scene: &LoadedScene) -> Option<&GpuScene> {
        self.of_scene.get(scene)?.gpu.get()?.as_ref().ok()
    }
}

impl Drop for UploadedScene {
    fn drop(&mut self) {
        // Nobody shows it any more, or the device is lost.
        self.asset.set_on_gpu(false);
    }
}

/// Uploads new scenes and frees those that no entity shows.
///
/// Packing millions of Gaussians takes longer than a frame, so it runs in the background.
pub(crate) fn upload_scenes(
    clouds: Res<RenderClouds>,
    next: Res<NextScenes>,
    mut scenes: ResMut<GpuScenes>,
    synchronous: Res<SynchronousCompilation>,
    workers: Res<Workers>,
    device: Res<RenderDevice>,
    reports: Res<Reports<SceneRefused>>,
) {
    if scenes.settled && !clouds.is_changed() && !next.is_changed() {
        return;
    }
    let scenes = &mut *scenes;
    scenes.settled = true;
    // Also drops data that a changed asset has replaced. A task that still packs it is canceled.
    let shown = clouds.0.values().map(|cloud| &cloud.scene);
    scenes.of_scene.retain(shown.chain(&next.0), |_| true);
    let entities = clouds.0.iter().map(|(&entity, cloud)| (Some(entity), &cloud.scene));
    for (entity, shown) in entities.chain(next.0.iter().map(|scene| (None, scene))) {
        let uploaded = scenes.of_scene.get_or_insert_with(shown, || {
            let (device, scene) = (device.wgpu_device().clone(), Arc::clone(shown.scene()));
            // Buffers are mapped when they are created, so packing and upload need no queue and both run in the
            // task.
            let upload = move |work: &Work| -> Result<Result<GpuScene, String>, Canceled> {
                let uploaded = GpuScene::new_if_wanted(&device, &scene, work)?;
                Ok(uploaded.map_err(|error| error.to_string()))
            };
            UploadedScene {
                asset: shown.asset.clone(),
                gpu: match synchronous.0 {
                    true => match upload(&Work::default()) {
                        Ok(uploaded) => Background::Ready(uploaded),
                        Err(Canceled) => Background::Ready(Err(Canceled.to_string())),
                    },
                    false => Background::Building(workers.start(Lane::Scenes, upload)),
                },
                reported: MainEntityHashSet::default(),
            }
        });
        match uploaded.gpu.get() {
            None => scenes.settled = false,
            Some(Ok(_)) => uploaded.asset.set_on_gpu(true),
            Some(Err(reason)) => {
                uploaded.asset.set_refused();
                // An entity that shows the scene later hears of the refusal too, and each one hears of it once.
                if let Some(entity) = entity.filter(|entity| uploaded.reported.insert(*entity)) {
                    let error = GaussianSceneError::Gpu(reason.clone());
                    reports.push(SceneRefused { entity: entity.id(), error });
                }
            }
        }
    }
}
