//! The present scene, and the one that is being loaded to replace it.

use std::path::{Path, PathBuf};

use bevy::{asset::LoadState, prelude::*};
use bevy_stylegaussian::{
    GaussianScene, GaussianSplats, StyleMask, StylePrepare, StyleSource, StyleTransition,
};

use crate::{
    camera::Orbit,
    panel::{Notice, Transfer},
};

/// The axes that can be up in a scene.
pub const AXES: [(&str, Vec3); 6] = [
    ("+Y", Vec3::Y),
    ("-Y", Vec3::NEG_Y),
    ("+Z", Vec3::Z),
    ("-Z", Vec3::NEG_Z),
    ("+X", Vec3::X),
    ("-X", Vec3::NEG_X),
];

/// Facts about the scene for the panel.
#[derive(Resource, Default)]
pub struct ShownScene {
    pub name: String,
    pub n_gaussians: usize,
    /// The scene's up direction, which is turned to the world's y.
    pub up: Vec3,
    /// Whether `up` is from the file.
    pub up_is_told: bool,
    /// Center and radius of the bulk of the scene, in its own axes.
    pub extent: (Vec3, f32),
    /// Path and handle of the next scene, or `None` if none is being loaded.
    pub loading: Option<(PathBuf, Handle<GaussianScene>)>,
}

impl ShownScene {
    /// Loads a file. The present scene stays until it is loaded, or if loading fails.
    pub fn load(&mut self, path: &Path, assets: &AssetServer) {
        self.loading = Some((path.to_owned(), assets.load(path.to_owned())));
    }

    /// The rotation that turns the scene upright.
    pub fn world_from_scene(&self) -> Quat {
        Quat::from_rotation_arc(self.up.normalize_or(Vec3::Y), Vec3::Y)
    }
}

/// Spawns the entity that shows scenes.
pub fn spawn(mut commands: Commands) {
    commands.init_resource::<ShownScene>();
    // An image may be dropped at any time, and should not wait for work on the scene alone.
    let style = (StyleSource::none(), StylePrepare, StyleTransition::default(), StyleMask::default());
    commands.spawn((GaussianSplats::default(), style));
}

/// Shows the next scene once it is loaded, and moves the camera to see all of it.
pub fn show_loaded(
    mut shown: ResMut<ShownScene>,
    entity: Single<(&mut GaussianSplats, &StyleSource)>,
    mut orbit: Single<&mut Orbit>,
    mut notice: ResMut<Notice>,
    mut transfer: ResMut<Transfer>,
    scenes: Res<Assets<GaussianScene>>,
    assets: Res<AssetServer>,
) {
    // Put back below if it is still being loaded.
    let Some((path, handle)) = shown.loading.take() else { return };
    if let Some(LoadState::Failed(error)) = assets.get_load_state(&handle) {
        return notice.fail(error.to_string());
    }
    let Some(scene) = scenes.get(&handle) else {
        shown.loading = Some((path, handle));
        return;
    };
    let scene = scene.scene();
    *shown = ShownScene {
        name: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        n_gaussians: scene.len(),
        // Captures without an up axis are usually in the axes of structure from motion, with y down.
        up: scene.up.unwrap_or(Vec3::NEG_Y),
        up_is_told: scene.up.is_some(),
        extent: extent(&scene.means),
        loading: None,
    };
    let (mut splats, source) = entity.into_inner();
    splats.0 = handle;
    orbit.frame(&shown);
    // The plugin styles a new scene by itself, from its captured colors.
    *transfer = Transfer { is_under_way: !source.is_none(), ..default() };
    notice.clear();
}

/// Rotates the scene upright.
pub fn turn_up(shown: Res<ShownScene>, mut splats: Single<&mut Transform, With<GaussianSplats>>) {
    splats.set_if_neq(Transform::from_rotation(shown.world_from_scene()));
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
