//! Tiling: scenes of any size as one [`World`], levels of detail in chunks that are streamed.
//!
//! Gaussians are sorted on disk into blocks along a Morton curve, each the size of a chunk. A block is cut into
//! nodes at medians, and each node is merged level by level ([`stylegaussian::merge`]). Nodes are then packed
//! into chunks. So the memory is that of a few chunks, whatever the size of the scenes. On disk, a Gaussian
//! takes 112 bytes while it is sorted, and after that 75 with its levels, beside the chunks; with spherical
//! harmonics of degree 3 it takes 472 and 315.
//!
//! In chunks, -y is up: scenes whose up direction is known are turned by quarter turns, with a warning.
//!
//! Chunks hold geometry, colors and spherical harmonics. SOG has no place for features, a decoder or a mask: a
//! scene that is to be decoded is kept whole.
//!
//! What is done stays in a folder `tile.partial` within the world's, and the same call goes on there after an
//! interruption of any kind: sorted blocks, leveled blocks, and chunks are not made again.

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;
use stylegaussian::{
    Scene,
    merge::merge,
    sh::MAX_DEGREE,
    work::{Canceled, Work},
};

use crate::{
    error::{FileError, Loaded, mismatch},
    world::{FILE, MAX_LEVELS, World},
};

mod block;
mod cut;
mod plan;
mod records;
#[cfg(test)]
mod tests;
mod writer;

pub use writer::{LeveledNode, WorldWriter};

use plan::Plan;

/// The ratio of a level's Gaussians to those of the next coarser one. Gaussians lie on surfaces, so this halves
/// the resolution.
pub const RATIO: usize = 4;

/// Nodes of a chunk, at least: a node is the smallest part of which the level is chosen. Each that is shown
/// takes dispatches of its own, so that smaller ones cost a frame more than they save: of 100 million
/// Gaussians, a cut of 400,000 took 1.8 times the frame of a single scene with 16, and 1.2 times with 4
/// (`cargo xtask fly`, software Vulkan).
const NODES_PER_CHUNK: usize = 4;

/// The folder of what is not complete.
const PARTIAL: &str = "tile.partial";

/// How a world is made.
#[derive(Clone, Debug, PartialEq)]
pub struct TileOptions {
    /// Number of levels, 1..=[`MAX_LEVELS`]. Each has a quarter of the Gaussians of the finer one.
    pub n_levels: usize,
    /// Most Gaussians of a chunk, 4 at least. A node has a quarter of them at most.
    pub chunk: usize,
    /// The largest side of the box around a node's means, in scene units, or `None` for any.
    pub cell: Option<f32>,
    /// The highest degree of spherical harmonics that is kept, 0..=3. All chunks have the highest degree of the
    /// scenes up to this one.
    pub sh_degree: u8,
}

impl Default for TileOptions {
    /// Five levels, the coarsest with 1/256 of the Gaussians, the chunks that writers of the format make, and
    /// all spherical harmonics.
    fn default() -> Self {
        Self { n_levels: 5, chunk: 512 << 10, cell: None, sh_degree: MAX_DEGREE }
    }
}

/// A world that was made.
#[derive(Debug)]
pub struct Tiled {
    /// The world, as it is on disk.
    pub world: World,
    /// Warnings of readers, and of what chunks cannot hold, one sentence each.
    pub warnings: Vec<String>,
}

