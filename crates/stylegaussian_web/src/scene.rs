//! The scene or the world that is shown, and the one that comes next.

use bevy::{
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, futures::check_ready},
};
use bevy_stylegaussian::{
    GaussianScene, GaussianSplats, GaussianWorld, StyleSource, StyleTransition,
    stylegaussian_files::scene_to_bytes, world::WorldManifest,
};
use js_sys::Uint8Array;
use stylegaussian_app::{Framing, Orbit, Subject, loaded_asset};

use crate::{
    bridge::{self, Event},
    memory,
    style::Wish,
    work,
    worker::{self, Call, State},
};

/// Why a scene cannot be embedded in a page.
const NO_WORKER: &str =
    "this page has no worker, which embedding needs; `stylegaussian embed` does it outside of a browser";

/// Why a world cannot be embedded.
const IS_WORLD: &str = "a world is larger than the page can embed; open a single scene to embed it";

/// The scene or the world that is coming.
#[derive(Default)]
pub enum Next {
    #[default]
    None,
    /// An asset of the server, and its path.
    Asset(Handle<GaussianScene>, String),
    /// A world at an address.
    World(Handle<WorldManifest>),
    /// A file of the visitor, which nobody reads yet.
    File { name: String, bytes: Uint8Array },
    /// The present scene with features, for which nobody computes yet.
    Embedded,
    /// A file that the worker reads, or the scene that it embeds.
    Worker { call: Call, is_embedding: bool },
    /// A file that is being read, of a scene that may be the present one with features.
    Reading { task: Task<Result<GaussianScene, String>>, of_worker: bool, is_embedded: bool },
}

/// A scene or a world that can be shown.
enum Read {
    Scene(Handle<GaussianScene>),
    World(Handle<WorldManifest>),
}

/// The scene that is shown, and the next one.
#[derive(Resource, Default)]
pub struct Shown {
    next: Next,
    /// The asset that was shown last, and its path.
    asset: Option<(AssetId<GaussianScene>, String)>,
}

/// Spawns the entity that shows scenes and worlds.
pub fn spawn(mut commands: Commands) {
    commands.spawn((Subject, GaussianSplats::default(), StyleSource::none(), StyleTransition::default()));
}

/// Begins to load a scene or a world. The present one stays until it is there.
pub fn open(world: &mut World, next: impl FnOnce(&AssetServer) -> Next) {
    let next = next(world.resource::<AssetServer>());
    world.resource_mut::<Shown>().replace(next);
}

/// Begins to embed the present scene, or ends that.
pub fn embed(world: &mut World, is_wanted: bool) {
    let mut shown = world.resource_mut::<Shown>();
    if shown.is_embedding() != is_wanted {
        shown.replace(if is_wanted { Next::Embedded } else { Next::None });
    }
}

impl Shown {
    /// Another scene is to come.
    fn replace(&mut self, next: Next) {
        // It may have minutes to go, and everything else would wait for it.
        if matches!(self.next, Next::Worker { is_embedding: true, .. }) {
            worker::restart("embedding was canceled");
        }
        self.next = next;
    }

    fn is_embedding(&self) -> bool {
        matches!(self.next, Next::Embedded | Next::Worker { is_embedding: true, .. })
    }

    /// Has the worker, which is ready, embed a scene.
    fn embed(&self, id: AssetId<GaussianScene>, scenes: &Assets<GaussianScene>) -> Result<Call, String> {
        self.hold(id, scenes.get(id).ok_or("there is no scene to embed")?)?;
        Ok(worker::call("work_embed", &[]))
    }

    /// Sees that the worker, which is ready, holds a scene.
    ///
    /// # Errors
    /// If the scene cannot be written.
    pub fn hold(&self, id: AssetId<GaussianScene>, scene: &GaussianScene) -> Result<(), String> {
        if worker::held() == Some(id) {
            return Ok(());
        }
        // To load a file again costs no frame; to write a scene does.
        let file = match &self.asset {
            Some((asset, path)) if *asset == id => worker::asset(path),
            _ => {
                let bytes = scene_to_bytes("scene.sgs", scene.scene()).map_err(|error| error.to_string())?;
                worker::bytes(&bytes)
            }
        };
        // An error comes again from whatever needs the scene.
        worker::call("work_hold", &[file]);
        worker::holds(Some(id));
        Ok(())
    }

