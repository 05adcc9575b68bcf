//! Parts of a world for jobs of their own: a chunk with what is around it, and the whole in few Gaussians.

use std::path::{Path, PathBuf};

use glam::Vec3;
use stylegaussian::Scene;

use crate::{
    error::{FileError, mismatch},
    read_scene,
    world::{FILE, Node, Run, UP, World, by_file},
};

/// The share of a chunk's longest side that is read around it by default. A picture of half of the chunk that
/// aims at its border shows a quarter of the side beyond it.
const HALO: f32 = 0.25;

/// The share of a chunk's Gaussians that may lie before its box, and behind it, along each axis: a few in the
/// sky would make all of the world its surroundings.
const OUTSIDE: f64 = 0.01;

/// A chunk of a world, and what is around it.
#[derive(Clone, Debug)]
pub struct Part {
    /// The chunk, as it is read alone, with the up direction of worlds.
    pub chunk: Scene,
    /// The chunk's Gaussians `[chunk.len()]`, and after them those around it, of the same level if there is
    /// one. It is its own source.
    pub with_halo: Scene,
    /// Warnings of readers, one sentence each.
    pub warnings: Vec<String>,
}

/// Reads a chunk of the world at `path`, a folder or its `lod-meta.json`, and all Gaussians that lie within
/// `halo` scene units of the box around most of it; `None` for a quarter of the chunk's longest side. `file` is
/// the chunk's path in the world.
///
/// # Errors
/// If a file cannot be read, the world has no such chunk, or the chunk is no single level of its nodes.
pub fn read_part(path: &Path, file: &str, halo: Option<f32>) -> Result<Part, FileError> {
    let (path, world) = open(path)?;
    let Some(own) = world.files.iter().position(|name| name == file) else {
        let found = format_args!("no chunk `{}`", file.escape_debug()).to_string();
        let expected = match &world.files[..] {
            [] => "a world with chunks".into(),
            [first, ..] => format!("one of its {} files, such as `{first}`", world.files.len()),
        };
        return Err(mismatch(found, expected).at(&path));
    };
    let level = level_of(&world, own).map_err(|found| {
        mismatch(format_args!("`{file}` with {found}"), "a chunk of one level of its nodes").at(&path)
    })?;
    let mut warnings = Vec::new();
    let chunk = read_chunk(&path, &world, own, &mut warnings)?;
    let mut with_halo = Scene::default();
    with_halo.append(&chunk);
    if let Some([low, high]) = chunk.bulk(OUTSIDE) {
        let halo = halo.unwrap_or(HALO * (high - low).max_element());
        let (low, high) = (low - halo, high + halo);
        let is_around = |mean: Vec3| mean.cmpge(low).all() && mean.cmple(high).all();
        let is_other = |node: &&Node| !node.levels.iter().flatten().any(|run| run.file == own);
        let meets = |node: &&Node| node.bounds[0].cmple(high).all() && node.bounds[1].cmpge(low).all();
        let others = world.nodes.iter().filter(is_other).filter(meets);
        for (other, ranges) in by_file(others.filter_map(|node| nearest(node, level))) {
            let scene = read_chunk(&path, &world, other, &mut warnings)?;
            let is_in = |row: u32| ranges.iter().any(|range| range.contains(&(row as usize)));
            let found = (0..scene.len() as u32)
                .filter(|&i| is_around(scene.means[i as usize]) && is_in(scene.order[i as usize]));
            with_halo.append(&scene.subset(&found.collect::<Vec<_>>()));
        }
    }
    Ok(Part { chunk, with_halo, warnings })
}

/// Reads the world at `path`, a folder or its `lod-meta.json`, in the fewest Gaussians: the coarsest level of
/// each node. The surroundings are left out. Returns warnings of readers with it.
///
/// # Errors
/// If a file cannot be read, or contradicts the world.
pub fn read_coarsest(path: &Path) -> Result<(Scene, Vec<String>), FileError> {
    let (path, world) = open(path)?;
    let (mut whole, mut warnings) = (Scene::default(), Vec::new());
    let coarsest = world.nodes.iter().filter_map(|node| node.levels.iter().rev().flatten().next());
    for (file, ranges) in by_file(coarsest) {
        let chunk = read_chunk(&path, &world, file, &mut warnings)?;
        for range in ranges {
            let indices = Run { file, range }.of(&chunk);
            whole.append(&chunk.subset(&(indices.start as u32..indices.end as u32).collect::<Vec<_>>()));
        }
    }
    Ok((whole, warnings))
}

/// The world at a path, and the path of its `lod-meta.json`.
fn open(path: &Path) -> Result<(PathBuf, World), FileError> {
    let path = if path.is_dir() { path.join(FILE) } else { path.into() };
    let world = World::open(&path)?;
    Ok((path, world))
}

/// Reads a chunk and checks it against its world.
fn read_chunk(
    path: &Path,
    world: &World,
    file: usize,
    warnings: &mut Vec<String>,
) -> Result<Scene, FileError> {
    let path = path.with_file_name(&world.files[file]);
    let loaded = read_scene(&path)?;
    world.check_chunk(file, &loaded.scene).map_err(|mismatch| mismatch.at(&path))?;
    let scene = Scene { up: Some(UP), ..loaded.scene };
    for warning in loaded.warnings {
        if !warnings.contains(&warning) {
            warnings.push(warning);
        }
    }
    Ok(scene)
}

