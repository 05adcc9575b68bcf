//! PlayCanvas' compressed .ply: chunks of 256 Gaussians with their ranges, and four packed words for each
//! Gaussian.
//!
//! The layout is that of SuperSplat's files:
//! - element `chunk`: floats `min_x` .. `max_scale_z`, and `min_r` .. `max_b` in newer files,
//! - element `vertex`: unsigned `packed_position`, `packed_rotation`, `packed_scale`, `packed_color`,
//! - element `sh`, if the scene has spherical harmonics beyond degree 0: bytes `f_rest_*`.

use std::f32::consts::SQRT_2;

use glam::{Vec3, Vec4};
use ply_rs::ply::Encoding;
use rayon::prelude::*;
use stylegaussian::{
    scene::Sh,
    sh::{self, n_coefficients},
    work::Work,
};

use super::{
    color::rest_names,
    columns::{check_end, read_columns},
    header::Header,
};
use crate::{
    activate::{StoredGaussians, activate},
    error::{Loaded, Mismatch, mismatch},
    pages::enlarge,
};

/// Number of Gaussians in a chunk.
pub(super) const CHUNK: usize = 256;

/// The words of a Gaussian, in the order of all known files.
pub(super) const PACKED: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// Ranges of positions and of log scales, the minimum before the maximum.
pub(super) const RANGES: [&str; 12] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
];

/// Ranges of colors. Files without them hold colors from 0 to 1.
pub(super) const COLOR_RANGES: [&str; 6] = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"];

/// Whether the header belongs to this layout.
pub(super) fn is_compressed(header: &Header) -> bool {
    header.element("vertex").is_some_and(|vertex| vertex.properties.contains_key(PACKED[0]))
}

/// Reads the scene. The packed values are quantized: positions to 11, 10 and 11 bits of their chunk's box.
pub(super) fn read(header: &Header, file: &[u8], work: &Work) -> Result<Loaded, Mismatch> {
    let chunks = chunks(header, file, &work.part(0.0, 0.1))?;
    let words = packed_words(header, file)?;
    let n = words.len();
    if chunks.len() != n.div_ceil(CHUNK) {
        return Err(mismatch(
            format_args!("{} chunks for {n} Gaussians", chunks.len()),
            format_args!("{}, one for every {CHUNK}", n.div_ceil(CHUNK)),
        ));
    }
    check_end(header, file, work)?;
    let between = |i: usize, at: usize, t: Vec3| {
        let range = &chunks[i / CHUNK];
        let (min, max) = (Vec3::from_slice(&range[at..]), Vec3::from_slice(&range[at + 3..]));
        Vec3::from_array([0, 1, 2].map(|axis| mix(min[axis], max[axis], t[axis])))
    };
    let indices = || (0..n).into_par_iter();
    let word = |i: usize, place: usize| u32::from_le_bytes(words[i][place]);
    let dc = |i: usize| sh::dc_from_color(between(i, 12, unpack_8888(word(i, 3)).truncate()).to_array());
    work.at(0.1)?;
    let sh = spherical_harmonics(header, file, n, dc, &work.part(0.1, 0.6))?;
    work.at(0.6)?;
    let stored = StoredGaussians {
        sh: Some(sh),
        means: indices().map(|i| between(i, 0, unpack_11_10_11(word(i, 0)))).collect(),
        log_scales: indices().map(|i| between(i, 6, unpack_11_10_11(word(i, 2)))).collect(),
        rotations_wxyz: indices().map(|i| unpack_quaternion(word(i, 1))).collect(),
        opacity_logits: indices().map(|i| logit_of_byte(unpack_8888(word(i, 3)).w)).collect(),
        features: None,
    };
    work.at(0.8)?;
    let mut warnings = Vec::new();
    let scene = activate(stored, &mut warnings);
    Ok(Loaded::new(scene, warnings))
}

/// The value at `t`, 0..1, of a range. The logarithm of scale 0 is -infinity, and so is all that lies between
/// it and another value: writers give the whole chunk one range, in which no other place is left.
fn mix(min: f32, max: f32, t: f32) -> f32 {
    if t <= 0.0 {
        min
    } else if t >= 1.0 {
        max
    } else if min == f32::NEG_INFINITY || max == f32::NEG_INFINITY {
        f32::NEG_INFINITY
    } else {
        min + t * (max - min)
    }
}

