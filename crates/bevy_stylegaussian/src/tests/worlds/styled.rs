//! Styles of worlds: parts that arrive painted, in turn, and keep their strokes.

use std::sync::Arc;

use bevy::platform::collections::{HashMap, HashSet};
use stylegaussian::strokes::{StrokeWord, Strokes};

use super::*;
use crate::{HiddenUntilStyled, StyleThreads, tests::paint::noise};

/// Once a cell shows paint, it shows nothing else, whatever level comes.
#[test]
fn levels_arrive_in_the_style_of_their_world() {
    let mut game = Game::new(|_| {});
    let painting = add(&mut game.app, noise(1, [200, 40, 30], [20, 40, 180]));
    let style = (StyleSource::image(painting), HiddenUntilStyled);
    game.app.world_mut().entity_mut(game.world).insert(style);
    let world = game.world;
    let mut painted = HashSet::new();
    update_until(&mut game.app, "a painted world", |app| {
        for (run, cell, _) in children(app, world) {
            assert!(app.get::<AppliedStyle>(run).is_some(), "cell {cell} is shown without paint");
            painted.insert(run);
        }
        let is_settled = app.get::<WorldState>(world).is_some_and(WorldState::is_settled);
        is_settled && shown(app, world) == [200, 40, 8, 8]
    });
    assert!(painted.len() > 4, "finer levels took the place of coarser ones");
    // The next style reaches all that is shown, and no style takes all of it away.
    let next = add(&mut game.app, noise(2, [20, 140, 30], [240, 240, 180]));
    game.app.world_mut().entity_mut(world).insert(StyleSource::image(next.clone()));
    update_until(&mut game.app, "the next style", |app| {
        let source = StyleSource::image(next.clone());
        let runs = children(app, world);
        let has = |run: &Entity| app.get::<StyleSource>(*run) == Some(&source);
        runs.iter().all(|(run, ..)| has(run))
            && app.get::<WorldState>(world).is_some_and(WorldState::is_settled)
    });
    game.app.world_mut().entity_mut(world).remove::<StyleSource>();
    update_until(&mut game.app, "no style", |app| {
        let runs = children(app, world);
        runs.iter().all(|(run, ..)| app.get::<AppliedStyle>(*run).is_none())
    });
}

/// Cells before the camera, and half of those behind it.
const SEEN: usize = 100;

/// Writes a world of small cells in three grids, of which a camera sees the first.
fn write_many_cells(folder: &Path) {
    let n = 3 * SEEN;
    let center = |i: usize| {
        let [x, y] = [i % 10, i / 10 % 10].map(|i| 2.0 * i as f32 - 9.0);
        Vec3::new(x, y, [-40.0, 40.0, 50.0][i / SEEN])
    };
    let mut scene = Scene { features: None, decoder: None, ..small_scene(8 * n, 1) };
    for (i, mean) in scene.means.iter_mut().enumerate() {
        *mean += center(i / 8);
    }
    write_scene(&folder.join("0.sog"), &scene).unwrap();
    let cell = |i: usize| Cell {
        bounds: [center(i) - Vec3::ONE, center(i) + Vec3::ONE],
        levels: vec![Some(Run { file: 0, range: 8 * i..8 * (i + 1) })],
    };
    let nodes = (0..n).map(cell).collect();
    let levels = Levels { n_levels: 1, files: vec!["0.sog".into()], environment: None, nodes };
    fs::write(folder.join(FILE), levels.write()).unwrap();
}

