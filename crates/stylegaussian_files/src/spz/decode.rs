//! From the bytes of an SPZ file to Gaussians.

use std::f32::consts::FRAC_1_SQRT_2;

use glam::{Quat, Vec3};
use half::f16;
use rayon::prelude::*;
use stylegaussian::{
    scene::{Scene, ScreenFilter, Sh},
    sh,
};

use super::{container::Contents, header::ANTIALIASED};
use crate::{activate::drop_broken, pages::enlarge};

/// The scene in the file's own axes. Gaussians that are not finite are dropped with a warning; only the f16
/// positions of version 1 can be infinite.
pub(super) fn decode(contents: &Contents, warnings: &mut Vec<String>) -> Scene {
    let header = contents.header;
    let [positions, opacities, colors, scales, rotations, rest] = &contents.arrays;
    if header.degree > sh::MAX_DEGREE {
        warnings.push(format!("dropped spherical harmonics beyond degree {}", sh::MAX_DEGREE));
    }
    let scale_from_byte: [f32; 256] = std::array::from_fn(|byte| (byte as f32 / 16.0 - 10.0).exp());
    let scene = Scene {
        means: means(positions, header.version, header.fractional_bits),
        rotations: match header.version {
            1 | 2 => rotations.par_chunks_exact(3).map(rotation_from_first_three).collect(),
            _ => rotations.par_chunks_exact(4).map(rotation_from_smallest_three).collect(),
        },
        scales: scales
            .par_chunks_exact(3)
            .map(|xyz| Vec3::from_array([0, 1, 2].map(|axis| scale_from_byte[usize::from(xyz[axis])])))
            .collect(),
        opacities: opacities.par_iter().map(|&byte| f32::from(byte) / 255.0).collect(),
        sh: Some(spherical_harmonics(colors, rest, header.degree)),
        order: (0..header.n as u32).collect(),
        n_source: header.n,
        filter: match header.flags & ANTIALIASED {
            0 => ScreenFilter::Classic,
            _ => ScreenFilter::Antialiased,
        },
        ..Scene::default()
    };
    // Later versions have no bytes for values that are not finite.
    if header.version == 1 { drop_broken(scene, warnings) } else { scene }
}

/// Three f16 each in version 1, three 24-bit integers in units of 2^-`fractional_bits` later.
fn means(bytes: &[u8], version: u32, fractional_bits: u8) -> Vec<Vec3> {
    if version == 1 {
        let coordinate = |bytes: &[u8], i: usize| f16::from_le_bytes([bytes[i], bytes[i + 1]]).to_f32();
        return bytes
            .par_chunks_exact(6)
            .map(|xyz| Vec3::from_array([0, 2, 4].map(|i| coordinate(xyz, i))))
            .collect();
    }
    let unit = 0.5_f32.powi(i32::from(fractional_bits));
    // The upper three bytes of a word, so that shifting back keeps the sign.
    let integer = |bytes: &[u8], i: usize| i32::from_le_bytes([0, bytes[i], bytes[i + 1], bytes[i + 2]]) >> 8;
    bytes
        .par_chunks_exact(9)
        .map(|xyz| Vec3::from_array([0, 3, 6].map(|i| integer(xyz, i) as f32 * unit)))
        .collect()
}

/// Versions 1 and 2: x, y, z in steps of 1/127.5, and w not negative.
fn rotation_from_first_three(bytes: &[u8]) -> Quat {
    let xyz = Vec3::from_array([0, 1, 2].map(|i| f32::from(bytes[i]) / 127.5 - 1.0));
    // Rounded components may have a length above 1 together.
    let w = (1.0 - xyz.length_squared()).max(0.0).sqrt();
    Quat::from_vec4(xyz.extend(w)).normalize()
}

/// Versions 3 and 4: bits 30 and 31 name the largest component, which is not negative and left out. The others
/// follow from the last one down, each a sign in bit 9 and a magnitude up to 1/sqrt 2, since no other can be
/// larger.
fn rotation_from_smallest_three(bytes: &[u8]) -> Quat {
    let mut word = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let largest = (word >> 30) as usize;
    let mut xyzw = [0.0; 4];
    let mut sum = 0.0;
    for i in (0..4).rev().filter(|&i| i != largest) {
        let magnitude = (word & MAX_MAGNITUDE) as f32 / MAX_MAGNITUDE as f32 * FRAC_1_SQRT_2;
        xyzw[i] = if word & SIGN == 0 { magnitude } else { -magnitude };
        sum += magnitude * magnitude;
        word >>= 10;
    }
    // Three components of 1/sqrt 2 are longer than 1 together. Such a word is no rotation, but its direction is
    // one.
    xyzw[largest] = (1.0 - sum).max(0.0_f32).sqrt();
    Quat::from_array(xyzw).normalize()
}

/// The largest magnitude of a component, which stands for 1/sqrt 2.
pub(super) const MAX_MAGNITUDE: u32 = 511;

/// The sign of a component.
pub(super) const SIGN: u32 = 1 << 9;

/// A coefficient of degree 0 per unit of the color byte's 0..1: the file keeps 0.5 + 0.15 f_dc.
pub(super) const COLOR_SCALE: f32 = 0.15;

/// Degree 0 from the colors, and the others, coefficient-major with the channels innermost as in memory.
fn spherical_harmonics(colors: &[u8], rest: &[u8], degree: u8) -> Sh {
    let dc_from_byte: [f32; 256] = std::array::from_fn(|byte| (byte as f32 / 255.0 - 0.5) / COLOR_SCALE);
    let kept = degree.min(sh::MAX_DEGREE);
    let n_kept = 3 * sh::n_coefficients(kept);
    let n_stored = 3 * (sh::n_coefficients(degree) - 1);
    let mut coefficients = vec![0.0; colors.len() / 3 * n_kept];
    enlarge(&mut coefficients);
    let gaussians = coefficients.par_chunks_exact_mut(n_kept).zip(colors.par_chunks_exact(3));
    gaussians.enumerate().for_each(|(i, (values, color))| {
        let (dc, others) = values.split_at_mut(3);
        dc.iter_mut().zip(color).for_each(|(value, &byte)| *value = dc_from_byte[usize::from(byte)]);
        let stored = &rest[i * n_stored..(i + 1) * n_stored];
        others.iter_mut().zip(stored).for_each(|(value, &byte)| *value = (f32::from(byte) - 128.0) / 128.0);
    });
    Sh { degree: kept, coefficients }
}
