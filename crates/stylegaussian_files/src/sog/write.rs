//! Writing version 2: planes and `meta.json`.

use std::io::Write;

use glam::Quat;
use image_webp::{ColorType, WebPEncoder};
use rayon::prelude::*;
use serde_json::json;
use stylegaussian::{
    scene::{Scene, ScreenFilter, Sh},
    sh,
};

use super::{
    META,
    chunk::{FIRST_TAG, PALETTE_COLUMNS},
    palette::{Entries, MOST},
    plane::MAX_SIDE,
};
use crate::{
    archive::write_stored,
    distant,
    error::{Mismatch, mismatch},
    format::{Unwritten, WriteOptions},
};

/// Numbers of a codebook.
const N_CODES: usize = 256;

/// Rounds in which a codebook moves toward its values. After eight, errors shrink by less than a hundredth.
const ROUNDS: usize = 8;

/// The least logarithm of a scale, e^-20: that of a flat Gaussian's thickness would take all codes for itself.
const THINNEST: f32 = -20.0;

/// The planes of spherical harmonics above degree 0.
const CENTROIDS: &str = "shN_centroids.webp";
const LABELS: &str = "shN_labels.webp";

/// Widths of planes are multiples of it, as in the files of PlayCanvas.
const BLOCK: usize = 4;

/// Writes a bundle: Gaussians in the source's order, with colors and spherical harmonics. Features, neighbors
/// and decoder have no place in the file.
pub(super) fn write(
    out: &mut dyn Write,
    scene: &Scene,
    _options: &WriteOptions,
) -> Result<Vec<String>, Unwritten> {
    write_stored(out, &files(scene)?)?;
    Ok(distant::left_out(scene).into_iter().collect())
}

/// The files of a scene and their names, the metadata first. The scene was checked and holds a Gaussian.
///
/// # Errors
/// If there are more Gaussians than a plane has texels.
pub(crate) fn files(scene: &Scene) -> Result<Vec<(&'static str, Vec<u8>)>, Mismatch> {
    let rows: Vec<usize> = scene.by_source().into_iter().map(|i| i as usize).collect();
    let n = rows.len();
    let width = ((n as f64).sqrt().ceil() as usize).next_multiple_of(BLOCK);
    if width > MAX_SIDE as usize {
        return Err(mismatch(format_args!("{n} Gaussians"), "at most 2^28, which fit a plane"));
    }
    let logs: Vec<[f64; 3]> = rows.par_iter().map(|&i| scene.means[i].to_array().map(log)).collect();
    let end = |axis: usize, best: fn(f64, f64) -> f64| logs.iter().map(|log| log[axis]).reduce(best);
    let ends = |best| [0, 1, 2].map(|axis| end(axis, best).unwrap_or(0.0));
    let (mins, maxs) = (ends(f64::min), ends(f64::max));
    let places: Vec<[u16; 3]> = logs.par_iter().map(|log| place(log, &mins, &maxs)).collect();
    let scale = |&i: &usize| scene.scales[i].to_array().map(|scale| scale.ln().max(THINNEST));
    let scales: Vec<[f32; 3]> = rows.par_iter().map(scale).collect();
    let dc: Vec<[f32; 3]> = rows.par_iter().map(|&i| dc(scene, i)).collect();
    let (scale_book, dc_book) = rayon::join(|| Codebook::new(&scales), || Codebook::new(&dc));
    let opacity = |i: usize| (scene.opacities[i] * 255.0).round() as u8;
    let byte = |i: usize, shift: u32| {
        let [x, y, z] = places[i].map(|code| (code >> shift) as u8);
        [x, y, z, 255]
    };
    let with = |[r, g, b]: [u8; 3], alpha: u8| [r, g, b, alpha];
    let higher = scene.sh.as_ref().filter(|sh| sh.degree > 0).map(Higher::new);
    let [n_centroids, centroids_width] = higher.as_ref().map_or([0; 2], Higher::size);
    let centroid = |i: usize| higher.as_ref().map_or([0; 4], |higher| with(higher.codes(i), 255));
    let label = |i: usize| {
        let label = higher.as_ref().map_or(0, |higher| higher.entries.labels[rows[i]]);
        let [low, high] = label.to_le_bytes();
        [low, high, 0, 255]
    };
    let texels: [(&str, [usize; 2], &Texel); 7] = [
        ("means_l.webp", [n, width], &|i| byte(i, 0)),
        ("means_u.webp", [n, width], &|i| byte(i, 8)),
        ("quats.webp", [n, width], &|i| quaternion(scene.rotations[rows[i]])),
        ("scales.webp", [n, width], &|i| with(scale_book.codes(&scales[i]), 255)),
        ("sh0.webp", [n, width], &|i| with(dc_book.codes(&dc[i]), opacity(rows[i]))),
        (CENTROIDS, [n_centroids, centroids_width], &centroid),
        (LABELS, [n, width], &label),
    ];
    let n_planes = if higher.is_some() { 7 } else { 5 };
    // Each plane is packed by one thread, but they side by side.
    let planes: Result<Vec<_>, Mismatch> = texels[..n_planes]
        .par_iter()
        .map(|(name, [n, width], texel)| Ok((*name, plane(*n, *width, *texel)?)))
        .collect();
    let mut meta = json!({
        "version": 2, "count": n, "antialias": scene.filter == ScreenFilter::Antialiased,
        "means": {"mins": mins, "maxs": maxs, "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scale_book.0, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": dc_book.0, "files": ["sh0.webp"]},
    });
    if let Some(Higher { degree, book, .. }) = &higher {
        let n_entries = n_centroids / (sh::n_coefficients(*degree) - 1);
        meta["shN"] =
            json!({"count": n_entries, "bands": degree, "codebook": book.0, "files": [CENTROIDS, LABELS]});
    }
    Ok([(META, meta.to_string().into_bytes())].into_iter().chain(planes?).collect())
}

