//! Bevy's `DistanceFog` as splats see it.

use bevy::{
    camera::visibility::RenderLayers,
    ecs::system::SystemParam,
    pbr::{DistanceFog, ExtractedDirectionalLight, FogFalloff},
    prelude::*,
};
use stylegaussian::light::{Falloff, Fog, Sun};

/// The fog of a camera in the render world.
pub(super) type CameraFog = Option<&'static DistanceFog>;

/// The game's directional lights, which make fog glow.
#[derive(SystemParam)]
pub(super) struct Suns<'w, 's>(
    Query<'w, 's, (&'static ExtractedDirectionalLight, Option<&'static RenderLayers>)>,
);

impl Suns<'_, '_> {
    /// The fog of a camera on these layers. `exposure` is the factor of light by Bevy's `Exposure`.
    pub(super) fn fog(
        &self,
        fog: Option<&DistanceFog>,
        layers: Option<&RenderLayers>,
        exposure: f32,
    ) -> Option<Fog> {
        let fog = fog?;
        let color = fog.color.to_linear();
        let glow = fog.directional_light_color.to_linear();
        let layers = layers.unwrap_or_default();
        // As the shader of Bevy's fog, which leaves it out if alpha is not above 0.
        let lights = self.0.iter().filter(|_| glow.alpha > 0.0);
        let suns = lights.filter(|(_, of_light)| of_light.unwrap_or_default().intersects(layers)).map(
            |(light, _)| Sun {
                direction: light.transform.back().into(),
                glow: light.color.to_vec3() * glow.to_vec3() * (light.illuminance * exposure * glow.alpha),
            },
        );
        let falloff = match fog.falloff {
            FogFalloff::Linear { start, end } => Falloff::Linear { start, end },
            FogFalloff::Exponential { density } => Falloff::Exponential { density },
            FogFalloff::ExponentialSquared { density } => Falloff::ExponentialSquared { density },
            FogFalloff::Atmospheric { extinction, inscattering } => {
                Falloff::Atmospheric { extinction, inscattering }
            }
        };
        Some(Fog {
            color: color.to_vec3(),
            strength: color.alpha,
            falloff,
            suns: suns.collect(),
            exponent: fog.directional_light_exponent,
        })
    }
}
