//! Worlds in apps without a window: levels that follow a camera under a budget, files that are missing, styles,
//! and what is left once a world has gone.

use std::{fs, path::Path};

use bevy::{prelude::*, render::settings::WgpuSettings};
use stylegaussian::{Look, Scene, look::MadeFrom};
use stylegaussian_files::{
    read_scene,
    world::{FILE, Node as Cell, Run, World as Levels, look_of},
    write_look, write_scene,
};
use tempfile::TempDir;

use super::world::{rendering::*, *};
use crate::{
    AppliedStyle, GaussianScene, GaussianSplats, SplatTint, StyleGaussianPlugin, StyleSource,
    scene::LoadedScene,
    world::{GaussianBudget, GaussianWorld, GaussianWorldFailed, WorldPart, WorldState},
};

#[cfg(feature = "images")]
mod styled;

/// Gaussians of a cell at each level, the finest first.
const COUNTS: [usize; 3] = [200, 40, 8];

/// Two by two cells of the size 2: one before the camera, one far behind that, and two that it does not see.
const CENTERS: [Vec3; 4] =
    [Vec3::ZERO, Vec3::new(0.0, 0.0, -40.0), Vec3::new(60.0, 0.0, 0.0), Vec3::new(60.0, 0.0, -40.0)];

/// Exactly enough for the finest level of the first cell and the second one of the next.
const BUDGET: usize = 200 + 40 + 8 + 8;

/// Writes the world, one file for each level.
pub(super) fn write_world(folder: &Path) {
    for (level, count) in COUNTS.into_iter().enumerate() {
        let mut scene =
            Scene { features: None, decoder: None, ..small_scene(CENTERS.len() * count, level as u64) };
        for (i, mean) in scene.means.iter_mut().enumerate() {
            *mean += CENTERS[i / count];
        }
        write_scene(&folder.join(format!("{level}.sog")), &scene).unwrap();
    }
    let cell = |(i, center): (usize, Vec3)| Cell {
        bounds: [center - Vec3::ONE, center + Vec3::ONE],
        levels: COUNTS
            .into_iter()
            .enumerate()
            .map(|(file, count)| Some(Run { file, range: i * count..(i + 1) * count }))
            .collect(),
    };
    let levels = Levels {
        n_levels: COUNTS.len(),
        files: (0..COUNTS.len()).map(|level| format!("{level}.sog")).collect(),
        environment: None,
        nodes: CENTERS.into_iter().enumerate().map(cell).collect(),
    };
    fs::write(folder.join(FILE), levels.write()).unwrap();
}

/// A game that shows a world before a camera.
struct Game {
    app: App,
    world: Entity,
    camera: Entity,
    folder: TempDir,
}

impl Game {
    fn new(change: impl FnOnce(&Path)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        write_world(folder.path());
        change(folder.path());
        let file_path = folder.path().to_string_lossy().into_owned();
        let mut app = app_with_assets(AssetPlugin { file_path, ..default() });
        app.insert_resource(GaussianBudget { gaussians: BUDGET, ..default() });
        let manifest = app.world().resource::<AssetServer>().load(FILE);
        let world = app.world_mut().spawn(GaussianWorld(manifest)).id();
        let camera = app.world_mut().spawn((Camera3d::default(), Transform::from_xyz(0.0, 0.0, 6.0))).id();
        Self { app, world, camera, folder }
    }

    fn state(&self) -> WorldState {
        *self.app.world().get(self.world).unwrap()
    }

    /// Updates until each cell shows so many Gaussians. No cell that was shown is ever empty, none shows two
    /// levels, and all together never show more than the budget.
    fn until_shown(&mut self, expected: [usize; 4]) {
        let (world, mut last) = (self.world, [0; 4]);
        update_until(&mut self.app, "the levels", |app| {
            let shown = shown(app, world);
            assert!(
                shown.iter().zip(last).all(|(now, before)| *now > 0 || before == 0),
                "{shown:?}, {last:?}"
            );
            assert!(shown.iter().all(|now| *now == 0 || COUNTS.contains(now)), "{shown:?}");
            assert!(shown.iter().sum::<usize>() <= BUDGET, "{shown:?}");
            last = shown;
            shown == expected && app.get::<WorldState>(world).is_some_and(WorldState::is_settled)
        });
    }
}

