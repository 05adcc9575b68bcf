//! The present scene or world, and the one that is being loaded to replace it.

use std::path::{Path, PathBuf};

use bevy::prelude::*;
use bevy_stylegaussian::{
    GaussianScene, GaussianSplats, GaussianWorld, StyleSource, StyleTransition, mask::StyleMask,
    style::StylePrepare, stylegaussian_files::world::FILE, world::WorldManifest,
};
use stylegaussian_app::{Framing, Orbit, Subject, loaded_asset};

use crate::panel::{Notice, Transfer};

/// Why some files and tools do not go with a world.
pub const OF_SCENES: &str = "looks, masks and pins are of single scenes, and do not fit a world";

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
    /// Whether it is a world.
    pub is_world: bool,
    /// Path and handle of the next scene, or `None` if none is being loaded.
    pub loading: Option<(PathBuf, Next)>,
}

/// The scene or the world that is being loaded.
pub enum Next {
    Scene(Handle<GaussianScene>),
    World(Handle<WorldManifest>),
}

impl ShownScene {
    /// Loads a file. The present scene stays until it is loaded, or if loading fails.
    pub fn load(&mut self, path: &Path, assets: &AssetServer) {
        let next = match path.file_name() {
            Some(name) if name == FILE => Next::World(assets.load(path.to_owned())),
            _ => Next::Scene(assets.load(path.to_owned())),
        };
        self.loading = Some((path.to_owned(), next));
    }

    /// Whether a world is shown, once what is being loaded is.
    pub fn expects_world(&self) -> bool {
        match &self.loading {
            Some((_, next)) => matches!(next, Next::World(_)),
            None => self.is_world,
        }
    }

    /// The scene that will be shown once it is loaded.
    pub fn coming(&self) -> Option<&Handle<GaussianScene>> {
        match &self.loading {
            Some((_, Next::Scene(handle))) => Some(handle),
            _ => None,
        }
    }

    fn of_scene(scene: &GaussianScene) -> Self {
        Self {
            n_gaussians: scene.scene().len(),
            framing: Framing::of(scene),
            up_is_told: scene.scene().up.is_some(),
            ..Self::default()
        }
    }

    fn of_world(manifest: &WorldManifest) -> Self {
        let levels = manifest.levels();
        let n_gaussians = usize::try_from(levels.count(0)).unwrap_or(usize::MAX);
        Self { n_gaussians, framing: Framing::of_world(levels), is_world: true, ..Self::default() }
    }
}

/// The name of a file, or of the folder of a world.
fn name_of(path: &Path) -> String {
    let folder = path.parent().filter(|_| path.file_name().is_some_and(|name| name == FILE));
    let path = folder.unwrap_or(path);
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Spawns the entity that shows scenes.
pub fn spawn(mut commands: Commands) {
    commands.init_resource::<ShownScene>();
    // An image may be dropped at any time, and should not wait for work on the scene alone.
    let style = (StyleSource::none(), StylePrepare, StyleTransition::default(), StyleMask::default());
    commands.spawn((Subject, GaussianSplats::default(), style));
}

/// Shows the next scene once it is loaded, and moves the camera to see all of it.
pub fn show_loaded(
    mut commands: Commands,
    mut shown: ResMut<ShownScene>,
    subject: Single<(Entity, &StyleSource), With<Subject>>,
    view: Single<(&mut Orbit, &Camera)>,
    (mut notice, mut transfer): (ResMut<Notice>, ResMut<Transfer>),
    (scenes, manifests): (Res<Assets<GaussianScene>>, Res<Assets<WorldManifest>>),
    assets: Res<AssetServer>,
) {
    // Put back below if it is still being loaded.
    let Some((path, next)) = shown.loading.take() else { return };
    let found = match &next {
        Next::Scene(handle) => {
            loaded_asset(handle, &scenes, &assets).map(|loaded| loaded.map(ShownScene::of_scene))
        }
        Next::World(handle) => {
            loaded_asset(handle, &manifests, &assets).map(|loaded| loaded.map(ShownScene::of_world))
        }
    };
    let found = match found {
        Some(Ok(found)) => found,
        Some(Err(error)) => return notice.fail(error),
        None => {
            shown.loading = Some((path, next));
            return;
        }
    };
    *shown = ShownScene { name: name_of(&path), ..found };
    let (entity, source) = *subject;
    let mut entity = commands.entity(entity);
    match next {
        Next::Scene(handle) => entity.remove::<GaussianWorld>().insert(GaussianSplats(handle)),
        Next::World(handle) => entity.remove::<GaussianSplats>().insert(GaussianWorld(handle)),
    };
    let (mut orbit, camera) = view.into_inner();
    *orbit = shown.framing.orbit(camera);
    // The plugin styles a new scene by itself, from its captured colors.
    *transfer = Transfer { is_under_way: !source.is_none(), ..default() };
    notice.clear();
}

/// Rotates the scene upright.
pub fn turn_up(shown: Res<ShownScene>, mut subject: Single<&mut Transform, With<Subject>>) {
    subject.set_if_neq(Transform::from_rotation(shown.framing.world_from_scene()));
}
