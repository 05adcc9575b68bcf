//! Scenes on the GPU: one for each scene that is shown, however many entities show it.

use std::sync::Arc;

use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{renderer::RenderDevice, sync_world::MainEntityHashSet},
};
use stylegaussian::Scene;
use stylegaussian_gpu::splat::GpuScene;

use crate::{
    pipeline::{AtOnce, Built},
    style::{GpuReport, GpuReports},
};

use super::extract::RenderClouds;

/// The scenes on the GPU, by the address of the shared copy in main memory, which each entry keeps alive.
#[derive(Resource, Default)]
pub(crate) struct GpuScenes {
    of_scene: HashMap<usize, Uploaded>,
    /// Whether nothing is left to do; not on a new device, nor while a scene is being packed.
    settled: bool,
}

struct Uploaded {
    scene: Arc<Scene>,
    /// Or why the device cannot take it.
    gpu: Built<Result<GpuScene, String>>,
    /// The entities that were told so.
    told: MainEntityHashSet,
}

impl GpuScenes {
    /// A scene on the GPU, unless it is on its way there or too large.
    pub(crate) fn get(&self, scene: &Arc<Scene>) -> Option<&GpuScene> {
        self.of_scene.get(&address(scene))?.gpu.get()?.as_ref().ok()
    }
}

fn address(scene: &Arc<Scene>) -> usize {
    Arc::as_ptr(scene).addr()
}

/// Uploads scenes that are new, and lets go of those that no entity shows.
///
/// Packing millions of Gaussians takes longer than a frame and happens in the background.
pub(super) fn prepare_scenes(
    clouds: Res<RenderClouds>,
    mut scenes: ResMut<GpuScenes>,
    at_once: Res<AtOnce>,
    device: Res<RenderDevice>,
    reports: Res<GpuReports>,
) {
    if scenes.settled && !clouds.is_changed() {
        return;
    }
    let scenes = &mut *scenes;
    scenes.settled = true;
    let is_shown = |scene: &Arc<Scene>| clouds.0.values().any(|cloud| Arc::ptr_eq(&cloud.scene, scene));
    scenes.of_scene.retain(|_, uploaded| is_shown(&uploaded.scene));
    for (&entity, cloud) in &clouds.0 {
        let uploaded = scenes.of_scene.entry(address(&cloud.scene)).or_insert_with(|| {
            let (device, scene) = (device.wgpu_device().clone(), Arc::clone(&cloud.scene));
            let upload = move || GpuScene::new(&device, &scene).map_err(|error| error.to_string());
            let gpu = Built::start(at_once.0, upload);
            Uploaded { scene: Arc::clone(&cloud.scene), gpu, told: MainEntityHashSet::default() }
        });
        match uploaded.gpu.poll() {
            None => scenes.settled = false,
            Some(Ok(_)) => {}
            Some(Err(reason)) => {
                if uploaded.told.insert(entity) {
                    reports.push(GpuReport::SceneRefused { entity: entity.id(), reason: reason.clone() });
                }
            }
        }
    }
}