/// The level of the nodes that a chunk has, the finest if they differ, or what is wrong with it.
fn level_of(world: &World, file: usize) -> Result<usize, &'static str> {
    let mut finest = None;
    for node in &world.nodes {
        let own = |run: &&Run| run.file == file && !run.range.is_empty();
        let mut runs = node.levels.iter().flatten().filter(own);
        let Some(first) = runs.next() else { continue };
        // A node may have one run at several levels.
        if runs.any(|run| run != first) {
            return Err("several levels of a node");
        }
        let level = node.levels.iter().position(|run| run.as_ref() == Some(first));
        finest = finest.into_iter().chain(level).min();
    }
    finest.ok_or("nothing that a node shows")
}

/// The run of a node at a level, or at the nearest coarser one, or else at the nearest finer one.
fn nearest(node: &Node, level: usize) -> Option<&Run> {
    let (finer, from_level) = node.levels.split_at(level.min(node.levels.len()));
    from_level.iter().flatten().next().or_else(|| finer.iter().rev().flatten().next())
}

#[cfg(test)]
mod tests {
    use glam::Quat;
    use stylegaussian::work::Work;

    use super::*;
    use crate::{
        Loaded,
        tile::{TileOptions, tile},
    };

    /// A world of 40 x 40 Gaussians on a plane, in chunks of at most 256.
    fn world(folder: &Path) -> World {
        let mut scene = Scene {
            means: (0..1600).map(|i| Vec3::new((i % 40) as f32, 0.0, (i / 40) as f32)).collect(),
            rotations: vec![Quat::IDENTITY; 1600],
            scales: vec![Vec3::new(0.5, 0.01, 0.5); 1600],
            opacities: vec![0.9; 1600],
            order: (0..1600).collect(),
            n_source: 1600,
            ..Scene::default()
        };
        scene.set_colors(&[[0.2, 0.4, 0.6]; 1600]);
        let options = TileOptions { n_levels: 2, chunk: 256, ..TileOptions::default() };
        let slices = std::iter::once(Ok(Loaded::new(scene, Vec::new())));
        tile(slices, "", folder, &options, &Work::default()).unwrap().world
    }

    #[test]
    fn a_chunk_comes_with_all_that_is_around_it() {
        let dir = tempfile::tempdir().unwrap();
        let world = world(dir.path());
        let all = read_scene(dir.path()).unwrap().scene;
        let first = world.files.iter().find(|name| name.starts_with("0_")).unwrap();
        for halo in [0.0, 3.0, 100.0] {
            let Part { chunk, with_halo, warnings } = read_part(dir.path(), first, Some(halo)).unwrap();
            assert!(warnings.is_empty() && with_halo.validate().is_ok());
            assert_eq!([chunk.up, with_halo.up], [Some(Vec3::NEG_Y); 2]);
            let n = chunk.len();
            assert!(n <= 256);
            assert_eq!((&with_halo.means[..n], with_halo.n_source), (&chunk.means[..], with_halo.len()));
            // By the definition, over all Gaussians of the finest level. Coordinates are rounded.
            let [low, high] = chunk.bulk(OUTSIDE).unwrap();
            let is_around =
                |mean: Vec3, halo: f32| mean.cmpge(low - halo).all() && mean.cmple(high + halo).all();
            let count = |halo: f32| all.means.iter().filter(|mean| is_around(**mean, halo)).count();
            let own = |halo: f32| chunk.means.iter().filter(|mean| is_around(**mean, halo)).count();
            let around = with_halo.len() - n;
            let expected = [halo - 0.1, halo + 0.1].map(|halo| count(halo) - own(halo));
            assert!((expected[0]..=expected[1]).contains(&around), "{halo}: {around}, {expected:?}");
            assert!(halo == 0.0 || around > 0);
        }
        // By default, a quarter of the chunk's side.
        let by_default = read_part(&dir.path().join(FILE), first, None).unwrap();
        let [low, high] = by_default.chunk.bulk(OUTSIDE).unwrap();
        let told = read_part(dir.path(), first, Some(0.25 * (high - low).max_element())).unwrap();
        assert_eq!(by_default.with_halo.means, told.with_halo.means);
        // A coarser chunk has Gaussians of its own level around it.
        let last = world.files.iter().rfind(|name| name.starts_with("1_")).unwrap();
        let coarse = read_part(dir.path(), last, Some(100.0)).unwrap();
        assert_eq!(coarse.with_halo.len() as u64, world.count(1));
        let (whole, _) = read_coarsest(dir.path()).unwrap();
        assert_eq!((whole.len() as u64, whole.validate().is_ok()), (world.count(1), true));
        assert_eq!(whole.up, Some(Vec3::NEG_Y));
    }

    #[test]
    fn chunks_that_are_none_are_told() {
        let dir = tempfile::tempdir().unwrap();
        let mut world = world(dir.path());
        let refused = |file: &str| read_part(dir.path(), file, None).unwrap_err().to_string();
        let error = refused("../0_0/meta.json");
        assert!(error.contains("no chunk `../0_0/meta.json`") && error.contains("such as `"), "{error}");
        // A node whose two levels lie in one chunk, and a chunk that nobody shows.
        let unused = world.files.len();
        world.files.push("9_9/meta.json".into());
        let levels = &mut world.nodes[0].levels;
        let Run { file, range } = levels[0].clone().unwrap();
        let middle = (range.start + range.end) / 2;
        levels[0] = Some(Run { file, range: range.start..middle });
        levels[1] = Some(Run { file, range: middle..range.end });
        std::fs::write(dir.path().join(FILE), world.write()).unwrap();
        assert!(refused(&world.files[file]).contains("several levels of a node"));
        assert!(refused(&world.files[unused]).contains("nothing that a node shows"));
        // The others still are chunks, unless they are missing.
        let other = world.files.iter().find(|name| name.starts_with("1_")).unwrap();
        std::fs::remove_file(dir.path().join(other)).unwrap();
        assert!(refused(other).contains(other));
    }
}
