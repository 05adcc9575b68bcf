//! Bevy's `DistanceFog`, its `Atmosphere` and its lights, as splats see them.

use bevy::{
    camera::visibility::RenderLayers,
    ecs::system::SystemParam,
    light::spot_light_world_from_view,
    math::{Affine3A, DAffine3, DVec3},
    pbr::{
        DistanceFog, ExtractedAtmosphere, ExtractedDirectionalLight, ExtractedPointLight, FogFalloff,
        GlobalClusterableObjectMeta, GpuAtmosphereSettings, ViewShadowBindings,
        resources::AtmosphereTextures,
    },
    prelude::*,
    render::{
        camera::ExtractedCamera,
        renderer::{RenderDevice, ViewQuery},
        view::{ExtractedView, RetainedViewEntity},
    },
};
use stylegaussian::light::{Atmosphere, Cone, Falloff, Fog, MAX_LAMPS, ShadowCascade, ShadowLamp, Sun};
use stylegaussian_gpu::splat::{AerialPerspective, Shadows};

use crate::commands::GpuCommands;

use super::{pipelines::SplatPipelines, view::SplatViews};

/// The fog and the shadow maps of a camera in the render world.
pub(super) type CameraAir = (Option<&'static DistanceFog>, Option<&'static ViewShadowBindings>);

/// The same of one camera.
type AirOf<'a> = (Option<&'a DistanceFog>, Option<&'a ViewShadowBindings>);

/// The game's lights.
#[derive(SystemParam)]
pub(super) struct GameLights<'w, 's> {
    suns: Query<'w, 's, (Entity, &'static ExtractedDirectionalLight, Option<&'static RenderLayers>)>,
    /// Point lights and spot lights.
    lamps: Query<'w, 's, (Entity, &'static ExtractedPointLight, Option<&'static RenderLayers>)>,
    /// The order of the lamps, by which their maps are numbered.
    meta: Option<Res<'w, GlobalClusterableObjectMeta>>,
}

impl GameLights<'_, '_> {
    /// The directional lights on the layers of a camera.
    fn on(
        &self,
        layers: Option<&RenderLayers>,
    ) -> impl Iterator<Item = (Entity, &ExtractedDirectionalLight)> {
        let layers = layers.cloned().unwrap_or_default();
        let lights =
            self.suns.iter().filter(move |(_, _, of_light)| of_light.unwrap_or_default().intersects(&layers));
        lights.map(|(entity, light, _)| (entity, light))
    }

    /// The shadow maps for a camera at `eye`: of the first directional light that has any, and of the nearest
    /// lamps. `None` if there are none.
    pub(super) fn shadows(
        &self,
        (_, maps): AirOf,
        layers: Option<&RenderLayers>,
        camera: Entity,
        eye: Vec3,
    ) -> Option<Shadows> {
        let maps = maps?;
        let cascades = self.cascades(layers, camera).unwrap_or_default();
        let lamps = self.lamps(maps, layers, eye);
        if cascades.is_empty() && lamps.is_empty() {
            return None;
        }
        Some(Shadows {
            maps: (*maps.directional_light_depth_texture_view).clone(),
            cubes: (*maps.point_light_depth_texture_view).clone(),
            cascades,
            lamps,
        })
    }

    /// The cascades of the first directional light that has any, for this camera.
    fn cascades(&self, layers: Option<&RenderLayers>, camera: Entity) -> Option<Vec<ShadowCascade>> {
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
        Some(cascades.collect())
    }