/// The children of a world that are shown, with their cells and numbers of Gaussians.
fn children(app: &mut World, world: Entity) -> Vec<(Entity, usize, usize)> {
    let mut runs = app.query::<(Entity, &ChildOf, &Visibility, &LoadedScene)>();
    let of_world = runs
        .iter(app)
        .filter(|(_, parent, visibility, _)| parent.parent() == world && **visibility != Visibility::Hidden);
    let cell = |scene: &LoadedScene| {
        let mean = scene.scene().means[0];
        CENTERS.iter().position(|center| center.distance(mean) < 3.0).unwrap()
    };
    of_world.map(|(run, _, _, scene)| (run, cell(scene), scene.scene().len())).collect()
}

/// Gaussians that each cell shows.
fn shown(app: &mut World, world: Entity) -> [usize; 4] {
    let mut found = [0; 4];
    for (run, cell, n) in children(app, world) {
        let level = COUNTS.iter().position(|count| *count == n).unwrap();
        assert_eq!(app.get::<WorldPart>(run), Some(&WorldPart { world, part: cell, level }));
        found[cell] += n;
    }
    found
}

#[test]
fn levels_follow_the_camera_within_the_budget() {
    let mut game = Game::new(|_| {});
    game.until_shown([200, 40, 8, 8]);
    let state = game.state();
    assert_eq!((state.parts, state.shown_parts, state.shown), (4, 4, BUDGET));
    assert_eq!((state.arriving, state.waiting, state.unstyled), (0, 0, 0));

    // A camera that stands still changes nothing, for several cuts.
    let before = children(game.app.world_mut(), game.world);
    let begun = std::time::Instant::now();
    while begun.elapsed().as_millis() < 300 {
        game.app.update();
        assert_eq!(children(game.app.world_mut(), game.world), before);
    }

    // It turns around the far corner.
    let at = Transform::from_xyz(60.0, 0.0, -46.0).looking_at(CENTERS[3], Vec3::Y);
    game.app.world_mut().entity_mut(game.camera).insert(at);
    game.until_shown([8, 8, 40, 200]);
    // Nothing is shown beyond the fewest if there is no budget for it.
    game.app.insert_resource(GaussianBudget { gaussians: 32, ..default() });
    game.until_shown([8; 4]);
}

/// The file of the finest level is missing, and that of the next one has half of the Gaussians.
#[test]
fn files_that_cannot_be_had_are_told_once_and_the_game_goes_on() {
    let mut game = Game::new(|folder| {
        fs::remove_file(folder.join("0.sog")).unwrap();
        let half = Scene { features: None, decoder: None, ..small_scene(80, 1) };
        write_scene(&folder.join("1.sog"), &half).unwrap();
    });
    let mut told: Vec<GaussianWorldFailed> = Vec::new();
    update_until(&mut game.app, "two failures", |app| {
        told.extend(app.resource_mut::<Messages<GaussianWorldFailed>>().drain());
        told.len() >= 2
    });
    game.until_shown([8; 4]);
    for _ in 0..50 {
        game.app.update();
    }
    told.extend(drain::<GaussianWorldFailed>(&mut game.app));
    told.sort_by(|a, b| a.file.cmp(&b.file));
    let files: Vec<&str> = told.iter().map(|failed| &*failed.file).collect();
    assert_eq!(files, ["0.sog", "1.sog"]);
    assert!(told.iter().all(|failed| failed.entity == game.world && failed.error.contains(&failed.file)));
    assert!(told[1].error.contains("80 Gaussians") && told[1].error.contains("160"), "{}", told[1].error);
}

#[test]
fn a_manifest_that_is_none_is_told() {
    let mut game = Game::new(|folder| fs::write(folder.join(FILE), b"{\"lodLevels\": 3}").unwrap());
    let mut told = Vec::new();
    update_until(&mut game.app, "a failure", |app| {
        told.extend(app.resource_mut::<Messages<GaussianWorldFailed>>().drain());
        !told.is_empty()
    });
    game.app.update();
    told.extend(drain::<GaussianWorldFailed>(&mut game.app));
    assert_eq!(told.len(), 1);
    assert!(told[0].error.contains(FILE), "{}", told[0].error);
    assert_eq!(game.state(), WorldState::default());
}

