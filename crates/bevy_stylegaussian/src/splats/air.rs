//! Bevy's `DistanceFog` and its directional lights, as splats see them.

use bevy::{
    camera::visibility::RenderLayers,
    ecs::system::SystemParam,
    pbr::{DistanceFog, ExtractedDirectionalLight, FogFalloff, ViewShadowBindings},
    prelude::*,
};
use stylegaussian::light::{Falloff, Fog, ShadowCascade, Sun};
use stylegaussian_gpu::splat::Shadows;

/// The fog and the shadow maps of a camera in the render world.
pub(super) type CameraAir = (Option<&'static DistanceFog>, Option<&'static ViewShadowBindings>);

/// The same of one camera.
type AirOf<'a> = (Option<&'a DistanceFog>, Option<&'a ViewShadowBindings>);

/// The game's directional lights.
#[derive(SystemParam)]
pub(super) struct Suns<'w, 's>(
    Query<'w, 's, (Entity, &'static ExtractedDirectionalLight, Option<&'static RenderLayers>)>,
);

impl Suns<'_, '_> {
    /// Those on the layers of a camera.
    fn on(
        &self,
        layers: Option<&RenderLayers>,
    ) -> impl Iterator<Item = (Entity, &ExtractedDirectionalLight)> {
        let layers = layers.cloned().unwrap_or_default();
        let lights =
            self.0.iter().filter(move |(_, _, of_light)| of_light.unwrap_or_default().intersects(&layers));
        lights.map(|(entity, light, _)| (entity, light))
    }

    /// The shadow maps of the first light that has any, for this camera.
    pub(super) fn shadows(
        &self,
        (_, maps): AirOf,
        layers: Option<&RenderLayers>,
        camera: Entity,
    ) -> Option<Shadows> {
        let maps = maps?;
        // The order in which Bevy gives lights layers of its texture, so that this one has the first layers.
        let with_maps = self.on(layers).filter(|(_, light)| light.shadow_maps_enabled);
        let (_, light) = with_maps.min_by_key(|(entity, light)| (light.volumetric, *entity))?;
        let to_light: Vec3 = light.transform.back().into();
        let bounds = &light.cascade_shadow_config.bounds;
        let cascades = light.cascades.get(&camera)?.iter().zip(bounds);
        let cascades = cascades.map(|(cascade, &far)| ShadowCascade {
            clip_from_point: cascade.clip_from_world,
            // Splats have no normal, so both biases lead to the light.
            offset: to_light * (light.shadow_depth_bias + light.shadow_normal_bias * cascade.texel_size),
            far,
        });
        let maps = (*maps.directional_light_depth_texture_view).clone();
        Some(Shadows { maps, cascades: cascades.collect() })
    }

    /// The fog of a camera on these layers. `exposure` is the factor of light by Bevy's `Exposure`.
    pub(super) fn fog(&self, (fog, _): AirOf, layers: Option<&RenderLayers>, exposure: f32) -> Option<Fog> {
        let fog = fog?;
        let color = fog.color.to_linear();
        let glow = fog.directional_light_color.to_linear();
        // As the shader of Bevy's fog, which leaves it out if alpha is not above 0.
        let suns = self.on(layers).filter(|_| glow.alpha > 0.0).map(|(_, light)| Sun {
            direction: light.transform.back().into(),
            glow: light.color.to_vec3() * glow.to_vec3() * (light.illuminance * exposure * glow.alpha),
        });
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