/// A world that was not made.
#[derive(Debug, thiserror::Error)]
pub enum TileError {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Nobody wants it any more.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

/// Writes the Gaussians of all `slices` as a world to `folder`, which must be new, empty, or the one of an
/// interrupted call. `key` tells calls with other slices apart: an interrupted call goes on only under the same
/// key and options, and then does not ask for slices that it had sorted.
///
/// # Errors
/// If a slice is an error, options are out of range, there is no Gaussian, a file cannot be read or written,
/// the folder holds anything else, or `work` is canceled.
pub fn tile(
    slices: impl Iterator<Item = Result<Loaded, FileError>>,
    key: &str,
    folder: &Path,
    options: &TileOptions,
    work: &Work,
) -> Result<Tiled, TileError> {
    check(options).map_err(|error| error.at(folder))?;
    let partial = folder.join(PARTIAL);
    let plan = Plan::open(slices, key, folder, options, &work.part(0.0, 0.2))?;
    let n_blocks = plan.counts.len();
    for block in 0..n_blocks {
        let share = |done: usize| 0.2 + 0.5 * done as f32 / n_blocks as f32;
        block::level(&plan, block, &partial, options, &work.part(share(block), share(block + 1)))?;
    }
    let mut writer = WorldWriter::new(folder, options.n_levels, options.chunk, true);
    for block in 0..n_blocks {
        work.at(0.7 + 0.3 * block as f32 / n_blocks as f32)?;
        for node in block::read(&plan, block, &partial, options)? {
            writer.add(&node)?;
        }
    }
    let world = writer.finish()?;
    // The world is complete. What cannot be removed is of no use, and says so by its name.
    let _ = fs::remove_dir_all(&partial);
    Ok(Tiled { world, warnings: plan.warnings })
}

/// Cuts a scene into nodes and merges their levels, as [`tile`] does, in memory. A scene without Gaussians has
/// no nodes.
///
/// # Errors
/// If `work` is canceled.
pub fn nodes(scene: &Scene, options: &TileOptions, work: &Work) -> Result<Vec<LeveledNode>, Canceled> {
    let cells = cut::cells(&scene.means, (options.chunk / NODES_PER_CHUNK).max(1), options.cell);
    let total = cells.len();
    let scene = &*scene.with_sh_degree_at_most(options.sh_degree);
    let done = AtomicUsize::new(0);
    let leveled = |cell: &Vec<u32>| -> Result<LeveledNode, Canceled> {
        let mut finest = scene.subset(cell);
        finest.sort_by_morton();
        finest.order = (0..finest.len() as u32).collect();
        finest.n_source = finest.len();
        let mut levels = vec![finest];
        for _ in 1..options.n_levels {
            let finer = &levels[levels.len() - 1];
            // Some Gaussian is left at any level, or the node would be a hole.
            let mut coarser = merge(finer, finer.len().div_ceil(RATIO), &Work::default())?;
            coarser.sort_by_morton();
            coarser.order = (0..coarser.len() as u32).collect();
            levels.push(coarser);
        }
        let done = 1 + done.fetch_add(1, Ordering::Relaxed);
        work.at(done as f32 / total as f32)?;
        Ok(LeveledNode::new(levels))
    };
    cells.par_iter().map(leveled).collect()
}

/// Checks that options are in range.
fn check(options: &TileOptions) -> Result<(), crate::Mismatch> {
    if !(1..=MAX_LEVELS).contains(&options.n_levels) {
        let found = format_args!("{} levels", options.n_levels).to_string();
        return Err(mismatch(found, format_args!("1 to {MAX_LEVELS}")));
    }
    if options.chunk < NODES_PER_CHUNK {
        let found = format_args!("chunks of {} Gaussians", options.chunk).to_string();
        return Err(mismatch(found, format_args!("{NODES_PER_CHUNK} at least")));
    }
    if options.sh_degree > MAX_DEGREE {
        let found = format_args!("spherical harmonics of degree {}", options.sh_degree).to_string();
        return Err(mismatch(found, format_args!("0 to {MAX_DEGREE}")));
    }
    match options.cell.filter(|cell| !(cell.is_finite() && *cell > 0.0)) {
        Some(cell) => Err(mismatch(format_args!("cells of {cell} units"), "a finite size above 0")),
        None => Ok(()),
    }
}

/// Whether a folder holds a complete world.
fn is_complete(folder: &Path) -> bool {
    folder.join(FILE).is_file()
}
