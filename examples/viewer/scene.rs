//! The scene that is shown, and the one that is being loaded to replace it.

use std::path::{Path, PathBuf};

use bevy::{asset::LoadState, prelude::*};
use bevy_stylegaussian::{GaussianScene, GaussianSplats, StyleSource, StyleTransition};

use crate::{
    camera::Orbit,
    panel::{Notice, Transfer},
};

/// The axes that a scene may call up.
pub const AXES: [(&str, Vec3); 6] = [
    ("+Y", Vec3::Y),
    ("-Y", Vec3::NEG_Y),
    ("+Z", Vec3::Z),
    ("-Z", Vec3::NEG_Z),
    ("+X", Vec3::X),
    ("-X", Vec3::NEG_X),
];

/// What the panel says about the scene.
#[derive(Resource, Default)]
pub struct ShownScene {
    pub name: String,
    pub n_gaussians: usize,
    /// The scene's up, which is turned to the world's y.
    pub up: Vec3,
    /// Whether its file told so.
    pub up_is_told: bool,
    /// Around the middle of the scene, in its own axes: center and radius.
    pub extent: (Vec3, f32),
    /// The next scene.
    pub loading: Option<(PathBuf, Handle<GaussianScene>)>,
}

impl ShownScene {
    /// Loads a file; the present scene stays until then, and also when that fails.
    pub fn load(&mut self, path: &Path, assets: &AssetServer) {
        self.loading = Some((path.to_owned(), assets.load(path.to_owned())));
    }

    /// The rotation that turns the scene upright.
    pub fn world_from_scene(&self) -> Quat {
        Quat::from_rotation_arc(self.up.normalize_or(Vec3::Y), Vec3::Y)
    }
}

/// The entity that shows scenes, without any yet.
pub fn spawn(mut commands: Commands) {
    commands.init_resource::<ShownScene>();
    commands.spawn((GaussianSplats::default(), StyleSource::none(), StyleTransition::default()));
}

/// Shows the next scene once it is loaded, and all of it.
pub fn show_loaded(
    mut shown: ResMut<ShownScene>,
    entity: Single<(&mut GaussianSplats, &StyleSource)>,
    mut orbit: Single<&mut Orbit>,
    mut notice: ResMut<Notice>,
    mut transfer: ResMut<Transfer>,
    scenes: Res<Assets<GaussianScene>>,
    assets: Res<AssetServer>,
) {
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
        // Captures that do not say are mostly in the axes of structure from motion, whose y points down.
        up: scene.up.unwrap_or(Vec3::NEG_Y),
        up_is_told: scene.up.is_some(),
        extent: extent(&scene.means),
        loading: None,
    };
    let (mut splats, source) = entity.into_inner();
    splats.0 = handle;
    orbit.frame(&shown);
    *transfer = Transfer { is_under_way: !source.is_none(), ..default() };
    notice.clear();
}

/// Turns the scene's up to the world's.
pub fn turn_up(shown: Res<ShownScene>, mut splats: Single<&mut Transform, With<GaussianSplats>>) {
    splats.set_if_neq(Transform::from_rotation(shown.world_from_scene()));
}

/// Center and radius of the bulk of a scene: captures have a few Gaussians far away.
fn extent(means: &[Vec3]) -> (Vec3, f32) {
    const N_SAMPLES: usize = 20_000;
    let samples = means.iter().step_by(means.len().div_ceil(N_SAMPLES).max(1));
    let [(x, width), (y, height), (z, depth)] = [0, 1, 2].map(|axis| {
        let mut values: Vec<f32> = samples.clone().map(|mean| mean[axis]).collect();
        values.sort_by(f32::total_cmp);
        let at = |part: usize| values.get(values.len() * part / 100).copied().unwrap_or(0.0);
        ((at(3) + at(97)) / 2.0, at(97) - at(3))
    });
    (Vec3::new(x, y, z), (Vec3::new(width, height, depth).length() / 2.0).max(0.1))
}