#[test]
fn what_holds_for_a_world_holds_for_its_children() {
    let mut game = Game::new(|_| {});
    let dark = SplatTint { exposure: -2.0, ..default() };
    game.app.world_mut().entity_mut(game.world).insert(dark);
    game.until_shown([200, 40, 8, 8]);
    let runs = children(game.app.world_mut(), game.world);
    let tints = |app: &App| [0, 1, 2, 3].map(|i: usize| app.world().get::<SplatTint>(runs[i].0).copied());
    assert_eq!(tints(&game.app), [Some(dark); 4]);
    game.app.world_mut().entity_mut(game.world).remove::<SplatTint>();
    game.app.update();
    assert_eq!(tints(&game.app), [None; 4]);
    game.app.world_mut().entity_mut(game.world).insert(dark);
    game.app.update();
    assert_eq!(tints(&game.app), [Some(dark); 4]);
}

#[test]
fn nothing_is_left_of_a_world_that_goes() {
    for despawns in [true, false] {
        let mut game = Game::new(|_| {});
        game.until_shown([200, 40, 8, 8]);
        let mut entity = game.app.world_mut().entity_mut(game.world);
        if despawns {
            entity.despawn();
        } else {
            entity.remove::<GaussianWorld>();
        }
        // The app's own scenes are none.
        update_until(&mut game.app, "an empty game", |app| {
            let mut runs = app.query::<&GaussianSplats>();
            runs.iter(app).count() == 0 && app.resource::<Assets<GaussianScene>>().is_empty()
        });
    }
}

/// Pixels that show something never become fewer while finer levels fade in over coarser ones.
#[test]
fn nothing_is_lost_while_levels_change() {
    if !has_adapter() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    write_world(folder.path());
    let file_path = folder.path().to_string_lossy().into_owned();
    let mut app = app_of_settings(WgpuSettings::default(), AssetPlugin { file_path, ..default() });
    app.insert_resource(QUICK_THREADS);
    app.add_plugins(StyleGaussianPlugin { synchronous_pipeline_compilation: true });
    let mut app = finish(app);
    // The first level alone, and then all.
    app.insert_resource(GaussianBudget { gaussians: 32, ..default() });
    let image = render_target(&mut app, UVec2::splat(48));
    app.world_mut().spawn((
        Camera3d::default(),
        Camera { clear_color: Color::BLACK.into(), ..default() },
        target(&image),
        Transform::from_xyz(0.0, 0.0, 4.0),
    ));
    let manifest = app.world().resource::<AssetServer>().load(FILE);
    let world = app.world_mut().spawn(GaussianWorld(manifest)).id();
    let is_there = |n: usize| {
        move |world_of: &mut World| {
            let state = world_of.get::<WorldState>(world).unwrap();
            state.is_settled() && state.shown == n && state.arriving == 0
        }
    };
    update_until(&mut app, "the coarsest level", is_there(32));
    let n_lit = |app: &App| {
        read_back(app, &image).iter().filter(|pixel| pixel[..3].iter().any(|c| *c > 0.02)).count()
    };
    // What is there has come in by then.
    let begun = std::time::Instant::now();
    while begun.elapsed().as_millis() < 300 {
        app.update();
    }
    let before = n_lit(&app);
    assert!(before > 50, "{before} pixels");
    app.insert_resource(GaussianBudget { gaussians: BUDGET, ..default() });
    let mut least = before;
    let is_finer = is_there(BUDGET);
    for _ in 0..10_000 {
        if is_finer(app.world_mut()) {
            break;
        }
        app.update();
        least = least.min(n_lit(&app));
    }
    assert!(is_finer(app.world_mut()), "{:?}", app.world().get::<WorldState>(world));
    // Splats over one another may darken an edge.
    assert!(least + 3 >= before, "{least} pixels of {before}");
    assert!(n_lit(&app) > before);
}

/// The color of a cell's Gaussians in the looks of the tests.
fn color(level: usize, cell: usize) -> [f32; 3] {
    [level as f32 / 4.0, cell as f32 / 4.0, 0.5]
}

/// Writes a look for each file, in the folder `looks`.
fn write_looks(folder: &Path) {
    fs::create_dir(folder.join("looks")).unwrap();
    for (level, count) in COUNTS.into_iter().enumerate() {
        let file = format!("{level}.sog");
        let scene = read_scene(&folder.join(&file)).unwrap().scene;
        let colors: Vec<_> = (0..scene.len()).map(|i| color(level, i / count)).collect();
        let look = Look::new(&scene, &colors, MadeFrom::default());
        write_look(&folder.join("looks").join(look_of(&file)), &look).unwrap();
    }
}