    /// The lamps with shadow maps that are nearest to `eye`.
    fn lamps(&self, maps: &ViewShadowBindings, layers: Option<&RenderLayers>, eye: Vec3) -> Vec<ShadowLamp> {
        let Some(meta) = &self.meta else { return Vec::new() };
        let is_spot = |light: &ExtractedPointLight| light.spot_light_angles.is_some();
        let n_points = self.lamps.iter().filter(|(_, light, _)| !is_spot(light)).count();
        let n_spots =
            self.lamps.iter().filter(|(_, light, _)| is_spot(light) && light.shadow_maps_enabled).count();
        // Layers of cascades come first, and cubes have six.
        let n_layers = maps.directional_light_depth_texture.depth_or_array_layers() as usize;
        let n_cubes = maps.point_light_depth_texture.depth_or_array_layers() as usize / 6;
        let first_layer = n_layers.saturating_sub(n_spots);
        let layers = layers.cloned().unwrap_or_default();
        let mut lamps = Vec::new();
        for (entity, light, of_light) in &self.lamps {
            if !light.shadow_maps_enabled || !of_light.unwrap_or_default().intersects(&layers) {
                continue;
            }
            // Bevy's lists have point lights before spot lights, and those with maps before the others.
            let Some(&index) = meta.entity_to_index.get(&entity) else { continue };
            let (map, n_maps) = match is_spot(light) {
                false => (index, n_cubes),
                true => (first_layer + index.saturating_sub(n_points), n_layers),
            };
            if map >= n_maps {
                continue;
            }
            let at = light.transform.translation();
            // The maps of point lights have the axes of the world.
            let world_from_light = match is_spot(light) {
                false => Affine3A::from_translation(at),
                true => spot_light_world_from_view(&light.transform),
            };
            let lamp = ShadowLamp {
                light_from_point: world_from_light.inverse(),
                range: light.range,
                near: light.shadow_map_near_z,
                depth_bias: light.shadow_depth_bias,
                normal_bias: light.shadow_normal_bias,
                cone: light.spot_light_angles.map(|(inner, outer)| Cone { inner, outer }),
                map: map as u32,
            };
            lamps.push((at.distance_squared(eye), entity, lamp));
        }
        lamps.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        lamps.truncate(MAX_LAMPS);
        lamps.into_iter().map(|(_, _, lamp)| lamp).collect()
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

/// A camera in an atmosphere.
type AerialCamera = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static ExtractedAtmosphere,
    &'static GpuAtmosphereSettings,
    &'static AtmosphereTextures,
);

/// The cameras in Bevy's atmospheres.
#[derive(SystemParam)]
pub(super) struct Atmospheres<'w, 's> {
    cameras: Query<'w, 's, AerialCamera>,
    device: Res<'w, RenderDevice>,
}

/// Least height of an eye above the ground, in meters, as in the shaders of Bevy's atmosphere.
const LEAST_ALTITUDE: f64 = 1.0;

impl Atmospheres<'_, '_> {
    /// The atmosphere before a view, if its camera is in one. Bevy may give it other textures in each frame,
    /// and has done so once resources are prepared.
    pub(super) fn of(&self, view: &RetainedViewEntity) -> Option<AerialPerspective> {
        let (view, camera, planet, settings, tables) =
            self.cameras.iter().find(|(camera, ..)| camera.retained_view_entity == *view)?;
        // In f64: the planet's center is far away, and its ground is near.
        let atmosphere_from_world = DAffine3::from_mat4(planet.world_to_atmosphere.as_dmat4());
        let world_from_view = view.world_from_view.affine();
        let turn = Mat3::from(world_from_view.matrix3).as_dmat3();
        let eye = atmosphere_from_world.transform_point3(view.world_from_view.translation().as_dvec3());
        let altitude = (eye.length() - f64::from(planet.inner_radius)).max(LEAST_ALTITUDE);
        // Rigid, so its inverse is its transpose.
        let up = turn.transpose() * eye.normalize_or(DVec3::Y);
        let can_blend_channels = self.device.features().contains(wgpu::Features::DUAL_SOURCE_BLENDING);
        let atmosphere = Atmosphere {
            inner_radius: planet.inner_radius,
            thickness: planet.outer_radius - planet.inner_radius,
            altitude: altitude as f32,
            up: up.as_vec3(),
            meters_from_view: (atmosphere_from_world.matrix3 * turn).as_mat3(),
            clip_from_view: view.clip_from_view,
            max_distance: settings.aerial_view_lut_max_distance,
            n_slices: settings.aerial_view_lut_size.z,
            exposure: camera.exposure,
            // As Bevy does for meshes.
            is_gray: !can_blend_channels,
        };
        Some(AerialPerspective {
            atmosphere,
            light: (*tables.aerial_view_lut.default_view).clone(),
            transmittance: (*tables.transmittance_lut.default_view).clone(),
        })
    }
}

/// Lights the splats of a camera in an atmosphere. Bevy makes its tables after the prepass, in which splats are
/// sorted, and before the main pass, in which they are drawn.
pub(super) fn light_in_atmosphere(
    view: ViewQuery<&ExtractedView, With<AtmosphereTextures>>,
    mut views: ResMut<SplatViews>,
    pipelines: Res<SplatPipelines>,
    mut gpu: GpuCommands,
) {
    let key = view.into_inner().retained_view_entity;
    let Some(splats) = views.get_mut(&key).filter(|splats| splats.plan.is_some()) else { return };
    let Some(passes) = pipelines.passes() else { return };
    gpu.timed(splats.span("splat_light"), |gpu| {
        passes.splat.light_in_atmosphere(gpu.device, gpu.encoder, &mut splats.buffers);
    });
}
