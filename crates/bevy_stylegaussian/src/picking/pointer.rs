//! A backend of `bevy_picking`.

use bevy::{
    camera::visibility::RenderLayers,
    picking::{
        PickingSystems,
        backend::{HitData, PointerHits, ray::RayMap},
    },
    prelude::*,
};

use super::{SplatHit, SplatRayCast};

#[cfg(test)]
mod tests;

/// Adds pointer events to splats: `Pointer<Over>`, `Pointer<Click>` and Bevy's others, for observers.
///
/// A hit's `HitData` has the position in world space, an estimate of the normal, and the distance from the
/// camera's near plane along the ray as its depth. Its extra data is the [`SplatHit`], with the Gaussian's
/// index in the file that the scene was read from:
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::picking::SplatHit;
/// fn clicked(click: On<Pointer<Click>>) {
///     if let Some(hit) = click.hit.extra_as::<SplatHit>() {
///         info!("Gaussian {} at {}", hit.source_gaussian, hit.position);
///     }
/// }
/// ```
///
/// Add it after `DefaultPlugins` and [`StyleGaussianPlugin`](crate::StyleGaussianPlugin). Every entity with
/// splats can be picked; `Pickable` on the entity chooses otherwise, as do render layers. Rays are those of
/// [`SplatRayCast`]: a scene is indexed in the background when the first pointer is over a camera, and pointers
/// pass it until then.
#[derive(Clone, Copy, Debug, Default)]
pub struct SplatPickingPlugin;

impl Plugin for SplatPickingPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<SplatPickingSettings>()
            .register_type::<SplatPickingSettings>()
            .register_type::<SplatPickingCamera>()
            .add_systems(PreUpdate, send_hits.in_set(PickingSystems::Backend));
    }
}

/// Settings of [`SplatPickingPlugin`], as Bevy's `MeshPickingSettings`.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Resource, Clone, Debug, Default, PartialEq)]
pub struct SplatPickingSettings {
    /// If true, only cameras with [`SplatPickingCamera`] and entities with `Pickable` take part.
    pub require_markers: bool,
}

/// Marks cameras whose pointers pick splats, if [`SplatPickingSettings::require_markers`] is set.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SplatPickingCamera;

/// Sends the hits of each pointer on each camera. Which of them count is up to `bevy_picking`, by the cameras'
/// order, the depth, and whether an entity blocks those behind it.
fn send_hits(
    settings: Res<SplatPickingSettings>,
    pointer_rays: Res<RayMap>,
    cameras: Query<(&Camera, Has<SplatPickingCamera>, Option<&RenderLayers>)>,
    entities: Query<(Option<&Pickable>, Option<&RenderLayers>)>,
    mut rays: SplatRayCast,
    mut sent: MessageWriter<PointerHits>,
) {
    let marked = settings.require_markers;
    for (id, ray) in pointer_rays.iter() {
        let Ok((camera, is_marked, layers)) = cameras.get(id.camera) else { continue };
        if marked && !is_marked {
            continue;
        }
        let is_picked = |entity| {
            let Ok((pickable, own_layers)) = entities.get(entity) else { return false };
            let is_pickable = pickable.map_or(!marked, |pickable| pickable.is_hoverable);
            // Both are on layer 0 if they do not say.
            let zero = RenderLayers::default();
            is_pickable && layers.unwrap_or(&zero).intersects(own_layers.unwrap_or(&zero))
        };
        let picks: Vec<_> =
            rays.hits(*ray, is_picked).map(|hit| (hit.entity, hit_data(id.camera, hit))).collect();
        if !picks.is_empty() {
            sent.write(PointerHits::new(id.pointer, picks, camera.order as f32));
        }
    }
}

fn hit_data(camera: Entity, hit: SplatHit) -> HitData {
    HitData::new_with_extra(camera, hit.distance, Some(hit.position), Some(hit.normal), hit)
}
