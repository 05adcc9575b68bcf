//! From an asset handle to the scene itself, on the entity: what rendering and styling look at.

use std::sync::Arc;

use bevy::{
    asset::{AssetLoadFailedEvent, LoadState},
    camera::primitives::Aabb,
    platform::collections::HashSet,
    prelude::*,
};

use crate::{asset::GaussianScene, style::AppliedStyle};

use super::{GaussianSplats, SceneError, SceneFailed};

/// The scene of an entity's [`GaussianSplats`], once it is loaded; replaced when the asset changes.
#[derive(Component, Clone)]
pub(crate) struct CloudScene(pub(crate) GaussianScene);

/// Marks the entities whose asset came, changed or went, as if their handle had changed.
pub(super) fn mark_changed_scenes(
    mut events: MessageReader<AssetEvent<GaussianScene>>,
    mut splats: Query<&mut GaussianSplats>,
) {
    let changed: HashSet<AssetId<GaussianScene>> = events
        .read()
        .filter_map(|event| match event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } | AssetEvent::Removed { id } => Some(*id),
            _ => None,
        })
        .collect();
    if changed.is_empty() {
        return;
    }
    for mut splats in &mut splats {
        if changed.contains(&splats.0.id()) {
            splats.set_changed();
        }
    }
}

/// What an entity has because of its scene.
type OfScene = (CloudScene, Aabb, AppliedStyle);

/// Gives entities their scene and its bounds, or takes them away where the asset is gone.
///
/// Observers of [`SceneFailed`] may despawn any entity before the commands of this system reach it.
pub(super) fn attach_scenes(
    mut commands: Commands,
    changed: Query<(Entity, &GaussianSplats, Option<&CloudScene>), Changed<GaussianSplats>>,
    all: Query<(), With<GaussianSplats>>,
    mut removed: RemovedComponents<GaussianSplats>,
    scenes: Res<Assets<GaussianScene>>,
    server: Res<AssetServer>,
    mut failed: MessageWriter<SceneFailed>,
) {
    // One that was put back at once is among the changed.
    for entity in removed.read().filter(|&entity| !all.contains(entity)) {
        commands.entity(entity).try_remove::<OfScene>();
    }
    for (entity, splats, attached) in &changed {
        let Some(scene) = scenes.get(&splats.0) else {
            if attached.is_some() {
                commands.entity(entity).try_remove::<OfScene>();
            }
            // Asked for again after it failed: there will be no event.
            if let Some(LoadState::Failed(error)) = server.get_load_state(&splats.0) {
                fail(entity, SceneError::Load(error.to_string()), &mut commands, &mut failed);
            }
            continue;
        };
        if attached.is_some_and(|attached| Arc::ptr_eq(attached.0.scene(), scene.scene())) {
            continue;
        }
        match scene.bounds() {
            // Without bounds there is nothing to see; without an `Aabb` the entity would be taken for visible everywhere.
            Ok(bounds) => {
                let of_scene = (CloudScene(scene.clone()), bounds.unwrap_or_default());
                commands.entity(entity).try_insert(of_scene);
            }
            Err(error) => {
                commands.entity(entity).try_remove::<OfScene>();
                fail(entity, error.into(), &mut commands, &mut failed);
            }
        }
    }
}

/// Tells which entities wait in vain.
pub(super) fn report_failed_loads(
    mut events: MessageReader<AssetLoadFailedEvent<GaussianScene>>,
    splats: Query<(Entity, &GaussianSplats)>,
    mut commands: Commands,
    mut failed: MessageWriter<SceneFailed>,
) {
    for event in events.read() {
        for (entity, _) in splats.iter().filter(|(_, splats)| splats.0.id() == event.id) {
            let error = SceneError::Load(event.error.to_string());
            fail(entity, error, &mut commands, &mut failed);
        }
    }
}

/// Logs, writes and triggers a [`SceneFailed`].
pub(super) fn fail(
    entity: Entity,
    error: SceneError,
    commands: &mut Commands,
    failed: &mut MessageWriter<SceneFailed>,
) {
    error!("{entity}: {error}");
    let event = SceneFailed { entity, error: Arc::new(error) };
    failed.write(event.clone());
    commands.trigger(event);
}
