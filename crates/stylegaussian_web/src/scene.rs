//! The scene that is shown, and the one that comes next.

use bevy::{
    asset::LoadState,
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, futures::check_ready},
};
use bevy_stylegaussian::{
    GaussianScene, GaussianSplats, StyleSource, StyleTransition,
    stylegaussian::file::{ReadOptions, Reading, SceneReader},
};

use crate::{
    bridge::{self, Event, Request},
    camera::Orbit,
};

/// The scene that is coming.
#[derive(Default)]
enum Next {
    #[default]
    None,
    /// An asset of the server.
    Asset(Handle<GaussianScene>),
    /// A file of the visitor, which is being read.
    File(Task<Result<GaussianScene, String>>),
}

/// The scene that is shown next.
#[derive(Resource, Default)]
pub struct Shown(Next);

/// Spawns the entity that shows scenes.
pub fn spawn(mut commands: Commands) {
    commands.spawn((GaussianSplats::default(), StyleSource::none(), StyleTransition::default()));
}

/// Begins to load the newest scene that was asked for. The present one stays until it is there.
pub fn open(mut requests: MessageReader<Request>, mut shown: ResMut<Shown>, assets: Res<AssetServer>) {
    for request in requests.read() {
        match request {
            Request::OpenAsset(path) => shown.0 = Next::Asset(assets.load(path.clone())),
            Request::OpenFile { name, bytes } => {
                let (name, bytes) = (name.clone(), bridge::take(bytes));
                shown.0 = Next::File(AsyncComputeTaskPool::get().spawn(async move { read(bytes, &name) }));
            }
            _ => {}
        }
    }
}

/// Reads a file that the visitor has dropped.
fn read(bytes: Vec<u8>, name: &str) -> Result<GaussianScene, String> {
    let mut reader = SceneReader::new(bytes, name, ReadOptions::default());
    match reader.read().map_err(|error| error.to_string())? {
        Reading::Scene(loaded) => Ok(GaussianScene::new(loaded.scene)),
        Reading::Needs(names) => {
            Err(format!("{name}: it needs other files ({}), expected a scene in one file", names.join(", ")))
        }
    }
}

/// Shows the next scene once it is loaded, and moves the camera to see all of it.
pub fn show_loaded(
    mut shown: ResMut<Shown>,
    entity: Single<(&mut GaussianSplats, &mut Transform)>,
    mut orbit: Single<&mut Orbit>,
    window: Single<&Window>,
    mut scenes: ResMut<Assets<GaussianScene>>,
    assets: Res<AssetServer>,
) {
    let handle = match &mut shown.0 {
        Next::None => return,
        Next::Asset(handle) => {
            if let Some(LoadState::Failed(error)) = assets.get_load_state(&*handle) {
                bridge::tell(Event::Failed, &error.to_string());
                shown.0 = Next::None;
                return;
            }
            if scenes.get(&*handle).is_none() {
                return;
            }
            handle.clone()
        }
        Next::File(task) => match check_ready(task) {
            None => return,
            Some(Ok(scene)) => scenes.add(scene),
            Some(Err(error)) => {
                bridge::tell(Event::Failed, &error);
                shown.0 = Next::None;
                return;
            }
        },
    };
    shown.0 = Next::None;
    let Some(scene) = scenes.get(&handle) else { return };
    let scene = scene.scene();
    // Captures without an up axis are usually in the axes of structure from motion, with y down.
    let up = scene.up.unwrap_or(Vec3::NEG_Y);
    let world_from_scene = Quat::from_rotation_arc(up.normalize_or(Vec3::Y), Vec3::Y);
    let (center, radius) = extent(&scene.means);
    let aspect = window.width() / window.height().max(1.0);
    **orbit = Orbit::frame(world_from_scene * center, radius, aspect);
    let (mut splats, mut transform) = entity.into_inner();
    *transform = Transform::from_rotation(world_from_scene);
    let can_be_styled = scene.features.is_some();
    bridge::tell(Event::Loaded, &format!("{} {can_be_styled}", scene.len()));
    splats.0 = handle;
}

/// Center and radius of the bulk of a scene. Captures have a few Gaussians far away, which are ignored.
fn extent(means: &[Vec3]) -> (Vec3, f32) {
    // Enough for percentiles, and sorted in a few milliseconds.
    const N_SAMPLES: usize = 20_000;
    let samples = means.iter().step_by(means.len().div_ceil(N_SAMPLES).max(1));
    let [(x, width), (y, height), (z, depth)] = [0, 1, 2].map(|axis| {
        let mut values: Vec<f32> = samples.clone().map(|mean| mean[axis]).collect();
        values.sort_by(f32::total_cmp);
        let at = |part: usize| values.get(values.len() * part / 100).copied().unwrap_or(0.0);
        // Percentiles 3 and 97 of each axis: floaters are few and far away, so they fall outside.
        ((at(3) + at(97)) / 2.0, at(97) - at(3))
    });
    (Vec3::new(x, y, z), (Vec3::new(width, height, depth).length() / 2.0).max(0.1))
}
