//! Worlds: scenes at several levels of detail, in chunks that are read one at a time (`lod-meta.json`, a
//! streamed SOG of PlayCanvas).
//!
//! A [`World`] names its chunks, and says which Gaussians of which chunk show a node of its tree at a level. A
//! chunk is a scene of its own. [`SceneReader`](crate::SceneReader) reads it from its `meta.json`, and asks for
//! its planes by [`Reading::Needs`](crate::Reading::Needs), relative to that file:
//!
//! ```no_run
//! use std::path::Path;
//!
//! use stylegaussian_files::{read_scene, world::{FILE, World}};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = Path::new("city");
//! let path = folder.join(FILE);
//! let world = World::open(&path)?;
//! // The finest level of the first node.
//! if let Some(run) = &world.nodes[0].levels[0] {
//!     let path = folder.join(&world.files[run.file]);
//!     let chunk = read_scene(&path)?.scene;
//!     world.check_chunk(run.file, &chunk).map_err(|mismatch| mismatch.at(&path))?;
//!     println!("{} Gaussians", run.of(&chunk).len());
//! }
//! # Ok(())
//! # }
//! ```

use std::{
    collections::BTreeMap,
    ops::Range,
    path::{Path, PathBuf},
};

use glam::Vec3;
use serde::{Deserialize, Serialize};
use stylegaussian::Scene;

use crate::{
    bytes::read_bytes,
    error::{FileError, Mismatch, mismatch},
    json::parse,
    names::check_downward,
};

#[cfg(test)]
mod tests;
mod write;

/// The path of the look of a chunk in a folder of looks, by the chunk's path in [`World::files`]:
/// `0_0.look.safetensors` for `0_0/meta.json`, `a/b.look.safetensors` for `a/b.sog`.
pub fn look_of(file: &str) -> String {
    match file.strip_suffix("/meta.json") {
        Some(folder) => format!("{folder}.look.safetensors"),
        None => Path::new(file).with_extension("look.safetensors").to_string_lossy().into_owned(),
    }
}

/// The name of the file in a world's folder.
pub const FILE: &str = "lod-meta.json";

/// The up direction of all worlds, in the coordinates of their chunks. Files have no place for another one, so
/// [`tile`](crate::tile::tile) turns scenes until this is up, and readers give it to what they read of a world.
pub const UP: Vec3 = Vec3::NEG_Y;

/// The most levels of a world. Counts have 32 bits, so 32 levels that halve them end at one Gaussian.
pub const MAX_LEVELS: usize = 32;

/// The `lod-meta.json` that a path names: the file itself, or the one in the folder. `None` if there is none.
pub fn manifest_at(path: &Path) -> Option<PathBuf> {
    let file = if path.is_dir() { path.join(FILE) } else { path.into() };
    (file.file_name().is_some_and(|name| name == FILE) && file.is_file()).then_some(file)
}

/// Levels of detail of a scene, and the chunks that hold them.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// Number of levels, [`MAX_LEVELS`] at most. 0 is the finest.
    pub n_levels: usize,
    /// Paths of the chunks' `meta.json`, relative to the world's folder. They lead downward only.
    pub files: Vec<String>,
    /// Path of a chunk that surrounds the scene at every level, as those of `files`.
    pub environment: Option<String>,
    /// The leaves, in the order of the tree.
    pub nodes: Vec<Node>,
}

/// A part of space, and the Gaussians in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// The smallest and the largest corner of the box around its Gaussians at all levels, in the coordinates of
    /// the chunks. Boxes that this crate writes, and those of splat-transform, hold one standard deviation
    /// around each mean, and not all that is drawn.
    pub bounds: [Vec3; 2],
    /// Its Gaussians at each level `[n_levels]`, or `None` if it has none of their own. Level 0 is the finest.
    /// Each node has at least one level.
    pub levels: Vec<Option<Run>>,
}

/// Gaussians that follow one another in a chunk. No other node has any of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// The chunk, an index into [`World::files`].
    pub file: usize,
    /// The Gaussians in it.
    pub range: Range<usize>,
}

impl Run {
    /// Indices of the run's Gaussians in the scene that was read from its chunk. They are fewer than the
    /// [`range`](Self::range) if some were not finite, which readers drop.
    pub fn of(&self, chunk: &Scene) -> Range<usize> {
        let below = |end: usize| chunk.order.partition_point(|&i| (i as usize) < end);
        below(self.range.start)..below(self.range.end)
    }
}

