//! Extraction of scenes: copies changes since the last frame to the render world.

use bevy::{
    math::Affine3A,
    prelude::*,
    render::{
        Extract,
        sync_world::{MainEntity, MainEntityHashMap},
    },
};

use super::attach::{LoadedScene, NextScene};

/// All entities that show a scene. GPU state is rebuilt from it after a lost device.
#[derive(Resource, Default)]
pub(crate) struct RenderClouds(pub(crate) MainEntityHashMap<RenderCloud>);

/// An entity that shows a scene.
pub(crate) struct RenderCloud {
    pub(crate) scene: LoadedScene,
    pub(crate) world_from_scene: Affine3A,
}

/// Scenes that entities will show once they are uploaded.
#[derive(Resource, Default)]
pub(crate) struct NextScenes(pub(crate) Vec<LoadedScene>);

/// Copies the scenes that entities are going to show. Marks the resource as changed only if there are any, or
/// were.
pub(super) fn extract_next_scenes(mut scenes: ResMut<NextScenes>, next: Extract<Query<&NextScene>>) {
    if !(scenes.0.is_empty() && next.is_empty()) {
        scenes.0 = next.iter().map(|next| next.0.clone()).collect();
    }
}

/// The scene or its place changed.
type CloudChanged = Or<(Changed<LoadedScene>, Changed<GlobalTransform>)>;

/// Copies entities that came, changed or went. Marks the resource as changed only then.
pub(super) fn extract_clouds(
    mut clouds: ResMut<RenderClouds>,
    changed: Extract<Query<(Entity, &LoadedScene, &GlobalTransform), CloudChanged>>,
    all: Extract<Query<(), With<LoadedScene>>>,
    mut removed: Extract<RemovedComponents<LoadedScene>>,
) {
    // A scene that was detached and attached again in the same frame is in `all`.
    for entity in removed.read().filter(|&entity| !all.contains(entity)) {
        clouds.0.remove(&MainEntity::from(entity));
    }
    for (entity, scene, transform) in &changed {
        // A moved entity copies its scene too, which costs two `Arc`s.
        let cloud = RenderCloud { scene: scene.clone(), world_from_scene: transform.affine() };
        clouds.0.insert(entity.into(), cloud);
    }
}
