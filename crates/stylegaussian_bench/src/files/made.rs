//! Files of all formats that are made here: by our writers, or number by number where we only read.

use std::fs;

use anyhow::Result;
use half::f16;
use stylegaussian::{
    Scene,
    scene::Sh,
    sh::{MAX_DEGREE, n_coefficients},
};
use stylegaussian_files::{WriteOptions, write_scene_with};

use super::{Files, Packing};
use crate::scenes::{self, Random};

/// Makers of files with so many Gaussians.
pub const ALL: [fn(usize) -> Result<Files>; 8] = [ply, sgs, glb, splat, spz_3, spz_4, compressed_ply, ksplat];

/// Coefficients beyond degree 0 of a Gaussian.
const N_REST: usize = 3 * (n_coefficients(MAX_DEGREE) - 1);

/// Standard deviation of these coefficients, of the order of those in captures.
const DEVIATION: f32 = 0.1;

/// Gaussians in a chunk of a compressed .ply and in a bucket of a .ksplat.
const CHUNK: usize = 256;

fn ply(n: usize) -> Result<Files> {
    written("3DGS .ply", "a.ply", n, 3, Packing::None)
}

fn sgs(n: usize) -> Result<Files> {
    written(".sgs", "a.sgs", n, 3, Packing::None)
}

fn glb(n: usize) -> Result<Files> {
    written("GLB", "a.glb", n, 3, Packing::None)
}

fn splat(n: usize) -> Result<Files> {
    written(".splat", "a.splat", n, 3, Packing::None)
}

fn spz_3(n: usize) -> Result<Files> {
    written("SPZ 3", "a.spz", n, 3, Packing::Gzip)
}

fn spz_4(n: usize) -> Result<Files> {
    written("SPZ 4", "a.spz", n, 4, Packing::Zstd)
}

fn written(
    name: &'static str,
    file_name: &'static str,
    n: usize,
    spz_version: u8,
    packing: Packing,
) -> Result<Files> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(file_name);
    write_scene_with(&path, &scene(n), WriteOptions { spz_version, ..WriteOptions::default() })?;
    Ok(Files::one(name, file_name, fs::read(&path)?, packing))
}

/// The structured scene, with spherical harmonics of degree 3 that are sums of uniform numbers, which compress
/// about as well as those of captures.
fn scene(n: usize) -> Scene {
    let mut scene = scenes::structured(n);
    let mut random = Random::new();
    let base = scene.base_colors();
    let coefficients = base.iter().flat_map(|&rgb| {
        let mut row = [0.0; 3 + N_REST];
        row[..3].copy_from_slice(&stylegaussian::sh::dc_from_color(rgb));
        // Three uniform numbers in -1..1 have variance 1.
        row[3..].fill_with(|| (0..3).map(|_| 2.0 * random.next() - 1.0).sum::<f32>() * DEVIATION);
        row
    });
    scene.sh = Some(Sh { degree: MAX_DEGREE, coefficients: coefficients.collect() });
    scene
}

/// PlayCanvas' compressed .ply: ranges of every 256 Gaussians, four words and 45 bytes for each.
fn compressed_ply(n: usize) -> Result<Files> {
    let n_chunks = n.div_ceil(CHUNK);
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement chunk {n_chunks}\n");
    for (kind, axes) in [("", "xyz"), ("scale_", "xyz"), ("", "rgb")] {
        for end in ["min", "max"] {
            axes.chars().for_each(|axis| header += &format!("property float {end}_{kind}{axis}\n"));
        }
    }
    header += &format!("element vertex {n}\n");
    ["position", "rotation", "scale", "color"]
        .iter()
        .for_each(|what| header += &format!("property uint packed_{what}\n"));
    header += &format!("element sh {n}\n");
    (0..N_REST).for_each(|i| header += &format!("property uchar f_rest_{i}\n"));
    header += "end_header\n";
    let mut random = Random::new();
    let mut bytes = header.into_bytes();
    // Positions, logarithms of scales, colors: a range of 1 each.
    let range =
        [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, -5.0, -5.0, -5.0, -4.0, -4.0, -4.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0_f32];
    (0..n_chunks).for_each(|_| bytes.extend(range.map(f32::to_le_bytes).as_flattened()));
    bytes.extend(random_bytes(&mut random, n * (16 + N_REST)));
    Ok(Files::one("compressed .ply", "a.ply", bytes, Packing::None))
}

/// A .ksplat of level 1: f16, and positions in steps from the centers of buckets.
fn ksplat(n: usize) -> Result<Files> {
    let n_buckets = n.div_ceil(CHUNK);
    let n = n_buckets * CHUNK;
    let mut bytes = vec![0; 4096 + 1024];
    let mut set = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    // Version 0.1, one section, level 1.
    set(1, &[1]);
    set(4, &1_u32.to_le_bytes());
    set(20, &1_u16.to_le_bytes());
    // Gaussians, room for them, size and number of buckets; their side, and the bytes of a center; full ones;
    // the degree.
    let section = [(0, n), (4, n), (8, CHUNK), (12, n_buckets), (32, n_buckets)];
    section.iter().for_each(|&(at, value)| set(4096 + at, &(value as u32).to_le_bytes()));
    set(4096 + 16, &5.0_f32.to_le_bytes());
    set(4096 + 20, &12_u16.to_le_bytes());
    set(4096 + 40, &u16::from(MAX_DEGREE).to_le_bytes());
    let mut random = Random::new();
    bytes.extend(random.many(3 * n_buckets, 10.0).iter().flat_map(|value| value.to_le_bytes()));
    let half = |value: f32| f16::from_f32(value).to_le_bytes();
    for _ in 0..n {
        bytes.extend(random_bytes(&mut random, 6));
        bytes.extend([0.01, 0.02, 0.03, 1.0, 0.1, 0.2, 0.3].map(half).as_flattened());
        bytes.extend(random_bytes(&mut random, 4));
        bytes.extend((0..N_REST).flat_map(|_| half(DEVIATION * (2.0 * random.next() - 1.0))));
    }
    Ok(Files::one(".ksplat", "a.ksplat", bytes, Packing::None))
}

fn random_bytes(random: &mut Random, n: usize) -> impl Iterator<Item = u8> {
    (0..n).map(|_| (256.0 * random.next()) as u8)
}
