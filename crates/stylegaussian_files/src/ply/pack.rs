//! Writing PlayCanvas' compressed .ply, whose layout [`compressed`](super::compressed) describes.
//!
//! Gaussians are written along the Morton curve and not in the source's order: a position has 11 bits within
//! the box of its chunk, so that those of a chunk must lie together.

use std::io::Write;

use glam::{Quat, Vec3};
use rayon::prelude::*;
use stylegaussian::{morton, scene::Scene, sh};

use super::{
    compressed::{CHUNK, COLOR_RANGES, PACKED, RANGES},
    write::{log_scale, write_start},
};
use crate::{
    distant,
    format::{Unwritten, WriteOptions},
};

/// Logarithms of sizes are kept within this, as SuperSplat does: e^-20 is invisible at any distance, and the
/// range of a chunk must not be spent on it.
const MOST_LOG_SCALE: f32 = 20.0;

/// Coefficients beyond degree 0 are from -4 to 4.
const MOST_COEFFICIENT: f32 = 4.0;

/// Writes a scene. Features, neighbors and decoder have no place in the file.
pub(crate) fn write(out: &mut dyn Write, scene: &Scene, _: &WriteOptions) -> Result<Vec<String>, Unwritten> {
    let order = morton::order(&scene.means);
    let chunks: Vec<Chunk> = order.par_chunks(CHUNK).map(|indices| Chunk::of(scene, indices)).collect();
    let n_rest = scene.sh.as_ref().map_or(0, |sh| 3 * (sh::n_coefficients(sh.degree) - 1));
    write_start(out, scene)?;
    writeln!(out, "element chunk {}", chunks.len())?;
    RANGES.iter().chain(&COLOR_RANGES).try_for_each(|name| writeln!(out, "property float {name}"))?;
    writeln!(out, "element vertex {}", scene.len())?;
    PACKED.iter().try_for_each(|name| writeln!(out, "property uint {name}"))?;
    if n_rest > 0 {
        writeln!(out, "element sh {}", scene.len())?;
        (0..n_rest).try_for_each(|i| writeln!(out, "property uchar f_rest_{i}"))?;
    }
    writeln!(out, "end_header")?;
    for chunk in &chunks {
        out.write_all(chunk.ranges.map(f32::to_le_bytes).as_flattened())?;
    }
    for word in chunks.iter().flat_map(|chunk| &chunk.words).flatten() {
        out.write_all(&word.to_le_bytes())?;
    }
    let mut n_clamped = 0;
    if let Some(sh) = scene.sh.as_ref().filter(|_| n_rest > 0) {
        let mut row = Vec::with_capacity(n_rest);
        for &i in &order {
            let rest = &sh.coefficients[i as usize * (3 + n_rest)..][3..3 + n_rest];
            n_clamped += usize::from(rest.iter().any(|value| value.abs() > MOST_COEFFICIENT));
            row.clear();
            // Channel-major in the file, RGB innermost in memory.
            (0..3)
                .for_each(|channel| row.extend(rest.iter().skip(channel).step_by(3).map(|&c| pack_rest(c))));
            out.write_all(&row)?;
        }
    }
    let clamped = (n_clamped > 0).then(|| {
        format!(
            "{n_clamped} Gaussians have spherical harmonics beyond degree 0 that a compressed .ply cannot \
             hold, which were clamped"
        )
    });
    Ok(distant::left_out(scene).into_iter().chain(clamped).collect())
}

/// Gaussians that are packed together.
struct Chunk {
    /// The smallest and the largest position, log scale and color.
    ranges: [f32; 18],
    /// Four words of each Gaussian.
    words: Vec<[u32; 4]>,
}

