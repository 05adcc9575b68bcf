//! Blocks: sorted Gaussians in, nodes with all their levels out.

use std::{
    fs::{self, File},
    io::{BufWriter, Write},
    path::{Path, PathBuf},
};

use glam::Vec3;
use serde::{Deserialize, Serialize};
use stylegaussian::{scene::Scene, work::Work};

use super::{
    TileError, TileOptions, nodes,
    plan::{Plan, block_file},
    records,
    writer::LeveledNode,
};
use crate::{
    atomic::write_atomically,
    error::{FileError, mismatch},
    json,
};

/// The nodes of a leveled block. The file is written when all Gaussians are, and says that the block is done.
#[derive(Deserialize, Serialize)]
struct Nodes {
    /// Gaussians of each node at each level `[nodes, levels]`.
    counts: Vec<Vec<usize>>,
}

fn nodes_file(partial: &Path, block: usize) -> PathBuf {
    partial.join(format!("level_{block}.json"))
}

fn leveled_file(partial: &Path, block: usize) -> PathBuf {
    partial.join(format!("level_{block}.raw"))
}

/// Cuts a block into nodes and merges their levels, unless that is done.
pub(super) fn level(
    plan: &Plan,
    block: usize,
    partial: &Path,
    options: &TileOptions,
    work: &Work,
) -> Result<(), TileError> {
    work.check()?;
    let n = plan.counts[block];
    let done = nodes_file(partial, block);
    if n == 0 || done.is_file() {
        return Ok(());
    }
    let source = block_file(partial, block);
    let scene = records::scene(&records::read(&source, n, plan.degree)?, plan.degree, plan.filter());
    let nodes = nodes(&scene, options, work)?;
    drop(scene);
    write(&leveled_file(partial, block), &nodes, plan.degree)?;
    let counts = nodes.iter().map(|node| node.levels.iter().map(Scene::len).collect()).collect();
    let bytes = serde_json::to_vec(&Nodes { counts }).expect("numbers, which JSON holds");
    write_atomically(&done, |out| out.write_all(&bytes))?;
    // The disk has room for it; if it stays, it goes with the folder.
    let _ = fs::remove_file(&source);
    Ok(())
}

/// Writes the Gaussians of all nodes at all levels, and syncs them.
fn write(path: &Path, nodes: &[LeveledNode], degree: u8) -> Result<(), FileError> {
    let at = |source| FileError::Io { path: path.into(), source };
    let mut out = BufWriter::with_capacity(1 << 20, File::create(path).map_err(at)?);
    let mut record = vec![0.0; records::width(degree)];
    for scene in nodes.iter().flat_map(|node| &node.levels) {
        for i in 0..scene.len() {
            records::fill(&mut record, scene, i, Vec3::ZERO);
            out.write_all(bytemuck::cast_slice(&record)).map_err(at)?;
        }
    }
    let file = out.into_inner().map_err(|error| at(error.into_error()))?;
    file.sync_all().map_err(at)
}

/// The nodes of a block that was leveled.
pub(super) fn read(
    plan: &Plan,
    block: usize,
    partial: &Path,
    options: &TileOptions,
) -> Result<Vec<LeveledNode>, FileError> {
    if plan.counts[block] == 0 {
        return Ok(Vec::new());
    }
    let path = nodes_file(partial, block);
    let bytes = fs::read(&path).map_err(|source| FileError::Io { path: path.clone(), source })?;
    let Nodes { counts } = json::parse(&bytes, "the nodes of a block").map_err(|error| error.at(&path))?;
    let finest: usize = counts.iter().filter_map(|levels| levels.first()).sum();
    let has_all_levels = counts.iter().all(|levels| levels.len() == options.n_levels);
    if finest != plan.counts[block] || !has_all_levels {
        let found = format_args!("nodes of {finest} Gaussians").to_string();
        let expected = format_args!("{}: remove the folder, and start anew", plan.counts[block]).to_string();
        return Err(mismatch(found, expected).at(&path));
    }
    // The size of the file is compared with it before anything is allocated.
    let total = counts.iter().flatten().fold(0_usize, |sum, &n| sum.saturating_add(n));
    let all = records::read(&leveled_file(partial, block), total, plan.degree)?;
    let mut rest: &[f32] = &all;
    let mut take = |n: usize| {
        let (taken, left) = rest.split_at(n * records::width(plan.degree));
        rest = left;
        records::scene(taken, plan.degree, plan.filter())
    };
    let node = |levels: &Vec<usize>| LeveledNode::new(levels.iter().map(|&n| take(n)).collect());
    Ok(counts.iter().map(node).collect())
}
