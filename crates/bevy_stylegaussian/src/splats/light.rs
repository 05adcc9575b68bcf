//! Light and air of splats: the tints of entities and of parts of them, shadows on them, and the fog and the
//! atmosphere of cameras.
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
use stylegaussian::light::{Tint, TintVolume};
use stylegaussian_gpu::splat::{self, ViewLight};

use crate::{
    colors::{SplatTint, TintedParts},
    work::SynchronousCompilation,
};

use super::{
    air::{Atmospheres, CameraAir, GameLights},
    pipelines::{Luts, Part, SplatPipelines},
    view,
};

/// Lets shadows fall on a [`GaussianSplats`](crate::GaussianSplats): splats in the shadow of meshes, and of
/// splats with [`SplatCaster`](super::SplatCaster), become darker, as a whole each. A component of the entity;
/// without it, splats stay as they were captured. It needs the feature `pbr`.
///
/// Shadows of the game's first directional light with shadow maps fall, and those of the eight spot lights and
/// point lights with shadow maps that are nearest to the camera. A lamp lights no capture, so its shadow takes
/// the same share everywhere, and fades where the lamp's range and its cone end. The capture has shadows of its
/// own, which stay.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::splats::SplatShadows;
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
pub(super) struct CloudLights {
    of_all: MainEntityHashMap<CloudLight>,
    /// Those that volumes tint in part.
    volumes: MainEntityHashMap<Vec<TintVolume>>,
}

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
pub(super) fn extract_cloud_lights(
    mut clouds: ResMut<CloudLights>,
    all: Extract<Query<Lit, IsLit>>,
    parts: Extract<Res<TintedParts>>,
) {
    clouds.volumes.clear();
    clouds.volumes.extend(parts.0.iter().map(|(&entity, volumes)| (entity.into(), volumes.clone())));
    clouds.of_all.clear();
    clouds.of_all.extend(all.iter().map(|(entity, tint, shadows)| {
        let tint = tint.copied().map(Tint::from).unwrap_or_default();
        let shadow_amount = shadows.map_or(0.0, |shadows| shadows.amount);
        (MainEntity::from(entity), CloudLight { tint, shadow_amount })
    }));
}

/// The light of the views that have any, without what differs between their clouds.
#[derive(Resource, Default)]
pub(super) struct SplatLights(HashMap<RetainedViewEntity, PreparedLight>);

/// The light of a view.
struct PreparedLight {
    /// Without the atmosphere, whose textures are not known yet.
    light: ViewLight,
    /// Whether the camera is in one.
    in_atmosphere: bool,
}

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
    atmospheres: Atmospheres,
    clouds: Res<CloudLights>,
    mut lights: ResMut<SplatLights>,
    mut pipelines: ResMut<SplatPipelines>,
    luts: Luts,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    lights.0.clear();
    let has_tints = clouds.of_all.values().any(|cloud| cloud.tint.matrix().is_some());
    let has_tints = has_tints || !clouds.volumes.is_empty();
    let is_shadowed = clouds.of_all.values().any(|cloud| cloud.shadow_amount > 0.0);
    let device = device.wgpu_device();
    for (entity, extracted, camera, tonemapping, layers, air) in &cameras {
        let fog = game.fog(air, layers, camera.exposure);
        let eye = extracted.world_from_view.translation();
        let shadows = is_shadowed.then(|| game.shadows(air, layers, entity, eye)).flatten();
        let in_atmosphere = atmospheres.of(&extracted.retained_view_entity).is_some();
        if fog.is_none() && shadows.is_none() && !has_tints && !in_atmosphere {
            continue;
        }
        // Without tonemapping, Bevy does not apply the exposure of color grading either.
        let (tonemapping, exposure) = match tonemapping.filter(|tonemapping| tonemapping.is_enabled()) {
            Some(&tonemapping) => (view::method(tonemapping), extracted.color_grading.global.exposure),
            None => (splat::Tonemapping::None, 0.0),
        };
        let part = Part::Light(tonemapping, shadows.is_some(), in_atmosphere);
        let is_ready = pipelines.request_part(device, *synchronous, part);
        let has_table = !tonemapping.needs_table()
            || pipelines.request_table(device, &queue, *synchronous, tonemapping, &luts);
        if is_ready && has_table {
            let table = pipelines.table(tonemapping).cloned();
            let light = ViewLight { fog, shadows, tonemapping, exposure, table, ..ViewLight::default() };
            lights.0.insert(extracted.retained_view_entity, PreparedLight { light, in_atmosphere });
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
    pub(super) fn of(
        &self,
        view: &RetainedViewEntity,
        clouds: &[MainEntity],
        atmospheres: &Atmospheres,
    ) -> Option<ViewLight> {
        let PreparedLight { light, in_atmosphere } = self.of_view.0.get(view)?;
        let lit: Vec<CloudLight> =
            clouds.iter().map(|cloud| self.clouds.of_all.get(cloud).copied().unwrap_or_default()).collect();
        Some(ViewLight {
            aerial: in_atmosphere.then(|| atmospheres.of(view)).flatten(),
            volumes: clouds
                .iter()
                .map(|cloud| self.clouds.volumes.get(cloud).cloned().unwrap_or_default())
                .collect(),
            tints: lit.iter().map(|cloud| cloud.tint).collect(),
            shadow_amounts: lit.iter().map(|cloud| cloud.shadow_amount).collect(),
            ..light.clone()
        })
    }
}
