//! No fog: it belongs to `bevy_pbr`.

use bevy::{camera::visibility::RenderLayers, ecs::system::SystemParam};
use stylegaussian::light::Fog;

/// Nothing of a camera.
pub(super) type CameraFog = ();

/// No lights.
#[derive(SystemParam)]
pub(super) struct Suns;

impl Suns {
    /// None.
    pub(super) fn fog(&self, (): (), _: Option<&RenderLayers>, _: f32) -> Option<Fog> {
        None
    }
}
