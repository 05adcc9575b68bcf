//! No fog, no atmosphere and no shadows: they belong to `bevy_pbr`.

use bevy::{
    camera::visibility::RenderLayers, ecs::system::SystemParam, prelude::*, render::view::RetainedViewEntity,
};
use stylegaussian::light::Fog;
use stylegaussian_gpu::splat::{AerialPerspective, Shadows};

/// Nothing of a camera.
pub(super) type CameraAir = ();

/// No lights.
#[derive(SystemParam)]
pub(super) struct GameLights;

impl GameLights {
    /// None.
    pub(super) fn fog(&self, (): (), _: Option<&RenderLayers>, _: f32) -> Option<Fog> {
        None
    }

    /// None.
    pub(super) fn shadows(&self, (): (), _: Option<&RenderLayers>, _: Entity, _: Vec3) -> Option<Shadows> {
        None
    }
}

/// No cameras in an atmosphere.
#[derive(SystemParam)]
pub(super) struct Atmospheres;

impl Atmospheres {
    /// None.
    pub(super) fn of(&self, _: &RetainedViewEntity) -> Option<AerialPerspective> {
        None
    }
}