/// Ranges of every chunk: positions, log scales, colors.
fn chunks(header: &Header, file: &[u8], work: &Work) -> Result<Vec<[f32; 18]>, Mismatch> {
    let chunk =
        header.element("chunk").ok_or_else(|| mismatch("no element `chunk`", "one before `vertex`"))?;
    let has_colors = chunk.properties.contains_key(COLOR_RANGES[0]);
    let names = RANGES.iter().chain(COLOR_RANGES.iter().filter(|_| has_colors));
    let names: Vec<String> = names.map(|&name| name.into()).collect();
    let rows = read_columns(header, file.into(), "chunk", &names, work)?;
    let range = |i: usize| {
        let mut range = [0.0; 18];
        range[15..].fill(1.0);
        rows.read(i, 0, &mut range);
        range
    };
    Ok((0..rows.n_rows()).map(range).collect())
}

/// The four words of every Gaussian, little endian. The column reader gives f32, which cannot hold 32-bit words
/// exactly.
fn packed_words<'a>(header: &Header, file: &'a [u8]) -> Result<&'a [[[u8; 4]; 4]], Mismatch> {
    use ply_rs::ply::{PropertyType::Scalar, ScalarType};
    if header.encoding() != Encoding::BinaryLittleEndian {
        return Err(mismatch("packed Gaussians in another encoding", "binary_little_endian"));
    }
    let mut start = header.payload;
    for element in header.elements() {
        let row = header
            .fixed_row(element)
            .ok_or_else(|| mismatch(format_args!("a list in element `{}`", element.name), "numbers"))?;
        if element.name != "vertex" {
            start += row * element.count;
            continue;
        }
        let is_packed = element.properties.values().map(|p| (p.name.as_str(), &p.data_type));
        if !is_packed.eq(PACKED.iter().map(|&name| (name, &Scalar(ScalarType::UInt)))) {
            let found: Vec<&str> = element.properties.keys().map(String::as_str).take(20).collect();
            return Err(mismatch(format_args!("a vertex of {}", found.join(" ")), PACKED.join(" ")));
        }
        // No sum or product overflows: the header's counts were checked against the file's size.
        let rows = file.get(start..).and_then(|bytes| bytes.get(..row * element.count));
        let rows =
            rows.ok_or_else(|| mismatch("the end of the file", format_args!("{} Gaussians", element.count)))?;
        return Ok(rows.as_chunks().0.as_chunks().0);
    }
    Err(mismatch("no element `vertex`", PACKED.join(" ")))
}

/// `dc` of every Gaussian, and the higher coefficients of element `sh` (channel-major in the file).
fn spherical_harmonics(
    header: &Header,
    file: &[u8],
    n: usize,
    dc: impl Fn(usize) -> [f32; 3] + Send + Sync,
    work: &Work,
) -> Result<Sh, Mismatch> {
    // gsplat writes one without properties for degree 0.
    let Some(element) = header.element("sh").filter(|element| !element.properties.is_empty()) else {
        let coefficients: Vec<[f32; 3]> = (0..n).into_par_iter().map(dc).collect();
        return Ok(Sh { degree: 0, coefficients: coefficients.into_flattened() });
    };
    let n_found = element.properties.len();
    let degree = (1..=sh::MAX_DEGREE).find(|&degree| 3 * (n_coefficients(degree) - 1) == n_found);
    let degree = degree
        .ok_or_else(|| mismatch(format_args!("{n_found} properties of element `sh`"), "0, 9, 24 or 45"))?;
    let names: Vec<String> = rest_names(n_found / 3, n_found / 3).collect();
    let rows = read_columns(header, file.into(), "sh", &names, work)?;
    if rows.n_rows() != n {
        let found = format_args!("{} rows of element `sh`", rows.n_rows());
        return Err(mismatch(found, format_args!("{n}, one for each Gaussian")));
    }
    let width = 3 + n_found;
    let mut coefficients = vec![0.0; n * width];
    enlarge(&mut coefficients);
    coefficients.par_chunks_exact_mut(width).enumerate().for_each(|(i, row)| {
        if work.is_canceled() {
            return;
        }
        let (base, rest) = row.split_at_mut(3);
        base.copy_from_slice(&dc(i));
        rows.read(i, 0, rest);
        rest.iter_mut().for_each(|value| *value = unpack_coefficient(*value));
    });
    Ok(Sh { degree, coefficients })
}

