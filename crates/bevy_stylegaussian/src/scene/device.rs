//! The device's limits. On a device that cannot run the kernels, nothing of the plugin is made, scenes are
//! refused, and the rest of the game is drawn.

use bevy::{
    prelude::*,
    render::{
        renderer::RenderDevice,
        sync_world::{MainEntity, MainEntityHashMap},
    },
};
use stylegaussian_gpu::needs::{self, TooWeak};

use super::{
    asset::GaussianScene,
    extract::{NextScenes, RenderClouds},
    failure::{GaussianSceneError, SceneRefused},
};
use crate::reports::Reports;

/// Whether the present device can draw splats. A resource of the render world.
#[derive(Resource)]
pub(crate) struct DeviceServes {
    checked: Result<(), TooWeak>,
    /// The scenes that were refused for their entities.
    refused: MainEntityHashMap<AssetId<GaussianScene>>,
    /// Whether the reason was logged.
    is_logged: bool,
}

impl FromWorld for DeviceServes {
    fn from_world(world: &mut World) -> Self {
        let checked = needs::check(&world.resource::<RenderDevice>().limits());
        Self { checked, refused: MainEntityHashMap::default(), is_logged: false }
    }
}

impl DeviceServes {
    /// Why the device draws no splats, or `None` if it does.
    pub(crate) fn reason(&self) -> Option<&TooWeak> {
        self.checked.as_ref().err()
    }
}

/// A condition of all systems that make something on the device.
pub(crate) fn device_serves(device: Option<Res<DeviceServes>>) -> bool {
    // It is absent until there is a device.
    device.is_some_and(|device| device.reason().is_none())
}

/// Refuses the scenes of all entities, if the device cannot draw splats.
pub(super) fn refuse_scenes(
    clouds: Res<RenderClouds>,
    next: Res<NextScenes>,
    mut device: ResMut<DeviceServes>,
    reports: Res<Reports<SceneRefused>>,
) {
    let DeviceServes { checked: Err(reason), refused, is_logged } = &mut *device else { return };
    // They will never be there, so entities need not wait for them.
    let shown = clouds.0.values().map(|cloud| &cloud.scene);
    next.0.iter().chain(shown).for_each(|scene| scene.asset.set_refused());
    refused.retain(|entity, _| clouds.0.contains_key(entity));
    for (&entity, cloud) in &clouds.0 {
        // Each entity hears of each of its scenes once.
        if refused.insert(entity, cloud.scene.id) == Some(cloud.scene.id) {
            continue;
        }
        if !std::mem::replace(is_logged, true) {
            error!("splats are not drawn: {reason}");
        }
        let error = GaussianSceneError::Device(reason.clone());
        reports.push(SceneRefused { entity: MainEntity::id(&entity), error });
    }
}