impl Chunk {
    fn of(scene: &Scene, indices: &[u32]) -> Self {
        let each = |of: &dyn Fn(usize) -> Vec3| indices.iter().map(|&i| of(i as usize)).collect::<Vec<_>>();
        let positions = each(&|i| scene.means[i]);
        let bounded = |log: f32| log.clamp(-MOST_LOG_SCALE, MOST_LOG_SCALE);
        let log_scales = each(&|i| Vec3::from(scene.scales[i].to_array().map(log_scale).map(bounded)));
        let colors = each(&|i| color(scene, i));
        let [of_positions, of_scales, of_colors] = [&positions, &log_scales, &colors].map(|v| Range::of(v));
        let mut ranges = [0.0; 18];
        for (place, range) in ranges.chunks_exact_mut(6).zip([of_positions, of_scales, of_colors]) {
            range.min.write_to_slice(place);
            range.max.write_to_slice(&mut place[3..]);
        }
        let word = |k: usize| {
            let i = indices[k] as usize;
            let [r, g, b] = of_colors.shares(colors[k]);
            [
                pack_11_10_11(of_positions.shares(positions[k])),
                pack_quaternion(scene.rotations[i]),
                pack_11_10_11(of_scales.shares(log_scales[k])),
                (pack(r, 8) << 24)
                    | (pack(g, 8) << 16)
                    | (pack(b, 8) << 8)
                    | pack(f64::from(scene.opacities[i]), 8),
            ]
        };
        Self { ranges, words: (0..indices.len()).map(word).collect() }
    }
}

/// The base color of Gaussian `i`, mid-gray if the scene keeps none.
fn color(scene: &Scene, i: usize) -> Vec3 {
    scene.sh.as_ref().map_or(Vec3::splat(0.5), |sh| {
        let at = i * 3 * sh::n_coefficients(sh.degree);
        let dc = &sh.coefficients[at..at + 3];
        Vec3::from(sh::color_from_dc([dc[0], dc[1], dc[2]]))
    })
}

/// The box around some values.
#[derive(Clone, Copy)]
struct Range {
    min: Vec3,
    max: Vec3,
}

impl Range {
    fn of(values: &[Vec3]) -> Self {
        let start = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
        values
            .iter()
            .fold(start, |range, &value| Self { min: range.min.min(value), max: range.max.max(value) })
    }

    /// The place of a value in the box, 0..1 along each axis.
    fn shares(self, value: Vec3) -> [f64; 3] {
        let (min, max, value) = (self.min.as_dvec3(), self.max.as_dvec3(), value.as_dvec3());
        [0, 1, 2].map(|i| if max[i] > min[i] { (value[i] - min[i]) / (max[i] - min[i]) } else { 0.0 })
    }
}

/// A number 0..1 in so many bits.
fn pack(share: f64, bits: u32) -> u32 {
    (share.clamp(0.0, 1.0) * f64::from((1_u32 << bits) - 1)).round() as u32
}

fn pack_11_10_11([x, y, z]: [f64; 3]) -> u32 {
    (pack(x, 11) << 21) | (pack(y, 10) << 11) | pack(z, 11)
}

/// The word of a unit quaternion: which component is largest, and the others, as the reader has it.
fn pack_quaternion(rotation: Quat) -> u32 {
    let wxyz = [rotation.w, rotation.x, rotation.y, rotation.z];
    let largest = (1..4).fold(0, |largest, i| if wxyz[i].abs() > wxyz[largest].abs() { i } else { largest });
    // q and -q are the same rotation, and the largest is taken for positive.
    let sign = if wxyz[largest] < 0.0 { -1.0 } else { 1.0 };
    let others = wxyz.iter().enumerate().filter(|&(i, _)| i != largest);
    others.fold(largest as u32, |word, (_, &value)| {
        (word << 10) | pack(f64::from(sign * value) * std::f64::consts::FRAC_1_SQRT_2 + 0.5, 10)
    })
}

/// The byte of a coefficient. Rounded down, since a byte stands for the middle of its step.
fn pack_rest(value: f32) -> u8 {
    // `as` clamps to 0..=255.
    ((value / (2.0 * MOST_COEFFICIENT) + 0.5) * 256.0).floor() as u8
}
