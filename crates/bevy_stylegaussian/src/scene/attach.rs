//! Attaches loaded scenes to the entities that show them. Rendering and styling read the attached scene.

use std::{sync::Arc, time::Duration};

use bevy::{
    asset::{AssetLoadFailedEvent, LoadState},
    camera::primitives::Aabb,
    platform::{
        collections::{HashMap, HashSet},
        time::Instant,
    },
    prelude::*,
};
use stylegaussian::Scene;

use super::{
    asset::GaussianScene,
    component::GaussianSplats,
    failure::{GaussianSceneError, SceneFailures},
};

/// The scene that an entity shows: that of its [`GaussianSplats`], or the one before it until the asset is
/// loaded and valid. `Changed<LoadedScene>` is true exactly if the entity shows other Gaussians.
#[derive(Component, Clone)]
pub(crate) struct LoadedScene {
    pub(crate) id: AssetId<GaussianScene>,
    pub(crate) asset: GaussianScene,
}

impl LoadedScene {
    /// The scene's data.
    pub(crate) fn scene(&self) -> &Arc<Scene> {
        self.asset.scene()
    }
}

/// The scene that an entity will show once the GPU has it, in place of the one that it shows.
#[derive(Component, Clone)]
pub(crate) struct NextScene(pub(crate) LoadedScene);

/// Present if scenes are uploaded in the background.
#[derive(Resource)]
pub(crate) struct UploadsInBackground;

/// The components that an entity has because of its scene.
type SceneParts = (LoadedScene, NextScene, Aabb);

/// Detaches scenes from entities that lost their [`GaussianSplats`], or if the asset is gone, which
/// `AssetChanged` does not detect.
pub(super) fn detach_scenes(
    mut commands: Commands,
    mut events: MessageReader<AssetEvent<GaussianScene>>,
    mut removed: RemovedComponents<GaussianSplats>,
    splats: Query<(Entity, &GaussianSplats)>,
    scenes: Res<Assets<GaussianScene>>,
) {
    // A component that was put back in the same frame is in `splats`.
    for entity in removed.read().filter(|&entity| !splats.contains(entity)) {
        commands.entity(entity).try_remove::<SceneParts>();
    }
    let gone: HashSet<AssetId<GaussianScene>> = events
        .read()
        .filter_map(|event| match event {
            AssetEvent::Removed { id } if !scenes.contains(*id) => Some(*id),
            _ => None,
        })
        .collect();
    if gone.is_empty() {
        return;
    }
    // The splats' own asset counts, not the one that is shown until it comes.
    for (entity, _) in splats.iter().filter(|(_, splats)| gone.contains(&splats.0.id())) {
        commands.entity(entity).try_remove::<SceneParts>();
    }
}

/// The entity shows another asset, or its asset came or changed.
type SceneChanged = Or<(Changed<GaussianSplats>, AssetChanged<GaussianSplats>)>;

/// Attaches scenes that came or changed.
///
/// Observers of [`GaussianSceneFailed`](super::GaussianSceneFailed) may despawn any entity before the commands
/// of this system are applied, hence `try_insert` and `try_remove`.
pub(super) fn attach_scenes(
    mut commands: Commands,
    changed: Query<(Entity, &GaussianSplats, Option<&LoadedScene>), SceneChanged>,
    scenes: Res<Assets<GaussianScene>>,
    server: Res<AssetServer>,
    in_background: Option<Res<UploadsInBackground>>,
    mut failures: SceneFailures,
) {
    for (entity, splats, attached) in &changed {
        let id = splats.0.id();
        let Some(asset) = scenes.get(id) else {
            // The last scene stays until the new one is there: an empty place for the time of a load, or for
            // good after a failure, helps nobody. A load that failed before this entity asked for it sends no
            // further event.
            if let Some(LoadState::Failed(error)) = server.get_load_state(id) {
                failures.send(entity, GaussianSceneError::Load(error.to_string()));
            }
            continue;
        };
        // `Changed<GaussianSplats>` is also true if the component was only borrowed mutably. Inserting again
        // would restart the style.
        let is_attached = |old: &LoadedScene| old.id == id && Arc::ptr_eq(old.scene(), asset.scene());
        if attached.is_some_and(is_attached) {
            commands.entity(entity).try_remove::<NextScene>();
            continue;
        }
        match asset.bounds() {
            // What is shown stays until the GPU has the next scene.
            Ok(_) if attached.is_some() && in_background.is_some() && !asset.is_on_gpu() => {
                let scene = LoadedScene { id, asset: asset.clone() };
                commands.entity(entity).try_insert(NextScene(scene));
            }
            // An empty scene gets an empty box: an entity without any `Aabb` counts as visible everywhere.
            Ok(bounds) => {
                let scene = LoadedScene { id, asset: asset.clone() };
                let parts = (scene, bounds.unwrap_or_default());
                commands.entity(entity).try_insert(parts).try_remove::<NextScene>();
            }
            Err(error) => failures.send(entity, error.into()),
        }
    }
}

/// Attaches scenes that the GPU has by now.
pub(super) fn attach_uploaded_scenes(mut commands: Commands, next: Query<(Entity, &NextScene)>) {
    for (entity, NextScene(scene)) in next.iter().filter(|(_, next)| next.0.asset.is_on_gpu()) {
        // It had bounds when it was attached first.
        let bounds = scene.asset.bounds().ok().flatten().unwrap_or_default();
        commands.entity(entity).try_insert((scene.clone(), bounds)).try_remove::<NextScene>();
    }
}

/// Time within which the same failure of a loaded asset counts as the same try. Bevy's asset server reads a
/// changed file that it cannot parse a second time, at once, and tells both failures.
const SAME_TRY: Duration = Duration::from_secs(2);

/// Sends a failure for each entity that waits for an asset that failed to load.
pub(super) fn report_failed_loads(
    mut events: MessageReader<AssetLoadFailedEvent<GaussianScene>>,
    splats: Query<(Entity, Ref<GaussianSplats>)>,
    scenes: Res<Assets<GaussianScene>>,
    mut last: Local<HashMap<AssetId<GaussianScene>, (Instant, String)>>,
    mut failures: SceneFailures,
) {
    // A failed load changes no asset, so `AssetChanged` in `attach_scenes` does not see it.
    for event in events.read() {
        let error = event.error.to_string();
        let told = last.remove(&event.id);
        // A first load is tried once.
        if scenes.contains(event.id) {
            if told.is_some_and(|(at, told)| told == error && at.elapsed() < SAME_TRY) {
                continue;
            }
            last.insert(event.id, (Instant::now(), error.clone()));
        }
        // `attach_scenes` tells those that ask for it in this very frame.
        let is_told = |splats: &Ref<GaussianSplats>| splats.is_changed() && !scenes.contains(event.id);
        let waits = |splats: &Ref<GaussianSplats>| splats.0.id() == event.id && !is_told(splats);
        for (entity, _) in splats.iter().filter(|(_, splats)| waits(splats)) {
            failures.send(entity, GaussianSceneError::Load(error.clone()));
        }
    }
}
