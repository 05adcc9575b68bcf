//! A capture at levels of detail that follow the camera, as one that is larger than a GPU has to be shown: the
//! camera flies around it, and the window's title counts what is there. Space paints it, and the levels that
//! arrive later as well.
//!
//! ```sh
//! cargo run --release --example world                     # the demo scene, in cells and levels of its own
//! cargo run --release --example world -- FOLDER 1000000   # the `lod-meta.json` in a folder, and a budget
//! ```

use std::{
    fs,
    path::{Path, PathBuf},
};

use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::{
    prelude::*,
    stylegaussian::Scene,
    stylegaussian_files::{
        read_scene,
        world::{FILE, Node as Cell, Run, World as Levels},
        write_scene,
    },
};

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// Levels of the demo scene, each of a quarter of the Gaussians of the one before.
const N_LEVELS: usize = 3;

/// Cells of the demo scene.
const N_CELLS: usize = 16;

/// The manifest that is shown, and how it is turned.
#[derive(Resource)]
struct Shown(PathBuf, Quat);

fn main() -> anyhow::Result<AppExit> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    // A folder that was made here goes with the app.
    let (shown, budget, _made) = match arguments.first() {
        Some(folder) => {
            // Captures have y down.
            let turn = Quat::from_rotation_x(std::f32::consts::PI);
            // The plugin chooses one for the machine if none is given.
            let budget =
                arguments.get(1).map(|text| text.parse::<usize>()).transpose()?.map(GaussianBudget::new);
            (Shown(fs::canonicalize(folder)?.join(FILE), turn), budget, None)
        }
        None => {
            let folder = tempfile::tempdir()?;
            write_levels(folder.path())?;
            let budget = GaussianBudget { gaussians: 30_000, ..default() };
            (Shown(folder.path().join(FILE), Quat::IDENTITY), Some(budget), Some(folder))
        }
    };
    let assets = AssetPlugin {
        file_path: ASSETS.into(),
        // The folder may lie anywhere.
        unapproved_path_mode: bevy::asset::UnapprovedPathMode::Allow,
        ..default()
    };
    let mut app = App::new();
    if let Some(budget) = budget {
        app.insert_resource(budget);
    }
    Ok(app
        .add_plugins((DefaultPlugins.set(assets), StyleGaussianPlugin::default()))
        .insert_resource(shown)
        .add_systems(Startup, setup)
        .add_systems(Update, (fly, paint, count))
        .add_observer(|failed: On<GaussianWorldFailed>| warn!("{}", failed.error))
        .run())
}

fn setup(mut commands: Commands, assets: Res<AssetServer>, shown: Res<Shown>) {
    commands.spawn((Camera3d::default(), Tonemapping::None, Msaa::Off));
    commands.spawn((
        GaussianWorld(assets.load(shown.0.clone())),
        Transform::from_rotation(shown.1),
        StyleSource::none(),
    ));
}

/// Takes the camera around the middle of the world, now near and now far.
fn fly(
    mut camera: Single<&mut Transform, With<Camera3d>>,
    world: Single<(&GaussianWorld, &Transform), Without<Camera3d>>,
    manifests: Res<Assets<WorldManifest>>,
    time: Res<Time>,
) {
    let (world, place) = *world;
    let Some([min, max]) = manifests.get(&world.0).and_then(WorldManifest::bounds) else { return };
    let (center, size) = (place.transform_point(0.5 * (min + max)), (max - min).length());
    let seconds = time.elapsed_secs();
    let distance = size * (0.75 + 0.25 * (0.4 * seconds).sin());
    let around = Quat::from_rotation_y(0.2 * seconds) * Vec3::new(0.0, 0.3, 1.0);
    **camera = Transform::from_translation(center + distance * around).looking_at(center, Vec3::Y);
}

/// Paints the world, and takes the paint off.
fn paint(mut source: Single<&mut StyleSource>, keys: Res<ButtonInput<KeyCode>>, assets: Res<AssetServer>) {
    if keys.just_pressed(KeyCode::Space) {
        **source = match source.is_none() {
            true => StyleSource::preset(assets.load("styles/strokes.style.safetensors")),
            false => StyleSource::none(),
        };
    }
}

fn count(state: Single<&WorldState, Changed<WorldState>>, mut window: Single<&mut Window>) {
    let WorldState { parts, shown, arriving, waiting, unstyled, .. } = **state;
    window.title = format!(
        "{shown} Gaussians in {parts} parts, {arriving} arriving, {waiting} parts waiting, {unstyled} for paint"
    );
}

/// Writes the demo scene in cells and levels, one file for each level. The program `stylegaussian tile` does it
/// better: it merges Gaussians instead of leaving some out.
fn write_levels(folder: &Path) -> anyhow::Result<()> {
    let mut scene = read_scene(&Path::new(ASSETS).join("demo.sgs"))?.scene;
    scene = Scene { features: None, decoder: None, neighbors: None, mask: None, ..scene };
    // Gaussians are in Morton order, so those that follow one another are near in space.
    let size = scene.len().div_ceil(N_CELLS);
    let mut nodes = Vec::new();
    for first in (0..scene.len()).step_by(size) {
        let means = &scene.means[first..(first + size).min(scene.len())];
        let min = means.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let max = means.iter().copied().reduce(Vec3::max).unwrap_or_default();
        nodes.push(Cell { bounds: [min, max], levels: Vec::new() });
    }
    for file in 0..N_LEVELS {
        let every = 4_usize.pow(file as u32);
        let mut kept: Vec<u32> = Vec::new();
        for (cell, first) in nodes.iter_mut().zip((0..scene.len()).step_by(size)) {
            let begin = kept.len();
            kept.extend((first..(first + size).min(scene.len())).step_by(every).map(|i| i as u32));
            cell.levels.push(Some(Run { file, range: begin..kept.len() }));
        }
        let mut level = scene.subset(&kept);
        level.order = (0..kept.len() as u32).collect();
        level.n_source = kept.len();
        // Those that are left cover the area of all.
        level.scales.iter_mut().for_each(|scale| *scale *= (every as f32).sqrt());
        write_scene(&folder.join(format!("{file}.sog")), &level)?;
    }
    let files = (0..N_LEVELS).map(|file| format!("{file}.sog")).collect();
    let levels = Levels { n_levels: N_LEVELS, files, environment: None, nodes };
    Ok(fs::write(folder.join(FILE), levels.write())?)
}