/// A coefficient in -4..4 from its byte. Writers round down, so a byte stands for the middle of its step,
/// except that 0 and 255 stand for the ends.
fn unpack_coefficient(byte: f32) -> f32 {
    let t = if byte <= 0.0 || byte >= 255.0 { byte / 255.0 } else { (byte + 0.5) / 256.0 };
    (t - 0.5) * 8.0
}

/// The `bits` of a word from bit `shift` up, as a number 0..1.
fn unpack(word: u32, bits: u32, shift: u32) -> f32 {
    let largest = (1_u32 << bits) - 1;
    ((word >> shift) & largest) as f32 / largest as f32
}

fn unpack_11_10_11(word: u32) -> Vec3 {
    Vec3::new(unpack(word, 11, 21), unpack(word, 10, 11), unpack(word, 11, 0))
}

fn unpack_8888(word: u32) -> Vec4 {
    Vec4::new(unpack(word, 8, 24), unpack(word, 8, 16), unpack(word, 8, 8), unpack(word, 8, 0))
}

/// A quaternion (w, x, y, z). The upper two bits name its largest component, which is left out. The others
/// follow in order, each from -1/sqrt 2 to 1/sqrt 2, since no other component of a unit quaternion can be
/// larger.
fn unpack_quaternion(word: u32) -> [f32; 4] {
    let others = [20, 10, 0].map(|shift| (unpack(word, 10, shift) - 0.5) * SQRT_2);
    // Quantized components may have a length slightly above 1 together.
    let largest = (1.0 - others.iter().map(|other| other * other).sum::<f32>()).max(0.0).sqrt();
    let [a, b, c] = others;
    match word >> 30 {
        0 => [largest, a, b, c],
        1 => [a, largest, b, c],
        2 => [a, b, largest, c],
        _ => [a, b, c, largest],
    }
}