/// The file's JSON.
#[derive(Deserialize, Serialize)]
struct Levels {
    version: Option<serde_json::Number>,
    #[serde(skip_deserializing)]
    asset: BTreeMap<&'static str, &'static str>,
    count: Option<u64>,
    counts: Option<Vec<u64>>,
    #[serde(rename = "lodLevels")]
    n_levels: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    environment: Option<String>,
    filenames: Vec<String>,
    tree: Tree,
}

#[derive(Deserialize, Serialize)]
struct Tree {
    bound: Option<Bound>,
    #[serde(skip_serializing_if = "Option::is_none")]
    children: Option<Vec<Tree>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lods: Option<BTreeMap<usize, Lod>>,
}

#[derive(Deserialize, Serialize)]
struct Bound {
    min: Option<[f32; 3]>,
    max: Option<[f32; 3]>,
}

#[derive(Deserialize, Serialize)]
struct Lod {
    file: usize,
    offset: usize,
    count: usize,
}

impl World {
    /// Reads the `lod-meta.json` at a path.
    ///
    /// # Errors
    /// If the file cannot be read, or as [`read`](Self::read).
    pub fn open(path: &Path) -> Result<Self, FileError> {
        Self::read(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
    }

    /// Reads a `lod-meta.json`.
    ///
    /// # Errors
    /// If it is none, is of a later version, or has no node; if a level, a count, a bound or a path contradicts
    /// the format; or if two nodes share Gaussians.
    pub fn read(json: &[u8]) -> Result<Self, Mismatch> {
        let levels: Levels = parse(json, EXPECTED)?;
        let (count, counts) = (levels.count, levels.counts.clone());
        let world = levels.world()?;
        world.check_bounds()?;
        let found: Vec<u64> = (0..world.n_levels).map(|level| world.count(level)).collect();
        if let Some(counts) = counts.filter(|counts| *counts != found) {
            let told = format_args!("counts {counts:?}").to_string();
            return Err(mismatch(told, format_args!("{found:?}, as in the tree")));
        }
        let total: u64 = found.iter().sum();
        match count.filter(|&count| count != total) {
            Some(count) => {
                Err(mismatch(format_args!("count {count}"), format_args!("{total}, as in the tree")))
            }
            None => Ok(world),
        }
    }

    /// As [`read`](Self::read), for readers that need no bounds. Nodes without them have NaN.
    pub(super) fn read_runs(json: &[u8]) -> Result<Self, Mismatch> {
        parse::<Levels>(json, EXPECTED)?.world()
    }

    /// Number of Gaussians of a level, without the environment. It is 0 of levels that the world does not have.
    pub fn count(&self, level: usize) -> u64 {
        let runs = self.nodes.iter().filter_map(|node| node.levels.get(level)?.as_ref());
        runs.map(|run| run.range.len() as u64).sum()
    }

    /// The world with each node at one level alone: `levels` `[nodes]`. A node without a level, or without
    /// Gaussians of its own at that level, is left out.
    pub fn only(&self, levels: &[Option<usize>]) -> Self {
        let at_level = |(node, level): (&Node, &Option<usize>)| {
            let level = (*level)?;
            let run = node.levels.get(level)?.clone()?;
            let mut levels = vec![None; node.levels.len()];
            levels[level] = Some(run);
            Some(Node { bounds: node.bounds, levels })
        };
        let nodes = self.nodes.iter().zip(levels).filter_map(at_level).collect();
        Self {
            n_levels: self.n_levels,
            files: self.files.clone(),
            environment: self.environment.clone(),
            nodes,
        }
    }

    /// The smallest and the largest corner of the box around all nodes, in the coordinates of the chunks, or
    /// `None` if there are none.
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        around(&self.nodes)
    }

    /// Checks that a chunk has all Gaussians that the nodes want of it. `file` is its index in
    /// [`files`](Self::files).
    ///
    /// # Errors
    /// If it has fewer.
    pub fn check_chunk(&self, file: usize, chunk: &Scene) -> Result<(), Mismatch> {
        let runs = self.nodes.iter().flat_map(|node| node.levels.iter().flatten());
        let wanted = runs.filter(|run| run.file == file).map(|run| run.range.end).max().unwrap_or(0);
        if wanted <= chunk.n_source {
            return Ok(());
        }
        let found = format_args!("a chunk of {} Gaussians", chunk.n_source).to_string();
        Err(mismatch(found, format_args!("at least {wanted}, which nodes of the world show")))
    }

    fn check_bounds(&self) -> Result<(), Mismatch> {
        if self.nodes.is_empty() {
            return Err(mismatch("a tree without Gaussians", "a node at least"));
        }
        let is_box = |[low, high]: [Vec3; 2]| low.is_finite() && high.is_finite() && low.cmple(high).all();
        match self.nodes.iter().position(|node| !is_box(node.bounds)) {
            Some(i) => {
                let [low, high] = self.nodes[i].bounds;
                let found = format_args!("node {i} with a box from {low} to {high}").to_string();
                Err(mismatch(found, "finite corners, the smaller one first"))
            }
            None => Ok(()),
        }
    }

