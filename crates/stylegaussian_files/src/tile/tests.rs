use std::fs;

use glam::{Quat, Vec3};
use stylegaussian::{Axes, scene::Sh, sh};

use super::*;
use crate::{ReadOptions, read_scene, read_scene_with};

/// `n` Gaussians on a wavy ground of 20 x 20 units, some far below it.
fn ground(n: usize) -> Scene {
    let mean = |i: usize| {
        let (x, z) = ((i * 193 % 2000) as f32 / 100.0, (i * 577 % 1999) as f32 / 100.0);
        let far = if i % 500 == 7 { 300.0 } else { 0.0 };
        Vec3::new(x, x.sin() + far, z)
    };
    Scene {
        means: (0..n).map(mean).collect(),
        rotations: (0..n).map(|i| Quat::from_rotation_y(i as f32)).collect(),
        scales: (0..n).map(|i| Vec3::new(0.1, 0.01, 0.2) * (1.0 + (i % 3) as f32)).collect(),
        opacities: (0..n).map(|i| 0.2 + 0.1 * (i % 8) as f32).collect(),
        sh: Some(Sh { degree: 0, coefficients: (0..3 * n).map(|i| (i % 7) as f32 / 7.0).collect() }),
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    }
}

/// The scene in slices.
fn slices(scene: &Scene) -> impl Iterator<Item = Result<Loaded, FileError>> + '_ {
    let indices: Vec<u32> = (0..scene.len() as u32).collect();
    let slice = |indices: &[u32]| Ok(Loaded::new(scene.subset(indices), vec!["told once".into()]));
    indices.chunks(300).map(slice).collect::<Vec<_>>().into_iter()
}

const OPTIONS: TileOptions = TileOptions { n_levels: 3, chunk: 160, cell: None, sh_degree: 3 };

fn tiled(scene: &Scene, folder: &Path) -> Result<Tiled, TileError> {
    tile(slices(scene), "key", folder, &OPTIONS, &Work::default())
}

/// All files of a folder and their contents.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => all.extend(contents(&path)),
            false => all.push((path.display().to_string(), fs::read(&path).unwrap())),
        }
    }
    all.sort();
    all
}

#[test]
fn a_world_has_every_gaussian_once_and_a_quarter_at_each_level() {
    let dir = tempfile::tempdir().unwrap();
    let scene = ground(3000);
    let Tiled { world, warnings } = tiled(&scene, dir.path()).unwrap();
    assert_eq!(warnings, ["told once"]);
    assert!(!dir.path().join(PARTIAL).exists());
    let path = dir.path().join(FILE);
    assert_eq!(World::read(&fs::read(&path).unwrap()).unwrap(), world);
    assert_eq!(world.count(0), 3000);
    assert!((750..850).contains(&world.count(1)), "{}", world.count(1));
    // Rounded up in each node.
    assert!((187..187 + world.nodes.len() as u64).contains(&world.count(2)), "{}", world.count(2));
    assert!(world.nodes.len() >= 3000 / 40);
    for node in &world.nodes {
        let finest = node.levels[0].as_ref().unwrap();
        assert!(finest.range.len() <= 40, "{}", finest.range.len());
    }
    // Read as one scene, in any order: each coordinate is rounded, but to less than Gaussians are apart.
    let read = read_scene(&path).unwrap().scene;
    assert_eq!(read.len(), 3000);
    let sorted = |scene: &Scene| {
        let mut means: Vec<_> =
            scene.means.iter().map(|m| (m * 100.0).round().as_ivec3().to_array()).collect();
        means.sort_unstable();
        means
    };
    let (found, expected) = (sorted(&read), sorted(&scene));
    let differ = found.iter().zip(&expected).filter(|(a, b)| a[0].abs_diff(b[0]) > 1).count();
    assert_eq!(differ, 0);
    let coarse = ReadOptions { budget: Some(world.count(2) as usize), ..ReadOptions::default() };
    assert_eq!(read_scene_with(&path, coarse).unwrap().scene.len() as u64, world.count(2));
    // Every chunk is full but for a node.
    for (file, name) in world.files.iter().enumerate() {
        let chunk = read_scene(&dir.path().join(name)).unwrap().scene;
        world.check_chunk(file, &chunk).unwrap();
        assert!(chunk.len() <= OPTIONS.chunk, "{name}: {}", chunk.len());
    }
}

