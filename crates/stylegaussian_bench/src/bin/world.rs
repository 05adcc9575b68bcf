//! Makes worlds of any size for tests and measurements: `cargo xtask world`.
//!
//! Copies of scenes stand on hills. Levels of detail are merged once for each scene, and turned, scaled, tinted
//! and moved with each copy. So a world takes the time of packing its chunks, and the memory of one chunk for
//! each level, whatever its size.

use std::{
    f32::consts::TAU,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use clap::Parser;
use glam::{Affine3A, Quat, UVec2, Vec3, Vec3A};
use rayon::prelude::*;
use stylegaussian::{Axes, Scene, random::Random, sh, work::Work};
use stylegaussian_files::{
    read_scene,
    tile::{LeveledNode, TileOptions, WorldWriter, nodes},
};

/// Makes a world for tests and measurements: copies of scenes on hills, written as chunks that are streamed.
///
/// Each copy is turned about the vertical, a little smaller or larger than the others, and tinted, so no two
/// chunks are equal. Progress goes to stderr, and the counts to stdout. A call that was ended has to begin
/// anew.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask world")]
struct Arguments {
    /// The scenes, their y axes pointing down, or up if they say so. All are scaled to the size of the first.
    #[arg(value_name = "SCENE", default_value = "assets/demo.sgs")]
    scenes: Vec<PathBuf>,
    /// Gaussians of the finest level, rounded up to whole copies.
    #[arg(long, value_name = "N")]
    gaussians: u64,
    /// The folder of the world, a new one.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Levels of detail, each with a quarter of the Gaussians of the finer one.
    #[arg(long, value_name = "L", default_value_t = TileOptions::default().n_levels)]
    levels: usize,
    /// Most Gaussians of a chunk.
    #[arg(long, value_name = "N", default_value_t = TileOptions::default().chunk)]
    chunk: usize,
}

/// The share of a scene's Gaussians that may lie outside of its place on each side: copies overlap there.
const OUTSIDE: f64 = 0.01;

/// Wavelengths of the hills, in places of copies, and their heights in these wavelengths.
const HILLS: [(f32, f32); 3] = [(37.0, 0.05), (11.0, 0.03), (5.0, 0.015)];

/// The largest change of a copy's size, as a share of it.
const SIZES: f32 = 0.15;

/// The largest change of a copy's red, green and blue, as a share of each.
const TINTS: f32 = 0.15;

/// A scene in levels of detail.
struct Source {
    nodes: Vec<LeveledNode>,
    /// Gaussians of the finest level.
    len: u64,
    /// The point that stands on the ground.
    foot: Vec3,
    /// The longer side of its place on the ground.
    side: f32,
}

/// The place of a copy, and its color.
struct Placement {
    placed: Affine3A,
    turn: Quat,
    size: f32,
    tint: [f32; 3],
}

fn main() -> Result<()> {
    let Arguments { scenes, gaussians, output, levels, chunk } = Arguments::parse();
    ensure!(!output.exists(), "{}: exists, expected a new folder", output.display());
    let options = TileOptions { n_levels: levels, chunk, ..TileOptions::default() };
    let sources: Vec<Source> = scenes.iter().map(|path| source(path, &options)).collect::<Result<_>>()?;
    let side = sources[0].side;
    let mut writer = WorldWriter::new(&output, levels, chunk, false);
    let (mut written, mut n_copies, mut told) = (0, 0, 0);
    while written < gaussians {
        let mut random = Random::new(n_copies);
        let source = &sources[random.below(sources.len())];
        let placement = placement(n_copies, source, side, &mut random);
        let moved: Vec<LeveledNode> = source.nodes.par_iter().map(|node| moved(node, &placement)).collect();
        moved.iter().try_for_each(|node| writer.add(node))?;
        written += source.len;
        n_copies += 1;
        let percent = 100 * written / gaussians;
        if percent > told {
            eprintln!("{} %", percent.min(100));
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

/// Reads a scene and merges its levels.
fn source(path: &Path, options: &TileOptions) -> Result<Source> {
    let scene = read_scene(path)?.scene.with_sh_degree_at_most(0).into_owned();
    let mut scene = Scene { features: None, neighbors: None, decoder: None, mask: None, ..scene };
    if scene.up.is_some_and(|up| up.y > up.x.abs().max(up.z.abs())) {
        Axes::RUB.turn(&mut scene);
    }
    let bulk = scene.bulk(OUTSIDE);
    let [low, high] = bulk.with_context(|| format!("{}: a scene without Gaussians", path.display()))?;
    let side = (high - low).x.max((high - low).z);
    ensure!(side > 0.0, "{}: all Gaussians at one place, expected a scene", path.display());
    // Down is y: a copy stands on its largest y.
    let foot = Vec3::new((low.x + high.x) / 2.0, high.y, (low.z + high.z) / 2.0);
    Ok(Source { nodes: nodes(&scene, options, &Work::default())?, len: scene.len() as u64, foot, side })
}

/// The placement of a copy whose place on the ground has this `side`.
fn placement(copy: u64, source: &Source, side: f32, random: &mut Random) -> Placement {
    let at = cell(copy);
    let (x, z) = (at.x as f32, at.y as f32);
    let turn = Quat::from_rotation_y(TAU * random.uniform());
    let mut near_1 = |most: f32| 1.0 + most * (2.0 * random.uniform() - 1.0);
    let size = side / source.side * near_1(SIZES);
    let tint = [0; 3].map(|_| near_1(TINTS));
    let to = side * Vec3::new(x, -height(x, z), z);
    let placed =
        Affine3A::from_scale_rotation_translation(Vec3::splat(size), turn, to - turn * (size * source.foot));
    Placement { placed, turn, size, tint }
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

/// A node of a copy.
fn moved(node: &LeveledNode, placement: &Placement) -> LeveledNode {
    let Placement { placed, turn, size, tint } = *placement;
    let moved = |scene: &Scene| {
        let mut scene = scene.clone();
        scene.means.iter_mut().for_each(|mean| *mean = placed.transform_point3(*mean));
        scene.rotations.iter_mut().for_each(|rotation| *rotation = (turn * *rotation).normalize());
        scene.scales.iter_mut().for_each(|scale| *scale *= size);
        if let Some(captured) = &mut scene.sh {
            for dc in captured.coefficients.as_chunks_mut::<3>().0 {
                let color = sh::color_from_dc(*dc);
                *dc = sh::dc_from_color([0, 1, 2].map(|channel| tint[channel] * color[channel]));
            }
        }
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

    fn source() -> Source {
        let mut scene = Scene {
            means: vec![Vec3::ZERO, Vec3::new(3.0, 1.0, -2.0)],
            rotations: vec![Quat::IDENTITY; 2],
            scales: vec![Vec3::new(0.5, 0.1, 0.2); 2],
            opacities: vec![1.0; 2],
            order: vec![0, 1],
            n_source: 2,
            ..Scene::default()
        };
        scene.set_colors(&[[0.5, 0.25, 1.0]; 2]);
        let nodes = vec![LeveledNode::new(vec![scene])];
        Source { nodes, len: 2, foot: Vec3::new(1.5, 1.0, -1.0), side: 3.0 }
    }

    #[test]
    fn a_copy_stands_on_the_ground_in_its_place() {
        let source = source();
        let of = |copy: u64| placement(copy, &source, 6.0, &mut Random::new(copy));
        for copy in [0, 1, 14] {
            let (placed, at) = (of(copy).placed, cell(copy).as_vec2());
            let foot = placed.transform_point3(source.foot);
            let ground = 6.0 * Vec3::new(at.x, -height(at.x, at.y), at.y);
            assert!(foot.abs_diff_eq(ground, 1e-4), "{foot} {ground}");
            // Twice as large as the source, as its place is, give or take a little.
            assert!((of(copy).size / 2.0 - 1.0).abs() <= SIZES, "{}", of(copy).size);
        }
        assert!(of(0).tint != of(1).tint && of(0).turn != of(1).turn);
    }

    #[test]
    fn a_moved_node_is_in_its_box_and_tinted() {
        let source = source();
        let turn = Quat::from_rotation_y(0.7);
        let to = Vec3::new(10.0, 0.0, -5.0);
        let placed = Affine3A::from_scale_rotation_translation(Vec3::splat(2.0), turn, to);
        let node = moved(&source.nodes[0], &Placement { placed, turn, size: 2.0, tint: [1.0, 1.1, 0.9] });
        let tight = LeveledNode::new(node.levels.clone());
        let [low, high] = node.bounds;
        assert!(low.cmple(tight.bounds[0] + 1e-5).all() && high.cmpge(tight.bounds[1] - 1e-5).all());
        assert_eq!(node.levels[0].scales[1], Vec3::new(1.0, 0.2, 0.4));
        let color = Vec3::from(node.levels[0].base_colors()[1]);
        assert!(color.abs_diff_eq(Vec3::new(0.5, 0.275, 0.9), 1e-5), "{color}");
    }
}
