//! From the main world: what changed about the clouds since the last frame.

use std::{sync::Arc, time::Duration};

use bevy::{
    math::Affine3A,
    prelude::*,
    render::{
        Extract,
        sync_world::{MainEntity, MainEntityHashMap},
    },
};
use stylegaussian::Scene;

use crate::style::{Look, StyleTransition};

use super::CloudScene;

/// All that the render world knows of the clouds, and all that it needs to rebuild its GPU state after a lost device.
#[derive(Resource, Default)]
pub(crate) struct RenderClouds(pub(crate) MainEntityHashMap<RenderCloud>);

/// An entity with splats.
pub(crate) struct RenderCloud {
    pub(crate) scene: Arc<Scene>,
    pub(crate) world_from_scene: Affine3A,
    pub(crate) look: Look,
    /// How long a change of its look takes.
    pub(crate) fade: Duration,
}

/// What a cloud is made of.
type CloudParts =
    (Entity, &'static CloudScene, &'static GlobalTransform, &'static Look, Option<&'static StyleTransition>);

/// Anything about a cloud that is drawn.
type AnyChange = Or<(Changed<CloudScene>, Changed<GlobalTransform>, Changed<Look>, Changed<StyleTransition>)>;

/// Takes over clouds that came, changed or went. Touches the resource only then.
pub(super) fn extract_clouds(
    mut clouds: ResMut<RenderClouds>,
    changed: Extract<Query<CloudParts, AnyChange>>,
    all: Extract<Query<(), With<CloudScene>>>,
    mut removed: Extract<RemovedComponents<CloudScene>>,
    mut transitions: Extract<RemovedComponents<StyleTransition>>,
) {
    for entity in removed.read().filter(|&entity| !all.contains(entity)) {
        clouds.0.remove(&MainEntity::from(entity));
    }
    for entity in transitions.read() {
        if let Some(cloud) = clouds.0.get_mut(&MainEntity::from(entity)) {
            cloud.fade = Duration::ZERO;
        }
    }
    for (entity, scene, transform, look, transition) in &changed {
        let cloud = RenderCloud {
            scene: Arc::clone(scene.0.scene()),
            world_from_scene: transform.affine(),
            look: look.clone(),
            fade: transition.map_or(Duration::ZERO, |transition| transition.duration),
        };
        clouds.0.insert(entity.into(), cloud);
    }
}