#[test]
fn scenes_are_set_upright() {
    let dir = tempfile::tempdir().unwrap();
    // Two slices, and one Gaussian far above the others.
    let scene = Scene { up: Some(Vec3::Y), ..ground(500) };
    let Tiled { world, warnings } = tiled(&scene, dir.path()).unwrap();
    assert_eq!((world.count(0), warnings.len()), (500, 2), "{warnings:?}");
    assert!(warnings[1].contains("up direction is [0, 1, 0]"), "{}", warnings[1]);
    // Half a turn about x.
    let read = read_scene(dir.path()).unwrap().scene;
    assert_eq!(read.up, Some(Vec3::NEG_Y));
    assert!(read.means.iter().all(|mean| mean.x > -0.01 && mean.y < 1.01 && mean.z < 0.01));
    assert_eq!(read.means.iter().filter(|mean| mean.y < -290.0).count(), 1);
    // Whatever axes a file is said to have, its chunks are turned with them.
    let options = ReadOptions { axes: Some(Axes::RUB), ..ReadOptions::default() };
    let told = read_scene_with(dir.path(), options).unwrap().scene;
    assert_eq!((told.up, told.means[7].y), (Some(Vec3::NEG_Y), -read.means[7].y));
}

#[test]
fn boxes_hold_a_deviation_around_their_gaussians() {
    let scene = ground(100);
    let node = LeveledNode::new(vec![scene.subset(&[5])]);
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    // The largest extent of the ellipsoid along an axis, by its definition over many directions.
    let mut most = Vec3::ZERO;
    for i in 0..200 {
        for j in 0..200 {
            let (a, b) = (i as f32 * 0.0315, j as f32 * 0.0158);
            let unit = Vec3::new(a.cos() * b.sin(), b.cos(), a.sin() * b.sin());
            let point = scene.rotations[5] * (unit * scene.scales[5]);
            most = most.max(Vec3::from(axes.map(|axis| point.dot(axis).abs())));
        }
    }
    let [low, high] = node.bounds;
    assert!((high - scene.means[5] - most).abs().max_element() < 1e-3, "{high} {most}");
    assert!((scene.means[5] - low - most).abs().max_element() < 1e-3, "{low} {most}");
}

#[test]
fn an_interrupted_call_goes_on_and_gives_the_same_files() {
    let scene = ground(2000);
    let whole = tempfile::tempdir().unwrap();
    let expected = tiled(&scene, whole.path()).unwrap().world;
    let dir = tempfile::tempdir().unwrap();
    // Stopped at every share, and called again: the first shares are those of sorting.
    for stop in [0.05, 0.15, 0.3, 0.5, 0.75, 0.9] {
        let work = std::sync::Arc::new(std::sync::OnceLock::<Work>::new());
        let seen = work.clone();
        let telling = Work::telling(move |share| {
            if share >= stop {
                seen.get().unwrap().cancel();
            }
        });
        work.set(telling.clone()).unwrap();
        let result = tile(slices(&scene), "key", dir.path(), &OPTIONS, &telling);
        assert!(matches!(result, Err(TileError::Canceled(_))), "{stop}");
        assert!(!dir.path().join(FILE).exists());
        if stop > 0.2 {
            // Another call is refused.
            let other = tile(slices(&scene), "other", dir.path(), &OPTIONS, &Work::default());
            let error = other.unwrap_err().to_string();
            assert!(error.contains("of another call") && error.contains(PARTIAL), "{error}");
        }
    }
    // What was sorted is not asked for again.
    let none =
        std::iter::from_fn(|| -> Option<Result<Loaded, FileError>> { panic!("slices are read again") });
    let world = tile(none, "key", dir.path(), &OPTIONS, &Work::default()).unwrap().world;
    assert_eq!(world, expected);
    let names = |folder: &Path| {
        let prefix = folder.display().to_string();
        let strip = |(name, bytes): (String, Vec<u8>)| (name.replacen(&prefix, "", 1), bytes);
        contents(folder).into_iter().map(strip).collect::<Vec<_>>()
    };
    assert!(names(dir.path()) == names(whole.path()));
    // A complete world is not written over, and neither is anything else.
    let error = tiled(&scene, dir.path()).unwrap_err().to_string();
    assert!(error.contains("a complete world"), "{error}");
}