#[test]
fn many_parts_are_painted_at_a_time_and_those_that_are_seen_first() {
    let mut game = Game::new(write_many_cells);
    game.app.insert_resource(GaussianBudget { gaussians: 10_000, ..default() });
    let world = game.world;
    let is_settled = move |app: &mut World| app.get::<WorldState>(world).is_some_and(WorldState::is_settled);
    update_until(&mut game.app, "all cells", is_settled);
    let painting = add(&mut game.app, noise(1, [200, 40, 30], [20, 40, 180]));
    game.app.world_mut().entity_mut(world).insert(StyleSource::image(painting));
    // The first to be painted. The scene that they are painted like is hidden.
    let mut given = Vec::new();
    update_until(&mut game.app, "a first part", |app| {
        let mut runs = app.query_filtered::<(&LoadedScene, &Visibility), With<StyleSource>>();
        let shown = runs.iter(app).filter(|(_, visibility)| **visibility != Visibility::Hidden);
        given = shown.map(|(scene, _)| scene.scene().means[0].z).collect();
        !given.is_empty()
    });
    // Two threads, and 64 of the smallest for each.
    assert_eq!(given.len(), 128);
    assert_eq!(given.iter().filter(|z| **z < 0.0).count(), SEEN);
    update_until(&mut game.app, "a painted world", is_settled);
    let mut painted = game.app.world_mut().query_filtered::<&Visibility, With<AppliedStyle>>();
    let shown = painted.iter(game.app.world()).filter(|visibility| **visibility != Visibility::Hidden);
    assert_eq!(shown.count(), 3 * SEEN);
}

#[test]
fn parts_that_are_shown_are_painted_before_those_that_wait() {
    let mut game = Game::new(write_many_cells);
    game.app.insert_resource(GaussianBudget { gaussians: 10_000, ..default() });
    game.app.insert_resource(StyleThreads { count: 1, ..QUICK_THREADS });
    let world = game.world;
    update_until(&mut game.app, "all cells", |app| {
        app.get::<WorldState>(world).is_some_and(WorldState::is_settled)
    });
    // Half of those that are seen, as if they waited behind coarser ones.
    let mut cells = game.app.world_mut().query::<(Entity, &LoadedScene)>();
    let seen = cells.iter(game.app.world()).filter(|(_, scene)| scene.scene().means[0].z < 0.0);
    let (waiting, shown): (Vec<_>, Vec<_>) =
        seen.map(|(run, _)| run).enumerate().partition(|(i, _)| i % 2 == 0);
    assert_eq!([waiting.len(), shown.len()], [SEEN / 2; 2]);
    for (_, run) in &waiting {
        game.app.world_mut().entity_mut(*run).insert(Visibility::Hidden);
    }
    let painting = add(&mut game.app, noise(1, [200, 40, 30], [20, 40, 180]));
    game.app.world_mut().entity_mut(world).insert(StyleSource::image(painting));
    let count = |app: &World, runs: &[(usize, Entity)]| {
        runs.iter().filter(|(_, run)| app.get::<StyleSource>(*run).is_some()).count()
    };
    update_until(&mut game.app, "a first part", |app| count(app, &shown) + count(app, &waiting) > 0);
    // One thread, and 64 of the smallest.
    let app = game.app.world();
    assert_eq!([count(app, &shown), count(app, &waiting)], [SEEN / 2, 64 - SEEN / 2]);
}

#[test]
fn a_finer_level_keeps_the_strokes_of_the_coarser_one() {
    let mut game = Game::new(|_| {});
    let painting = add(&mut game.app, noise(1, [200, 40, 30], [20, 40, 180]));
    let style = (StyleSource::image(painting), HiddenUntilStyled);
    game.app.world_mut().entity_mut(game.world).insert(style);
    let world = game.world;
    // The strokes of the first cell, by its Gaussians.
    let mut levels: HashMap<usize, Arc<Strokes>> = HashMap::default();
    let [finest, _, coarsest] = COUNTS;
    update_until(&mut game.app, "both levels", |app| {
        for (run, cell, n) in children(app, world) {
            let strokes = app.get::<AppliedStyle>(run).and_then(AppliedStyle::strokes);
            if let Some(strokes) = strokes.filter(|_| cell == 0) {
                levels.insert(n, Arc::clone(strokes));
            }
        }
        levels.contains_key(&finest) && levels.contains_key(&coarsest)
    });
    let (fine, coarse) = (&levels[&finest], &levels[&coarsest]);
    // Neither has a Gaussian of the other, so seeds of its own would be elsewhere.
    let has_both = |word: &&u32| {
        let seed = fine.seeds[StrokeWord::unpacked(**word).seed as usize];
        coarse.seeds.contains(&seed)
    };
    let n = fine.words.iter().filter(has_both).count();
    assert!(10 * n > 8 * finest, "{n} of {finest} Gaussians");
}
