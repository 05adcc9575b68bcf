//! The description of a world.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use stylegaussian_files::world::{FILE, World};

use crate::terminal::{lossy, print};

#[derive(Serialize)]
struct WorldInfo<'a> {
    #[serde(serialize_with = "lossy")]
    path: &'a Path,
    format: &'static str,
    /// Gaussians of the finest level of each part, which other commands read.
    n_gaussians: usize,
    /// The finest first.
    levels: Vec<LevelInfo>,
    /// Parts, each of which is shown at a level of its own.
    n_nodes: usize,
    n_chunks: usize,
    environment: Option<&'a str>,
    /// The box around all parts, in the coordinates of the file.
    bounds: Option<[[f32; 3]; 2]>,
}

#[derive(Serialize)]
struct LevelInfo {
    n_gaussians: u64,
    /// Parts that have this level.
    n_nodes: usize,
    n_chunks: usize,
}

/// Describes the world of the manifest at `path`.
///
/// # Errors
/// If stdout cannot be written.
pub fn run(path: &Path, world: &World, json: bool) -> Result<()> {
    let info = describe(path, world);
    print(json, &info, || text(&info))
}

fn describe<'a>(path: &'a Path, world: &'a World) -> WorldInfo<'a> {
    let finest = world.nodes.iter().filter_map(|node| node.levels.iter().flatten().next());
    let level = |level: usize| {
        let runs = || world.nodes.iter().filter_map(move |node| node.levels.get(level)?.as_ref());
        let mut chunks: Vec<usize> = runs().map(|run| run.file).collect();
        chunks.sort_unstable();
        chunks.dedup();
        LevelInfo { n_gaussians: world.count(level), n_nodes: runs().count(), n_chunks: chunks.len() }
    };
    WorldInfo {
        path,
        format: FILE,
        n_gaussians: finest.map(|run| run.range.len()).sum(),
        levels: (0..world.n_levels).map(level).collect(),
        n_nodes: world.nodes.len(),
        n_chunks: world.files.len(),
        environment: world.environment.as_deref(),
        bounds: world.bounds().map(|corners| corners.map(|corner| corner.to_array())),
    }
}

fn text(info: &WorldInfo) -> String {
    let WorldInfo { n_gaussians, n_nodes, n_chunks, .. } = info;
    let mut lines = vec![
        info.path.display().to_string(),
        format!("  format      levels of detail of a streamed SOG ({})", info.format),
        format!("  Gaussians   {n_gaussians} at the finest level of each part"),
        format!("  parts       {n_nodes}, in {n_chunks} chunks"),
    ];
    lines.extend(info.levels.iter().enumerate().map(|(i, level)| {
        let LevelInfo { n_gaussians, n_nodes, n_chunks } = level;
        format!("  level {i:<5} {n_gaussians} Gaussians in {n_nodes} parts, {n_chunks} chunks")
    }));
    lines.extend(info.environment.map(|file| format!("  surrounded  by {file}")));
    lines.push("  up          -y, as in all worlds: the format has no place for another".into());
    lines.extend(info.bounds.map(|[min, max]| format!("  bounds      {min:?} to {max:?}")));
    lines.join("\n")
}
