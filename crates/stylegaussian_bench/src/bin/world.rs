//! Makes worlds of any size for tests and measurements: `cargo xtask world`.
//!
//! Copies of a scene stand on hills. Levels of detail are merged once, in the scene, and turned and moved with
//! each copy, so a world takes the time of packing its chunks, and the memory of one chunk for each level.

use std::{f32::consts::TAU, path::PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Parser;
use glam::{Affine3A, Quat, UVec2, Vec3, Vec3A};
use stylegaussian::{Scene, random::Random, work::Work};
use stylegaussian_files::{
    read_scene,
    tile::{LeveledNode, TileOptions, WorldWriter, nodes},
};

/// Makes a world of about N Gaussians at its finest level: copies of a scene on hills, in chunks that are
/// streamed.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask world")]
struct Arguments {
    /// Gaussians of the finest level, rounded up to whole copies.
    #[arg(value_name = "N")]
    n_gaussians: u64,
    /// The folder of the world, a new one.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// The scene, its y axis pointing down.
    #[arg(long, value_name = "FILE", default_value = "assets/demo.sgs")]
    scene: PathBuf,
    /// Levels of detail.
    #[arg(long, value_name = "L", default_value_t = 5)]
    levels: usize,
    /// Most Gaussians of a chunk.
    #[arg(long, value_name = "N", default_value_t = TileOptions::default().chunk)]
    chunk: usize,
}

/// The share of a scene's Gaussians that may lie outside of its place on each side: copies overlap there.
const OUTSIDE: f64 = 0.01;

/// Wavelengths of the hills, in places of copies, and their heights in these wavelengths.
const HILLS: [(f32, f32); 3] = [(37.0, 0.05), (11.0, 0.03), (5.0, 0.015)];

fn main() -> Result<()> {
    let Arguments { n_gaussians, output, scene: path, levels, chunk } = Arguments::parse();
    ensure!(!output.exists(), "{}: exists, expected a new folder", output.display());
    let scene = read_scene(&path)?.scene.with_sh_degree_at_most(0).into_owned();
    let scene = Scene { features: None, neighbors: None, decoder: None, mask: None, ..scene };
    let [low, high] = scene.bulk(OUTSIDE).context("a scene without Gaussians")?;
    let place = (high - low).x.max((high - low).z);
    // Down is y: a copy stands on its largest y.
    let foot = Vec3::new((low.x + high.x) / 2.0, high.y, (low.z + high.z) / 2.0);
    let options = TileOptions { n_levels: levels, chunk, ..TileOptions::default() };
    let nodes = nodes(&scene, &options, &Work::default())?;
    let n_copies = n_gaussians.div_ceil(scene.len() as u64);
    let mut writer = WorldWriter::new(&output, levels, chunk, false);
    let mut told = 0;
    for copy in 0..n_copies {
        let at = cell(copy);
        let (x, z) = (at.x as f32, at.y as f32);
        let turn = Quat::from_rotation_y(TAU * Random::new(copy).uniform());
        let to = Vec3::new(x * place, -height(x, z) * place, z * place);
        let placed = Affine3A::from_rotation_translation(turn, to - turn * foot);
        for node in &nodes {
            writer.add(&moved(node, placed, turn))?;
        }
        let percent = 100 * (copy + 1) / n_copies;
        if percent > told {
            eprintln!("{percent} %");
            told = percent;
        }
    }
    let world = writer.finish()?;
    let counts: Vec<String> = (0..levels).map(|level| world.count(level).to_string()).collect();
    println!(
        "{}: {} Gaussians, {n_copies} copies, {} parts in {} chunks",
        output.display(),
        counts.join(", "),
        world.nodes.len(),
        world.files.len()
    );
    Ok(())
}

/// The place of a copy along a Morton curve of the plane, so that copies in a chunk are near one another.
fn cell(copy: u64) -> UVec2 {
    let mut cell = UVec2::ZERO;
    for bit in 0..32 {
        cell.x |= ((copy >> (2 * bit)) as u32 & 1) << bit;
        cell.y |= ((copy >> (2 * bit + 1)) as u32 & 1) << bit;
    }
    cell
}

/// The height of the hills, in places of copies.
fn height(x: f32, z: f32) -> f32 {
    let waves = HILLS.iter().map(|(length, height)| {
        height * length * ((TAU * x / length).sin() + (TAU * (z + 0.3 * x) / length).cos())
    });
    waves.sum()
}

/// A node turned and moved.
fn moved(node: &LeveledNode, placed: Affine3A, turn: Quat) -> LeveledNode {
    let moved = |scene: &Scene| {
        let mut scene = scene.clone();
        scene.means.iter_mut().for_each(|mean| *mean = placed.transform_point3(*mean));
        scene.rotations.iter_mut().for_each(|rotation| *rotation = (turn * *rotation).normalize());
        scene
    };
    let [low, high] = node.bounds;
    let (center, half) = (Vec3A::from(low + high) / 2.0, Vec3A::from(high - low) / 2.0);
    let center = placed.transform_point3a(center);
    let matrix = placed.matrix3;
    let half = matrix.x_axis.abs() * half.x + matrix.y_axis.abs() * half.y + matrix.z_axis.abs() * half.z;
    let bounds = [center - half, center + half].map(Vec3::from);
    LeveledNode { bounds, levels: node.levels.iter().map(moved).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_fill_squares() {
        let cells: Vec<_> = (0..16).map(cell).collect();
        assert_eq!(cells[..4], [(0, 0), (1, 0), (0, 1), (1, 1)].map(UVec2::from));
        assert!((0..4).all(|x| (0..4).all(|y| cells.contains(&UVec2::new(x, y)))));
    }

    #[test]
    fn a_moved_node_is_in_its_box() {
        let scene = Scene {
            means: vec![Vec3::ZERO, Vec3::new(3.0, 1.0, -2.0)],
            rotations: vec![Quat::IDENTITY; 2],
            scales: vec![Vec3::new(0.5, 0.1, 0.2); 2],
            opacities: vec![1.0; 2],
            order: vec![0, 1],
            n_source: 2,
            ..Scene::default()
        };
        let turn = Quat::from_rotation_y(0.7);
        let placed = Affine3A::from_rotation_translation(turn, Vec3::new(10.0, 0.0, -5.0));
        let node = moved(&LeveledNode::new(vec![scene]), placed, turn);
        let tight = LeveledNode::new(node.levels.clone());
        let [low, high] = node.bounds;
        assert!(low.cmple(tight.bounds[0] + 1e-5).all() && high.cmpge(tight.bounds[1] - 1e-5).all());
    }
}