    /// Begins what waits for the worker, once it is known whether there is one. There is no `present` scene if
    /// a world is shown.
    fn begin(
        &mut self,
        present: Option<AssetId<GaussianScene>>,
        scenes: &Assets<GaussianScene>,
    ) -> Result<(), String> {
        self.next = match (&self.next, worker::state()) {
            (Next::File { name, bytes }, State::Ready) => {
                worker::holds(None);
                let given = [name.into(), bytes.clone().into()];
                Next::Worker { call: worker::call("work_read", &given), is_embedding: false }
            }
            (Next::File { name, bytes }, State::Absent) => {
                reading(name.clone(), memory::copied(bytes)?, false, false)?
            }
            (Next::Embedded, State::Ready) => {
                let present = present.ok_or(IS_WORLD)?;
                Next::Worker { call: self.embed(present, scenes)?, is_embedding: true }
            }
            (Next::Embedded, State::Absent) => return Err(NO_WORKER.into()),
            _ => return Ok(()),
        };
        Ok(())
    }

    /// The next one, once it is read.
    fn poll(
        &mut self,
        scenes: &mut Assets<GaussianScene>,
        manifests: &Assets<WorldManifest>,
        assets: &AssetServer,
    ) -> Option<Result<Read, String>> {
        match &mut self.next {
            Next::None | Next::File { .. } | Next::Embedded => None,
            Next::Asset(handle, _) => {
                let loaded = loaded_asset(handle, scenes, assets)?;
                Some(loaded.map(|_| Read::Scene(handle.clone())))
            }
            Next::World(handle) => {
                let loaded = loaded_asset(handle, manifests, assets)?;
                Some(loaded.map(|_| Read::World(handle.clone())))
            }
            Next::Worker { call, is_embedding } => {
                let is_embedding = *is_embedding;
                let read = |bytes| reading("the scene".into(), bytes, true, is_embedding);
                match call.answer()?.and_then(read) {
                    Ok(next) => self.next = next,
                    Err(error) => return Some(Err(error)),
                }
                None
            }
            Next::Reading { task, of_worker, .. } => match check_ready(task)? {
                Ok(scene) => {
                    let handle = scenes.add(scene);
                    if *of_worker {
                        worker::holds(Some(handle.id()));
                    }
                    Some(Ok(Read::Scene(handle)))
                }
                Err(error) => Some(Err(error)),
            },
        }
    }
}

/// Reads a file on the page's thread.
///
/// # Errors
/// If the page has no memory for it.
fn reading(name: String, bytes: Vec<u8>, of_worker: bool, is_embedded: bool) -> Result<Next, String> {
    memory::expect_room(&name, bytes.len())?;
    let read = async move { work::read(bytes, &name).map(GaussianScene::new) };
    Ok(Next::Reading { task: AsyncComputeTaskPool::get().spawn(read), of_worker, is_embedded })
}

/// Shows the next scene or world once it is loaded, and moves the camera to see all of it.
pub fn show_loaded(
    mut commands: Commands,
    mut shown: ResMut<Shown>,
    subject: Single<(Entity, Option<&GaussianSplats>, &mut Transform), With<Subject>>,
    view: Single<(&mut Orbit, &Camera)>,
    (mut scenes, manifests): (ResMut<Assets<GaussianScene>>, Res<Assets<WorldManifest>>),
    (mut wish, assets): (ResMut<Wish>, Res<AssetServer>),
) {
    let (entity, splats, mut transform) = subject.into_inner();
    let begun = shown.begin(splats.map(|splats| splats.0.id()), &scenes);
    let next = begun.map_or_else(|error| Some(Err(error)), |()| shown.poll(&mut scenes, &manifests, &assets));
    let Some(next) = next else { return };
    let last = std::mem::take(&mut shown.next);
    let mut entity = commands.entity(entity);
    let (framing, n_gaussians, has_features) = match next {
        Err(error) => return bridge::tell(Event::Failed, &error),
        Ok(Read::Scene(handle)) => {
            let Some(scene) = scenes.get(&handle) else { return };
            entity.remove::<GaussianWorld>().insert(GaussianSplats(handle));
            (Framing::of(scene), scene.scene().len() as u64, scene.scene().features.is_some())
        }
        Ok(Read::World(handle)) => {
            let Some(levels) = manifests.get(&handle).map(WorldManifest::levels) else { return };
            entity.remove::<GaussianSplats>().insert(GaussianWorld(handle));
            // Chunks have no features.
            (Framing::of_world(levels), levels.count(0), false)
        }
    };
    // With features, the present scene stays where it is.
    if !matches!(last, Next::Reading { is_embedded: true, .. }) {
        let (mut orbit, camera) = view.into_inner();
        *orbit = framing.orbit(camera);
        *transform = Transform::from_rotation(framing.world_from_scene());
    }
    bridge::tell(Event::Loaded, &format!("{n_gaussians} {has_features}"));
    if let Next::Asset(handle, path) = last {
        shown.asset = Some((handle.id(), path));
    }
    if !has_features {
        wish.forget_decoded();
    }
    // Paint belongs to a scene.
    wish.is_due = true;
}