    /// Checks that no two nodes have a Gaussian in common. A node may have the same run at several levels.
    fn check_overlaps(&self) -> Result<(), Mismatch> {
        let mut runs: Vec<(usize, usize, usize, usize)> = Vec::new();
        for (i, node) in self.nodes.iter().enumerate() {
            let used = node.levels.iter().flatten().filter(|run| !run.range.is_empty());
            runs.extend(used.map(|run| (run.file, run.range.start, run.range.end, i)));
        }
        runs.sort_unstable();
        runs.dedup();
        // Overlapping runs would let a small file ask for a large scene.
        let overlap = runs.windows(2).find(|pair| pair[0].0 == pair[1].0 && pair[0].2 > pair[1].1);
        match overlap {
            Some(pair) => {
                let found =
                    format_args!("nodes that share Gaussians of `{}`", self.files[pair[0].0]).to_string();
                Err(mismatch(found, "nodes with Gaussians of their own"))
            }
            None => Ok(()),
        }
    }
}

/// Ranges of runs by their files, ascending.
pub(crate) fn by_file<'a>(runs: impl Iterator<Item = &'a Run>) -> BTreeMap<usize, Vec<Range<usize>>> {
    let mut ranges: BTreeMap<usize, Vec<Range<usize>>> = BTreeMap::new();
    for run in runs {
        ranges.entry(run.file).or_default().push(run.range.clone());
    }
    ranges.values_mut().for_each(|ranges| ranges.sort_unstable_by_key(|range| range.start));
    ranges
}

/// The box around some nodes.
fn around(nodes: &[Node]) -> Option<[Vec3; 2]> {
    nodes.iter().map(|node| node.bounds).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
}

/// The file, for messages.
const EXPECTED: &str = "levels of detail of a streamed SOG";

impl Levels {
    fn world(self) -> Result<World, Mismatch> {
        if let Some(version) = self.version.as_ref().filter(|version| version.as_u64() != Some(1)) {
            return Err(mismatch(format_args!("streamed SOG version {version}"), "version 1 or none"));
        }
        self.filenames.iter().chain(&self.environment).try_for_each(|path| check_downward(path))?;
        let n_levels = self.n_levels;
        // A node has a place for every level.
        if n_levels > MAX_LEVELS {
            return Err(mismatch(format_args!("{n_levels} levels"), format_args!("at most {MAX_LEVELS}")));
        }
        let mut nodes = Vec::new();
        self.tree.collect(n_levels, self.filenames.len(), &mut nodes)?;
        let world = World { n_levels, files: self.filenames, environment: self.environment, nodes };
        world.check_overlaps()?;
        Ok(world)
    }
}

impl Tree {
    /// The nodes with Gaussians, in the order of the tree. The depth is bounded by the JSON parser.
    fn collect(&self, n_levels: usize, n_files: usize, nodes: &mut Vec<Node>) -> Result<(), Mismatch> {
        if let Some(lods) = self.lods.as_ref().filter(|lods| !lods.is_empty()) {
            let mut levels = vec![None; n_levels];
            for (&level, lod) in lods {
                let Some(place) = levels.get_mut(level) else {
                    let expected = format_args!("levels below {n_levels}").to_string();
                    return Err(mismatch(format_args!("level {level}"), expected));
                };
                *place = Some(lod.run(n_files)?);
            }
            let corner = |corner: Option<[f32; 3]>| corner.map_or(Vec3::NAN, Vec3::from);
            let bound = self.bound.as_ref();
            let bounds = [bound.and_then(|bound| bound.min), bound.and_then(|bound| bound.max)].map(corner);
            nodes.push(Node { bounds, levels });
        }
        self.children.iter().flatten().try_for_each(|child| child.collect(n_levels, n_files, nodes))
    }
}

impl Lod {
    fn run(&self, n_files: usize) -> Result<Run, Mismatch> {
        let Self { file, offset, count } = *self;
        if file >= n_files {
            let expected = format_args!("files below {n_files}").to_string();
            return Err(mismatch(format_args!("file {file} in the tree"), expected));
        }
        let Some(end) = offset.checked_add(count).filter(|&end| u32::try_from(end).is_ok()) else {
            let found = format_args!("{count} Gaussians from {offset} on").to_string();
            return Err(mismatch(found, "an end below 2^32"));
        };
        Ok(Run { file, range: offset..end })
    }
}
