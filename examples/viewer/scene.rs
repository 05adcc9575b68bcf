//! The present scene, and the one that is being loaded to replace it.

use std::path::{Path, PathBuf};

use bevy::prelude::*;
use bevy_stylegaussian::{
    GaussianScene, GaussianSplats, StyleMask, StyleSource, StyleTransition, style::StylePrepare,
};
use stylegaussian_app::{Framing, Orbit, loaded_scene};

use crate::panel::{Notice, Transfer};

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
    /// The scene's bulk and its up direction.
    pub framing: Framing,
    /// Whether the up direction is from the file.
    pub up_is_told: bool,
    /// Path and handle of the next scene, or `None` if none is being loaded.
    pub loading: Option<(PathBuf, Handle<GaussianScene>)>,
}

impl ShownScene {
    /// Loads a file. The present scene stays until it is loaded, or if loading fails.
    pub fn load(&mut self, path: &Path, assets: &AssetServer) {
        self.loading = Some((path.to_owned(), assets.load(path.to_owned())));
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
    view: Single<(&mut Orbit, &Camera)>,
    mut notice: ResMut<Notice>,
    mut transfer: ResMut<Transfer>,
    scenes: Res<Assets<GaussianScene>>,
    assets: Res<AssetServer>,
) {
    // Put back below if it is still being loaded.
    let Some((path, handle)) = shown.loading.take() else { return };
    let scene = match loaded_scene(&handle, &scenes, &assets) {
        Some(Ok(scene)) => scene,
        Some(Err(error)) => return notice.fail(error),
        None => {
            shown.loading = Some((path, handle));
            return;
        }
    };
    *shown = ShownScene {
        name: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        n_gaussians: scene.scene().len(),
        framing: Framing::of(scene),
        up_is_told: scene.scene().up.is_some(),
        loading: None,
    };
    let (mut splats, source) = entity.into_inner();
    splats.0 = handle;
    let (mut orbit, camera) = view.into_inner();
    *orbit = shown.framing.orbit(camera);
    // The plugin styles a new scene by itself, from its captured colors.
    *transfer = Transfer { is_under_way: !source.is_none(), ..default() };
    notice.clear();
}

/// Rotates the scene upright.
pub fn turn_up(shown: Res<ShownScene>, mut splats: Single<&mut Transform, With<GaussianSplats>>) {
    splats.set_if_neq(Transform::from_rotation(shown.framing.world_from_scene()));
}
