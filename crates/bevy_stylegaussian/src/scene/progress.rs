//! Progress of scenes that are read.

use std::sync::{Arc, Mutex, PoisonError};

use bevy::{asset::AssetPath, prelude::*};
use stylegaussian::work::Work;

use super::{asset::GaussianScene, component::GaussianSplats};

/// Progress of an entity's scene: there as long as the scene that it is to show is read from its files. The
/// time in which the bytes of the files come, from a disk or a network, does not count.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SceneProgress {
    /// Share of the scene that is read, 0..1.
    pub read: f32,
}

/// The scenes that are read, by their paths. A resource. Clones are of the same list.
///
/// An entity that is to show a scene has a [`SceneProgress`]. This tells the same of a scene that no entity
/// shows yet.
#[derive(Resource, Clone, Default)]
pub struct SceneReadings(Arc<Mutex<Vec<(AssetPath<'static>, Work)>>>);

/// A scene that is read. Dropping it takes it off the list.
pub(super) struct ReadingScene {
    all: SceneReadings,
    work: Work,
}

impl SceneReadings {
    /// Share of a scene that is read, 0..1, or `None` if it is not being read.
    pub fn progress(&self, scene: &Handle<GaussianScene>) -> Option<f32> {
        let path = scene.path()?;
        self.change(|all| all.iter().find(|(of, _)| of == path).map(|(_, work)| work.done()))
    }

    /// Puts a scene on the list, whose progress `work` tells.
    pub(super) fn add(&self, path: AssetPath<'static>, work: &Work) -> ReadingScene {
        self.change(|all| all.push((path, work.clone())));
        ReadingScene { all: self.clone(), work: work.clone() }
    }

    fn is_empty(&self) -> bool {
        self.change(|all| all.is_empty())
    }

    fn change<T>(&self, change: impl FnOnce(&mut Vec<(AssetPath<'static>, Work)>) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for ReadingScene {
    fn drop(&mut self) {
        self.all.change(|all| all.retain(|(_, work)| !work.is_same(&self.work)));
    }
}

/// Tells progress.
pub(super) fn report_progress(
    mut commands: Commands,
    readings: Res<SceneReadings>,
    scenes: Res<Assets<GaussianScene>>,
    mut splats: Query<(Entity, &GaussianSplats, Option<&mut SceneProgress>)>,
    told: Query<(), With<SceneProgress>>,
) {
    if readings.is_empty() && told.is_empty() {
        return;
    }
    for (entity, splats, told) in &mut splats {
        let handle = Some(&splats.0).filter(|handle| !scenes.contains(*handle));
        let progress = handle.and_then(|handle| readings.progress(handle));
        let progress = progress.map(|read| SceneProgress { read });
        match (progress, told) {
            (Some(progress), Some(mut told)) => {
                told.set_if_neq(progress);
            }
            (Some(progress), None) => {
                commands.entity(entity).try_insert(progress);
            }
            (None, Some(_)) => {
                commands.entity(entity).try_remove::<SceneProgress>();
            }
            (None, None) => {}
        }
    }
}

/// Forgets the progress of entities that show no scene any more.
pub(super) fn forget_progress(
    mut commands: Commands,
    told: Query<Entity, (With<SceneProgress>, Without<GaussianSplats>)>,
) {
    for entity in &told {
        commands.entity(entity).try_remove::<SceneProgress>();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entity_tells_how_far_its_own_scene_is_read() {
        let mut app = App::new();
        app.add_plugins((TaskPoolPlugin::default(), bevy::asset::AssetPlugin::default()))
            .init_asset::<GaussianScene>()
            .init_resource::<SceneReadings>()
            .add_systems(PostUpdate, (report_progress, forget_progress));
        // There is no such file, and no loader: only the paths count.
        let [own, other] = ["a.ply", "b.ply"].map(|path| {
            let handle = app.world().resource::<AssetServer>().load::<GaussianScene>(path);
            app.world_mut().spawn(GaussianSplats(handle)).id()
        });
        let work = Work::default();
        let readings = app.world().resource::<SceneReadings>().clone();
        let reading = readings.add("a.ply".into(), &work);
        let told = |app: &App, entity| app.world().get::<SceneProgress>(entity).map(|told| told.read);
        app.update();
        assert_eq!([own, other].map(|entity| told(&app, entity)), [Some(0.0), None]);
        work.at(0.25).unwrap();
        app.update();
        assert_eq!(told(&app, own), Some(0.25));
        // Another one of the same path.
        let again = readings.add("a.ply".into(), &Work::default());
        drop(reading);
        app.update();
        assert_eq!(told(&app, own), Some(0.0));
        drop(again);
        app.update();
        assert_eq!(told(&app, own), None);
        assert!(readings.is_empty());
        let _last = readings.add("b.ply".into(), &work);
        app.update();
        assert_eq!(told(&app, other), Some(0.25));
        app.world_mut().entity_mut(other).remove::<GaussianSplats>();
        app.update();
        assert_eq!(told(&app, other), None);
    }
}
