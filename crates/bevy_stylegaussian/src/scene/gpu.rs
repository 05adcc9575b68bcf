//! Scenes on the GPU: one per asset, however many entities show it.

use std::sync::Arc;

use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{renderer::RenderDevice, sync_world::MainEntityHashSet},
};
use stylegaussian::Scene;
use stylegaussian_gpu::splat::GpuScene;

use crate::{
    background::{Background, SynchronousCompilation},
    reports::Reports,
};

use super::{GaussianScene, GaussianSceneError, LoadedScene, RenderClouds, SceneRefused};

/// The scenes on the GPU, by asset.
#[derive(Resource, Default)]
pub(crate) struct GpuScenes {
    of_asset: HashMap<AssetId<GaussianScene>, UploadedScene>,
    /// Whether all scenes are uploaded. False on a new device and while a scene is being packed.
    settled: bool,
}

/// A scene that is on the GPU or on its way there.
struct UploadedScene {
    /// The data that was uploaded. An asset that changes keeps its id and gets new data.
    scene: Arc<Scene>,
    /// The scene, or the reason why the device cannot take it.
    gpu: Background<Result<GpuScene, String>>,
    /// Entities for which the refusal was reported.
    reported: MainEntityHashSet,
}

impl GpuScenes {
    /// A scene on the GPU, or `None` if it is not there yet or too large.
    pub(crate) fn get(&self, scene: &LoadedScene) -> Option<&GpuScene> {
        let uploaded = self.of_asset.get(&scene.id)?;
        // Between a change of the asset and the next upload, the buffers are of the old data.
        if uploaded.is_of(scene) { uploaded.gpu.get()?.as_ref().ok() } else { None }
    }
}

impl UploadedScene {
    fn is_of(&self, scene: &LoadedScene) -> bool {
        Arc::ptr_eq(&self.scene, scene.scene())
    }
}

/// Uploads new scenes and frees those that no entity shows.
///
/// Packing millions of Gaussians takes longer than a frame, so it runs in the background.
pub(crate) fn upload_scenes(
    clouds: Res<RenderClouds>,
    mut scenes: ResMut<GpuScenes>,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
    reports: Res<Reports<SceneRefused>>,
) {
    if scenes.settled && !clouds.is_changed() {
        return;
    }
    let scenes = &mut *scenes;
    scenes.settled = true;
    // Also drops data that a changed asset has replaced. A task that still packs it is canceled.
    scenes.of_asset.retain(|&id, uploaded| {
        clouds.0.values().any(|cloud| cloud.scene.id == id && uploaded.is_of(&cloud.scene))
    });
    for (&entity, cloud) in &clouds.0 {
        let uploaded = scenes.of_asset.entry(cloud.scene.id).or_insert_with(|| {
            let (device, scene) = (device.wgpu_device().clone(), Arc::clone(cloud.scene.scene()));
            // Buffers are mapped when they are created, so packing and upload need no queue and both run in the
            // task.
            let upload = move || GpuScene::new(&device, &scene).map_err(|error| error.to_string());
            UploadedScene {
                scene: Arc::clone(cloud.scene.scene()),
                gpu: Background::start(*synchronous, upload),
                reported: MainEntityHashSet::default(),
            }
        });
        match uploaded.gpu.poll() {
            None => scenes.settled = false,
            Some(Ok(_)) => {}
            Some(Err(reason)) => {
                // An entity that shows the scene later hears of the refusal too, and each one hears of it once.
                if uploaded.reported.insert(entity) {
                    let error = GaussianSceneError::Gpu(reason.clone());
                    reports.push(SceneRefused { entity: entity.id(), error });
                }
            }
        }
    }
}