#[test]
fn damaged_parts_and_foreign_folders_are_told() {
    let scene = ground(1500);
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("notes.txt"), "").unwrap();
    let error = tiled(&scene, dir.path()).unwrap_err().to_string();
    assert!(error.contains("`notes.txt` in it, expected an empty folder"), "{error}");
    fs::remove_file(dir.path().join("notes.txt")).unwrap();
    // Stopped after sorting; then a block is cut.
    let work = Work::default();
    let plan = Plan::open(slices(&scene), "key", dir.path(), &OPTIONS, &work).unwrap();
    assert_eq!(plan.counts.iter().sum::<usize>(), 1500);
    assert!(plan.counts.iter().all(|&n| n <= OPTIONS.chunk), "{:?}", plan.counts);
    let block = plan::block_file(&dir.path().join(PARTIAL), 1);
    let bytes = fs::read(&block).unwrap();
    fs::write(&block, &bytes[..bytes.len() - 1]).unwrap();
    let error = tiled(&scene, dir.path()).unwrap_err().to_string();
    assert!(error.contains("block_1.raw") && error.contains("start anew"), "{error}");
    fs::write(&block, &bytes).unwrap();
    let world = tiled(&scene, dir.path()).unwrap().world;
    // A chunk that was cut, and one that is missing.
    let plane = dir.path().join("1_0/scales.webp");
    let bytes = fs::read(&plane).unwrap();
    fs::write(&plane, &bytes[..bytes.len() / 2]).unwrap();
    let coarse = ReadOptions { budget: Some(world.count(1) as usize), ..ReadOptions::default() };
    let error = read_scene_with(dir.path(), coarse).unwrap_err().to_string();
    assert!(error.contains("`scales.webp`"), "{error}");
    fs::remove_file(dir.path().join("0_1/meta.json")).unwrap();
    let error = read_scene(dir.path()).unwrap_err().to_string();
    assert!(error.contains("0_1") && error.contains("No such file"), "{error}");
    // Nothing to write, and options out of range.
    let new = tempfile::tempdir().unwrap();
    assert!(tiled(&Scene::default(), new.path()).unwrap_err().to_string().contains("no Gaussian"));
    for options in [
        TileOptions { n_levels: 0, ..OPTIONS },
        TileOptions { n_levels: 33, ..OPTIONS },
        TileOptions { chunk: 3, ..OPTIONS },
        TileOptions { cell: Some(0.0), ..OPTIONS },
        TileOptions { sh_degree: 4, ..OPTIONS },
    ] {
        let other = tempfile::tempdir().unwrap();
        let result = tile(slices(&scene), "key", other.path(), &options, &Work::default());
        assert!(result.unwrap_err().to_string().contains("expected"), "{options:?}");
    }
}

/// The scene with coefficients of this degree, which look random.
fn with_harmonics(scene: Scene, degree: u8) -> Scene {
    let n = 3 * sh::n_coefficients(degree) * scene.len();
    let coefficients = (0..n).map(|i| (i as f32 * 1.3).sin() * 0.4).collect();
    Scene { sh: Some(Sh { degree, coefficients }), ..scene }
}

#[test]
fn chunks_keep_spherical_harmonics() {
    let scene = with_harmonics(ground(1500), 3);
    let nodes = nodes(&scene, &OPTIONS, &Work::default()).unwrap();
    // The finest level has the rows of the source.
    let rows = |scene: &Scene| -> Vec<[u32; 48]> {
        let coefficients = &scene.sh.as_ref().unwrap().coefficients;
        let mut rows: Vec<_> =
            coefficients.as_chunks::<48>().0.iter().map(|row| row.map(f32::to_bits)).collect();
        rows.sort_unstable();
        rows
    };
    let mut finest: Vec<_> = nodes.iter().flat_map(|node| rows(&node.levels[0])).collect();
    finest.sort_unstable();
    assert!(finest == rows(&scene));
    let dir = tempfile::tempdir().unwrap();
    let mut writer = WorldWriter::new(dir.path(), OPTIONS.n_levels, OPTIONS.chunk, false);
    nodes.iter().for_each(|node| writer.add(node).unwrap());
    let world = writer.finish().unwrap();
    let chunk = |name: &String| read_scene(&dir.path().join(name)).unwrap().scene;
    let chunks: Vec<Scene> = world.files.iter().map(chunk).collect();
    for (node, of_world) in nodes.iter().zip(&world.nodes) {
        for (level, run) in node.levels.iter().zip(&of_world.levels) {
            let run = run.as_ref().unwrap();
            let (found, expected) = (chunks[run.file].sh.as_ref().unwrap(), level.sh.as_ref().unwrap());
            assert_eq!((found.degree, run.range.len()), (3, level.len()));
            let found = &found.coefficients[48 * run.range.start..48 * run.range.end];
            // No chunk has more Gaussians than a palette has entries, so that numbers are rounded alone: to 256
            // between -0.4 and 0.4, which move by a step at most toward what is near.
            let most =
                found.iter().zip(&expected.coefficients).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(most < 1.5 * 0.8 / 255.0, "{most}");
        }
    }
    let plain = super::nodes(&scene, &TileOptions { sh_degree: 1, ..OPTIONS }, &Work::default()).unwrap();
    assert!(plain.iter().flat_map(|node| &node.levels).all(|level| level.sh.as_ref().unwrap().degree == 1));
}