/// The logit of an opacity that is a multiple of 1/255. Opacities 0 and 1 have infinite logits, and are moved
/// inward by a quarter of a step.
fn logit_of_byte(opacity: f32) -> f32 {
    let opacity = opacity.clamp(0.25 / 255.0, 1.0 - 0.25 / 255.0);
    (opacity / (1.0 - opacity)).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two Gaussians in a chunk from -1 to 3 on every axis, with log scales from 0 to 1 and colors from 0 to 2.
    fn file(n_vertices: usize, sh: bool) -> Vec<u8> {
        let mut text = String::from("ply\nformat binary_little_endian 1.0\nelement chunk 1\n");
        for name in RANGES.iter().chain(&COLOR_RANGES) {
            text += &format!("property float {name}\n");
        }
        text += &format!("element vertex {n_vertices}\n");
        for name in PACKED {
            text += &format!("property uint {name}\n");
        }
        if sh {
            text += &format!("element sh {n_vertices}\n");
            for i in 0..9 {
                text += &format!("property uchar f_rest_{i}\n");
            }
        }
        let mut bytes = (text + "end_header\n").into_bytes();
        let ranges = [-1.0, -1.0, -1.0, 3.0, 3.0, 3.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0_f32];
        for value in ranges.into_iter().chain([0.0, 0.0, 0.0, 2.0, 2.0, 2.0]) {
            bytes.extend(value.to_le_bytes());
        }
        // x at its maximum, y at its minimum, z in the middle. w is left out, and x, y, z are zero up to
        // rounding.
        let position = (2047 << 21) | 1024_u32;
        let rotation = (512 << 20) | (512 << 10) | 512_u32;
        for word in [position, rotation, 2047, (255 << 24) | (51 << 8) | 204] {
            bytes.extend(word.to_le_bytes());
        }
        for word in [0, (3 << 30) | rotation, 0, 255_u32] {
            bytes.extend(word.to_le_bytes());
        }
        if sh {
            bytes.extend([0, 1, 2, 3, 4, 5, 6, 7, 255].repeat(2));
        }
        bytes
    }

    #[test]
    fn unpacks_hand_packed_gaussians() {
        let loaded = super::super::read(file(2, false), &Work::default()).unwrap();
        let scene = loaded.scene;
        assert!(scene.means[0].abs_diff_eq(Vec3::new(3.0, -1.0, -1.0 + 4.0 * 1024.0 / 2047.0), 1e-6));
        assert_eq!(scene.means[1], Vec3::NEG_ONE);
        assert!(scene.scales[0].abs_diff_eq(Vec3::new(1.0, 1.0, 1.0_f32.exp()), 1e-6));
        // 512 of 1023 is half a step over the middle.
        assert!(scene.rotations[0].abs_diff_eq(glam::Quat::IDENTITY, 2e-3));
        assert!(scene.rotations[1].abs_diff_eq(glam::Quat::from_xyzw(0.0, 0.0, 1.0, 0.0), 2e-3));
        assert!((scene.opacities[0] - 0.8).abs() < 1e-5);
        assert!(scene.opacities[1] > 0.998);
        assert!(Vec3::from(scene.base_colors()[0]).abs_diff_eq(Vec3::new(2.0, 0.0, 0.4), 1e-5));
    }

    #[test]
    fn higher_harmonics_are_channel_major() {
        let scene = super::super::read(file(2, true), &Work::default()).unwrap().scene;
        let sh = scene.sh.unwrap();
        assert_eq!((sh.degree, sh.coefficients.len()), (1, 24));
        let rest = |byte: f32| (byte + 0.5) / 32.0 - 4.0;
        assert_eq!(sh.coefficients[3..6], [-4.0, rest(3.0), rest(6.0)]);
        assert_eq!(sh.coefficients[9..12], [rest(2.0), rest(5.0), 4.0]);
    }

    /// Of a flat Gaussian the logarithm is -infinity, and so is its chunk's range: the others must not be lost.
    #[test]
    fn an_infinite_range_of_scales_is_thickness_0() {
        let at = file(2, false).len() - 104 + 4 * 8;
        for (min, max, expected) in [
            (f32::NEG_INFINITY, 1.0, [1.0_f32.exp(), 0.0]),
            (f32::NEG_INFINITY, f32::NEG_INFINITY, [0.0, 0.0]),
            (0.0, f32::NEG_INFINITY, [0.0, 1.0]),
        ] {
            let mut bytes = file(2, false);
            bytes[at..at + 4].copy_from_slice(&min.to_le_bytes());
            bytes[at + 12..at + 16].copy_from_slice(&max.to_le_bytes());
            let loaded = super::super::read(bytes, &Work::default()).unwrap();
            assert_eq!((loaded.scene.len(), loaded.warnings.len()), (2, 0));
            let thickness = [0, 1].map(|i: usize| loaded.scene.scales[i].z);
            assert!(thickness.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{thickness:?}");
            assert_eq!(loaded.scene.scales[0].truncate(), glam::Vec2::ONE);
        }
        assert_eq!(mix(f32::NEG_INFINITY, 1.0, 0.5), f32::NEG_INFINITY);
    }

    #[test]
    fn an_element_sh_without_properties_is_degree_0() {
        let plain = file(2, false);
        let header = String::from_utf8_lossy(&plain[..plain.len() - 104]).into_owned();
        for n in [0, 2, 7] {
            let header = header.replace("end_header", &format!("element sh {n}\nend_header"));
            let bytes = [header.as_bytes(), &plain[plain.len() - 104..]].concat();
            let scene = super::super::read(bytes, &Work::default()).unwrap().scene;
            assert_eq!((scene.len(), scene.sh.unwrap().degree), (2, 0));
        }
    }

    #[test]
    fn a_file_that_lies_is_refused() {
        let whole = file(2, false);
        let message = |bytes: &[u8]| super::super::read(bytes.into(), &Work::default()).unwrap_err().found;
        assert!(message(&whole[..whole.len() - 1]).contains("bytes after the header"));
        // The payload is 18 floats of ranges and two rows of four words: 104 bytes.
        let text = String::from_utf8_lossy(&whole[..whole.len() - 104]).into_owned();
        let with = |from: &str, to: &str| [text.replace(from, to).as_bytes(), &whole[text.len()..]].concat();
        assert!(message(&with("element chunk 1", "element chunk 0")).contains("0 chunks for 2 Gaussians"));
        assert!(message(&with("uint packed_scale", "int packed_scale")).contains("a vertex of"));
        assert!(message(&with("little_endian", "big_endian")).contains("make sense in little endian alone"));
    }
}