#[test]
fn runs_show_their_parts_of_the_looks_of_chunks() {
    let mut game = Game::new(write_looks);
    game.app.world_mut().entity_mut(game.world).insert(StyleSource::chunk_looks("looks"));
    game.until_shown([200, 40, 8, 8]);
    let expect = |game: &mut Game, content: f32| {
        for (run, cell, n) in children(game.app.world_mut(), game.world) {
            let level = COUNTS.iter().position(|count| *count == n).unwrap();
            let scene = game.app.world().get::<LoadedScene>(run).unwrap().scene().clone();
            let applied = game.app.world().get::<AppliedStyle>(run).expect("a look");
            for (found, base) in applied.colors().unwrap().iter().zip(scene.base_colors()) {
                for c in 0..3 {
                    let expected = content * base[c] + (1.0 - content) * color(level, cell)[c];
                    // Looks keep 256 numbers.
                    assert!((found[c] - expected).abs() < 0.005, "cell {cell}, level {level}: {found:?}");
                }
            }
        }
    };
    expect(&mut game, 0.0);
    // A change of the source reaches all runs, and knobs do at once.
    let mixed = StyleSource::chunk_looks("looks").with_content(0.5);
    game.app.world_mut().entity_mut(game.world).insert(mixed.clone());
    game.app.update();
    game.until_shown([200, 40, 8, 8]);
    expect(&mut game, 0.5);
    game.app.world_mut().entity_mut(game.world).insert(mixed.with_strength(0.3));
    game.app.update();
    game.app.update();
    for (run, ..) in children(game.app.world_mut(), game.world) {
        assert_eq!(game.app.world().get::<StyleSource>(run).unwrap().strength, 0.3);
    }
    game.app.world_mut().entity_mut(game.world).remove::<StyleSource>();
    let world = game.world;
    update_until(&mut game.app, "no look", |app| {
        children(app, world).iter().all(|(run, ..)| app.get::<AppliedStyle>(*run).is_none())
    });
}

/// One look is missing and one is of another scene. The levels are shown all the same, as captured.
#[test]
fn looks_that_cannot_be_had_are_told_and_hold_nothing_up() {
    let mut game = Game::new(|folder| {
        write_looks(folder);
        fs::rename(folder.join("looks/0.look.safetensors"), folder.join("later")).unwrap();
        fs::copy(folder.join("looks/2.look.safetensors"), folder.join("looks/1.look.safetensors")).unwrap();
    });
    game.app.world_mut().entity_mut(game.world).insert(StyleSource::chunk_looks("looks"));
    let mut told: Vec<GaussianWorldFailed> = Vec::new();
    update_until(&mut game.app, "two failures", |app| {
        told.extend(app.resource_mut::<Messages<GaussianWorldFailed>>().drain());
        told.len() >= 2
    });
    game.until_shown([200, 40, 8, 8]);
    let expect_captured = |game: &mut Game| {
        for (run, _, n) in children(game.app.world_mut(), game.world) {
            assert_eq!(game.app.world().get::<AppliedStyle>(run).is_some(), n == 8, "{n} Gaussians");
        }
    };
    expect_captured(&mut game);
    // The first one is there by now, but what has failed is not tried again for other runs.
    let folder = game.folder.path();
    fs::rename(folder.join("later"), folder.join("looks/0.look.safetensors")).unwrap();
    let at = Transform::from_xyz(60.0, 0.0, -46.0).looking_at(CENTERS[3], Vec3::Y);
    game.app.world_mut().entity_mut(game.camera).insert(at);
    game.until_shown([8, 8, 40, 200]);
    expect_captured(&mut game);
    told.extend(drain::<GaussianWorldFailed>(&mut game.app));
    told.sort_by(|a, b| a.file.cmp(&b.file));
    let files: Vec<&str> = told.iter().map(|failed| &*failed.file).collect();
    assert_eq!(files, ["looks/0.look.safetensors", "looks/1.look.safetensors"]);
    assert!(told[1].error.contains("a look of another scene"), "{}", told[1].error);
}