#[test]
fn merged_harmonics_are_means_by_light() {
    // Of one size, so that their lights are as their opacities: 3 / 4 and 1 / 4.
    let two = Scene { scales: vec![Vec3::splat(0.1); 2], opacities: vec![0.6, 0.2], ..ground(2) };
    let two = with_harmonics(two, 2);
    let nodes = nodes(&two, &TileOptions { n_levels: 2, ..OPTIONS }, &Work::default()).unwrap();
    let [first, second] = two.sh.as_ref().unwrap().coefficients.as_chunks::<27>().0 else { unreachable!() };
    let merged = &nodes[0].levels[1].sh.as_ref().unwrap().coefficients;
    assert_eq!((nodes.len(), merged.len()), (1, 27));
    for i in 0..27 {
        let expected = 0.75 * first[i] + 0.25 * second[i];
        // Light is counted in pixels.
        let most = 0.01 * (first[i] - second[i]).abs() + 1e-6;
        assert!((merged[i] - expected).abs() < most, "{i}: {} and {expected}", merged[i]);
    }
}

#[test]
fn scenes_of_several_degrees_have_one_degree() {
    let part = |x: f32, sh: Option<Sh>| {
        let mut scene = Scene { sh, ..ground(20) };
        scene.means.iter_mut().for_each(|mean| mean.x = x + mean.x / 10.0);
        scene
    };
    let even = |degree: u8, value: f32| {
        Some(Sh { degree, coefficients: vec![value; 20 * 3 * sh::n_coefficients(degree)] })
    };
    let parts = [part(0.0, even(1, 0.5)), part(100.0, even(3, 0.25)), part(200.0, None)];
    let dir = tempfile::tempdir().unwrap();
    let slices = parts.into_iter().map(|scene| Ok(Loaded::new(scene, Vec::new())));
    let options = TileOptions { sh_degree: 2, ..OPTIONS };
    let Tiled { warnings, .. } = tile(slices, "key", dir.path(), &options, &Work::default()).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let read = read_scene(dir.path()).unwrap().scene;
    let colors = read.sh.as_ref().unwrap();
    assert_eq!((read.len(), colors.degree), (60, 2));
    for (mean, row) in read.means.iter().zip(colors.coefficients.as_chunks::<27>().0) {
        let expected = |i: usize| match mean.x {
            ..50.0 => [0.5, 0.0][usize::from(i >= 12)],
            ..150.0 => 0.25,
            _ => 0.0,
        };
        assert!((0..27).all(|i| (row[i] - expected(i)).abs() < 1e-6), "{mean}: {row:?}");
    }
}

#[test]
fn a_plan_is_of_one_degree() {
    let (scene, dir) = (ground(300), tempfile::tempdir().unwrap());
    Plan::open(slices(&scene), "key", dir.path(), &OPTIONS, &Work::default()).unwrap();
    let refused = |options: &TileOptions| {
        let error =
            tile(slices(&scene), "key", dir.path(), options, &Work::default()).unwrap_err().to_string();
        assert!(error.contains("of another call"), "{error}");
    };
    refused(&TileOptions { sh_degree: 2, ..OPTIONS });
    let path = dir.path().join(PARTIAL).join("plan.json");
    let plan = fs::read_to_string(&path).unwrap();
    assert!(plan.contains("\"degree\":0"), "{plan}");
    fs::write(&path, plan.replace("\"degree\":0", "\"degree\":200")).unwrap();
    refused(&OPTIONS);
}

#[test]
fn cells_are_halved_at_medians() {
    let means: Vec<Vec3> = (0..1000).map(|i| Vec3::new((i * 7 % 1000) as f32, 0.0, 0.0)).collect();
    let of = |most, size| cut::cells(&means, most, size);
    assert_eq!(of(1000, None).len(), 1);
    let halves = of(500, None);
    assert_eq!(halves.iter().map(Vec::len).collect::<Vec<_>>(), [500, 500]);
    assert!(halves[0].iter().all(|&i| means[i as usize].x < 500.0));
    assert_eq!(of(125, None).len(), 8);
    // For its size, a cell is cut while the halves have enough.
    assert_eq!(of(1000, Some(300.0)).len(), 2);
    // One place cannot be cut but by number.
    assert_eq!(cut::cells(&[Vec3::ONE; 10], 3, Some(1.0)).len(), 4);
    assert!(cut::cells(&[], 3, None).is_empty());
}
