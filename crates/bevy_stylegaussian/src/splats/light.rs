//! Light and air of splats: the tints of entities, shadows on them, and the fog of cameras.
//!
//! Views without either have nothing of it: no pipeline, no buffer, no dispatch.

use bevy::{
    camera::visibility::RenderLayers,
    core_pipeline::tonemapping::Tonemapping,
    ecs::system::SystemParam,
    platform::collections::HashMap,
    prelude::*,
    render::{
        Extract,
        camera::ExtractedCamera,
        renderer::{RenderDevice, RenderQueue},
        sync_world::{MainEntity, MainEntityHashMap},
        view::{ExtractedView, RetainedViewEntity},
    },
};
use stylegaussian::light::Tint;
use stylegaussian_gpu::splat::{self, ViewLight};

use crate::work::SynchronousCompilation;

use super::{
    air::{CameraAir, GameLights},
    pipelines::{Luts, SplatPipelines},
    view,
};

/// Changes the colors of a [`GaussianSplats`](crate::GaussianSplats) in the same frame: darker at night, redder
/// in the evening, gray where life has gone. A component of the entity, beside any style.
///
/// It works on linear light, before the exposure and the tone mapping of the camera: first the saturation, then
/// the color, then the exposure. So it changes splats as another lamp changes an unlit mesh. Numbers that are
/// not finite change nothing. Strokes lose or gain contrast with the colors below them.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::SplatTint;
/// # fn system(mut commands: Commands, garden: Entity) {
/// let dusk = SplatTint { color: Color::srgb(1.0, 0.7, 0.5), exposure: -1.5, ..default() };
/// commands.entity(garden).insert(dusk);
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SplatTint {
    /// Factors of red, green and blue, as a linear color. White, the default, changes nothing; alpha is not
    /// used.
    pub color: Color,
    /// Brightening in stops: 1 doubles the light, -1 halves it.
    pub exposure: f32,
    /// Distance from gray: 0 is gray, 1, the default, as it is, 2 twice as colorful.
    pub saturation: f32,
}

impl Default for SplatTint {
    fn default() -> Self {
        Self { color: Color::WHITE, exposure: 0.0, saturation: 1.0 }
    }
}

impl From<SplatTint> for Tint {
    fn from(tint: SplatTint) -> Self {
        let color = tint.color.to_linear().to_vec3();
        Self { color, exposure: tint.exposure, saturation: tint.saturation }
    }
}

/// Lets shadows fall on a [`GaussianSplats`](crate::GaussianSplats): splats in the shadow of meshes, and of
/// splats with [`SplatCaster`](crate::SplatCaster), become darker, as a whole each. A component of the entity;
/// without it, splats stay as they were captured. It needs the feature `pbr`.
///
/// Shadows of the game's first directional light with shadow maps fall, and those of the eight spot lights and
/// point lights with shadow maps that are nearest to the camera. A lamp lights no capture, so its shadow takes
/// the same share everywhere, and fades where the lamp's range and its cone end. The capture has shadows of its
/// own, which stay.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::SplatShadows;
/// # fn system(mut commands: Commands, garden: Entity) {
/// commands.entity(garden).insert(SplatShadows { amount: 0.6 });
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SplatShadows {
    /// Share of its linear light that a splat loses in shadow, 0 to 1; 0.5 by default.
    pub amount: f32,
}

impl Default for SplatShadows {
    fn default() -> Self {
        Self { amount: 0.5 }
    }
}

/// The light on all entities that have a tint or receive shadows.
#[derive(Resource, Default)]
pub(super) struct CloudLights(MainEntityHashMap<CloudLight>);

/// The light on an entity.
#[derive(Clone, Copy, Default)]
struct CloudLight {
    tint: Tint,
    shadow_amount: f32,
}

/// An entity, and its components for light.
type Lit = (Entity, Option<&'static SplatTint>, Option<&'static SplatShadows>);

/// Entities that have any.
type IsLit = Or<(With<SplatTint>, With<SplatShadows>)>;

/// Copies the light on entities.
pub(super) fn extract_cloud_lights(mut clouds: ResMut<CloudLights>, all: Extract<Query<Lit, IsLit>>) {
    clouds.0.clear();
    clouds.0.extend(all.iter().map(|(entity, tint, shadows)| {
        let tint = tint.copied().map(Tint::from).unwrap_or_default();
        let shadow_amount = shadows.map_or(0.0, |shadows| shadows.amount);
        (MainEntity::from(entity), CloudLight { tint, shadow_amount })
    }));
}

/// The light of the views that have any, without what differs between their clouds.
#[derive(Resource, Default)]
pub(super) struct SplatLights(HashMap<RetainedViewEntity, ViewLight>);

/// The components of a camera in the render world that its light depends on.
type LitCamera = (
    Entity,
    &'static ExtractedView,
    &'static ExtractedCamera,
    Option<&'static Tonemapping>,
    Option<&'static RenderLayers>,
    CameraAir,
);

/// Finds the light of each view, and requests its pipelines. Splats are drawn without it until they are there.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn prepare_lights(
    cameras: Query<LitCamera, With<Camera3d>>,
    game: GameLights,
    clouds: Res<CloudLights>,
    mut lights: ResMut<SplatLights>,
    mut pipelines: ResMut<SplatPipelines>,
    luts: Luts,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    lights.0.clear();
    let has_tints = clouds.0.values().any(|cloud| cloud.tint.matrix().is_some());
    let is_shadowed = clouds.0.values().any(|cloud| cloud.shadow_amount > 0.0);
    let device = device.wgpu_device();
    for (entity, extracted, camera, tonemapping, layers, air) in &cameras {
        let fog = game.fog(air, layers, camera.exposure);
        let eye = extracted.world_from_view.translation();
        let shadows = is_shadowed.then(|| game.shadows(air, layers, entity, eye)).flatten();
        if fog.is_none() && shadows.is_none() && !has_tints {
            continue;
        }
        // Without tonemapping, Bevy does not apply the exposure of color grading either.
        let (tonemapping, exposure) = match tonemapping.filter(|tonemapping| tonemapping.is_enabled()) {
            Some(&tonemapping) => (view::method(tonemapping), extracted.color_grading.global.exposure),
            None => (splat::Tonemapping::None, 0.0),
        };
        let is_ready = pipelines.request_light(device, *synchronous, tonemapping, shadows.is_some());
        let has_table = !tonemapping.needs_table()
            || pipelines.request_table(device, &queue, *synchronous, tonemapping, &luts);
        if is_ready && has_table {
            let table = pipelines.table(tonemapping).cloned();
            let light = ViewLight { fog, shadows, tonemapping, exposure, table, ..ViewLight::default() };
            lights.0.insert(extracted.retained_view_entity, light);
        }
    }
}

/// The light of all views and on all clouds.
#[derive(SystemParam)]
pub(super) struct Lights<'w> {
    of_view: Res<'w, SplatLights>,
    clouds: Res<'w, CloudLights>,
}

impl Lights<'_> {
    /// The light of a view that draws these clouds, if it has any.
    pub(super) fn of(&self, view: &RetainedViewEntity, clouds: &[MainEntity]) -> Option<ViewLight> {
        let light = self.of_view.0.get(view)?.clone();
        let lit: Vec<CloudLight> =
            clouds.iter().map(|cloud| self.clouds.0.get(cloud).copied().unwrap_or_default()).collect();
        Some(ViewLight {
            tints: lit.iter().map(|cloud| cloud.tint).collect(),
            shadow_amounts: lit.iter().map(|cloud| cloud.shadow_amount).collect(),
            ..light
        })
    }
}
