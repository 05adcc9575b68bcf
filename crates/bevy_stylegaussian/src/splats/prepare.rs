//! Scenes on the GPU: one for each scene that is shown, however many entities show it.

use std::sync::Arc;

use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{renderer::RenderDevice, sync_world::MainEntityHashSet},
};
use stylegaussian::Scene;
use stylegaussian_gpu::scene::GpuScene;

use crate::style::{GpuReport, GpuReports};

use super::extract::RenderClouds;

/// The scenes on the GPU, by the address of the shared copy in main memory, which each entry keeps alive.
#[derive(Resource, Default)]
pub(crate) struct GpuScenes {
    of_scene: HashMap<usize, Uploaded>,
    /// Whether it was filled before; a new device starts with nothing.
    filled: bool,
}

struct Uploaded {
    scene: Arc<Scene>,
    /// Or why the device cannot take it.
    gpu: Result<GpuScene, String>,
    /// The entities that were told so.
    told: MainEntityHashSet,
}

impl GpuScenes {
    /// A scene on the GPU, unless it is too large for it.
    pub(crate) fn get(&self, scene: &Arc<Scene>) -> Option<&GpuScene> {
        self.of_scene.get(&address(scene))?.gpu.as_ref().ok()
    }
}

fn address(scene: &Arc<Scene>) -> usize {
    Arc::as_ptr(scene).addr()
}

/// Uploads scenes that are new, and lets go of those that no entity shows.
pub(super) fn prepare_scenes(
    clouds: Res<RenderClouds>,
    mut scenes: ResMut<GpuScenes>,
    device: Res<RenderDevice>,
    reports: Res<GpuReports>,
) {
    if scenes.filled && !clouds.is_changed() {
        return;
    }
    let scenes = &mut *scenes;
    scenes.filled = true;
    // The map's own reference is the only one left of a scene that nobody shows and no asset holds; an asset's scene
    // that nobody shows is let go of too.
    scenes
        .of_scene
        .retain(|_, uploaded| clouds.0.values().any(|cloud| Arc::ptr_eq(&cloud.scene, &uploaded.scene)));
    for (&entity, cloud) in &clouds.0 {
        let uploaded = scenes.of_scene.entry(address(&cloud.scene)).or_insert_with(|| Uploaded {
            scene: Arc::clone(&cloud.scene),
            gpu: GpuScene::new(device.wgpu_device(), &cloud.scene).map_err(|error| error.to_string()),
            told: MainEntityHashSet::default(),
        });
        if let Err(reason) = &uploaded.gpu
            && uploaded.told.insert(entity)
        {
            reports.push(GpuReport::SceneRefused { entity: entity.id(), reason: reason.clone() });
        }
    }
}