/// Spherical harmonics above degree 0.
struct Higher {
    degree: u8,
    entries: Entries,
    book: Codebook,
}

impl Higher {
    fn new(sh: &Sh) -> Self {
        let entries = Entries::new(sh, MOST);
        let book = Codebook::new(entries.values.as_chunks::<3>().0);
        Self { degree: sh.degree, entries, book }
    }

    /// Texels of the plane of entries, and its width: whole entries, the same number in each row.
    fn size(&self) -> [usize; 2] {
        [self.entries.values.len() / 3, PALETTE_COLUMNS * (sh::n_coefficients(self.degree) - 1)]
    }

    /// The codes of texel `i`: a coefficient of red, green and blue.
    fn codes(&self, i: usize) -> [u8; 3] {
        self.book.codes(&self.entries.values.as_chunks::<3>().0[i])
    }
}

/// sign(v) ln (1 + |v|).
fn log(v: f32) -> f64 {
    f64::from(v.abs()).ln_1p().copysign(f64::from(v))
}

/// The codes of a mean, of 16 bits.
fn place(log: &[f64; 3], mins: &[f64; 3], maxs: &[f64; 3]) -> [u16; 3] {
    [0, 1, 2].map(|axis| {
        let span = maxs[axis] - mins[axis];
        // The cast makes 0 of NaN, which a plane without extent gives.
        ((log[axis] - mins[axis]) / span * 65_535.0).round() as u16
    })
}

/// The code of a rotation: see the reader's.
fn quaternion(rotation: Quat) -> [u8; 4] {
    let wxyz = [rotation.w, rotation.x, rotation.y, rotation.z];
    let largest = (1..4).fold(0, |a, b| if wxyz[b].abs() > wxyz[a].abs() { b } else { a });
    let sign = wxyz[largest].signum();
    let mut code = [0, 0, 0, FIRST_TAG + largest as u8];
    for (slot, i) in (0..4).filter(|&i| i != largest).enumerate() {
        code[slot] = ((wxyz[i] * sign * std::f32::consts::SQRT_2 + 1.0) * 127.5).round() as u8;
    }
    code
}

/// The coefficients of degree 0 of Gaussian `i`, mid-gray if the scene has no colors.
fn dc(scene: &Scene, i: usize) -> [f32; 3] {
    let Some(captured) = &scene.sh else { return [0.0; 3] };
    let at = 3 * sh::n_coefficients(captured.degree) * i;
    [0, 1, 2].map(|channel| captured.coefficients[at + channel])
}

/// A plane's texel by the number of its Gaussian.
type Texel<'a> = dyn Fn(usize) -> [u8; 4] + Sync + 'a;

/// A lossless image of `n` texels.
fn plane(n: usize, width: usize, texel: &Texel) -> Result<Vec<u8>, Mismatch> {
    let height = n.div_ceil(width);
    let of = |i: usize| if i < n { texel(i) } else { [0; 4] };
    let texels: Vec<[u8; 4]> = (0..width * height).into_par_iter().map(of).collect();
    let mut bytes = Vec::new();
    let encoder = WebPEncoder::new(&mut bytes);
    encoder
        .encode(texels.as_flattened(), width as u32, height as u32, ColorType::Rgba8)
        .map_err(|error| mismatch(error, "planes that WebP can hold"))?;
    Ok(bytes)
}

/// Numbers in ascending order, to which values are rounded.
struct Codebook(Vec<f32>);

impl Codebook {
    /// Numbers between the ends of `values`, each moved to the mean of those that are nearest to it (Lloyd,
    /// "Least squares quantization in PCM", 1982).
    fn new(values: &[[f32; 3]]) -> Self {
        let mut sorted: Vec<f32> = values.as_flattened().to_vec();
        sorted.par_sort_unstable_by(f32::total_cmp);
        let (least, most) = (sorted[0], sorted[sorted.len() - 1]);
        let even = |i: usize| least + (most - least) * i as f32 / (N_CODES - 1) as f32;
        let mut book = Self((0..N_CODES).map(even).collect());
        for _ in 0..ROUNDS {
            let mut begin = 0;
            for code in 0..N_CODES {
                let end = book.end(code, &sorted);
                let nearest = &sorted[begin..end.max(begin)];
                if !nearest.is_empty() {
                    let sum: f64 = nearest.iter().map(|value| f64::from(*value)).sum();
                    // Within the cell, so that the order stays.
                    book.0[code] = (sum / nearest.len() as f64) as f32;
                }
                begin = end.max(begin);
            }
        }
        book
    }

    /// The number of sorted values that are not nearer to a later number than to that of `code`.
    fn end(&self, code: usize, sorted: &[f32]) -> usize {
        let Some(next) = self.0.get(code + 1) else { return sorted.len() };
        let between = f32::midpoint(self.0[code], *next);
        sorted.partition_point(|value| *value <= between)
    }

    /// The codes of three values.
    fn codes(&self, values: &[f32; 3]) -> [u8; 3] {
        values.map(|value| {
            let after = self.0.partition_point(|number| *number < value);
            let before = after.saturating_sub(1);
            let after = after.min(N_CODES - 1);
            let is_before = value - self.0[before] < self.0[after] - value;
            (if is_before { before } else { after }) as u8
        })
    }
}
