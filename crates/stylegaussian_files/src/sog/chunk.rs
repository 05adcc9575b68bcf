//! The Gaussians of one set of planes.

use std::{f32::consts::FRAC_1_SQRT_2, ops::Range};

use glam::{Quat, Vec3};
use rayon::prelude::*;
use stylegaussian::{scene::Scene, sh, work::Work};

use crate::error::{Mismatch, mismatch};

use super::{
    meta::{Meta, Table},
    plane::{Plane, StoredPlane},
};

/// Entries of a palette in one row of its plane.
pub(super) const PALETTE_COLUMNS: usize = 64;

/// The alpha of a rotation whose first component is the largest.
pub(super) const FIRST_TAG: u8 = 252;

/// The most texels that a plane may unpack to per byte of all planes. Captures take about 17 bytes per
/// Gaussian, all planes together; planes of one color, by which a small file could ask for gigabytes, take
/// none.
const TEXELS_PER_BYTE: usize = 16;

/// Texels that every plane may have, so that small scenes are not refused for packing well.
const FLOOR: usize = 1 << 16;

/// A set of planes with its metadata. Sizes were checked.
pub(super) struct Chunk<'a> {
    meta: Meta,
    planes: Vec<StoredPlane<'a>>,
    /// The highest degree of spherical harmonics.
    pub degree: u8,
}

impl<'a> Chunk<'a> {
    /// Reads the headers of the planes, in the order of [`Meta::planes`], and checks that they fit.
    pub fn open(meta: Meta, planes: &[&'a [u8]]) -> Result<Self, Mismatch> {
        let n_bytes: usize = planes.iter().map(|bytes| bytes.len()).sum();
        let limit = FLOOR + TEXELS_PER_BYTE.saturating_mul(n_bytes);
        let mut stored = Vec::with_capacity(planes.len());
        for (i, (name, bytes)) in meta.planes.iter().zip(planes).enumerate() {
            let plane = StoredPlane::open(name.clone(), bytes)?;
            let [width, height] = plane.size();
            let found = format_args!("`{name}` of {width} x {height} pixels").to_string();
            if plane.n_texels() > limit {
                let expected = format_args!("at most {limit} in files of {n_bytes} bytes").to_string();
                return Err(mismatch(found, expected));
            }
            // The sixth plane is the palette. All others have a texel per Gaussian.
            if i != 5 && plane.n_texels() < meta.count {
                return Err(mismatch(found, format_args!("one for each of {} Gaussians", meta.count)));
            }
            stored.push(plane);
        }
        let mut chunk = Self { meta, planes: stored, degree: 0 };
        chunk.check_palette()?;
        Ok(chunk)
    }

    /// Sets the degree and the number of entries, and checks them against the palette's plane.
    fn check_palette(&mut self) -> Result<(), Mismatch> {
        let Some(palette) = &mut self.meta.palette else { return Ok(()) };
        let plane = &self.planes[5];
        let [width, height] = plane.size();
        let width_of = |degree: u8| PALETTE_COLUMNS * (sh::n_coefficients(degree) - 1);
        let degree = (1..=sh::MAX_DEGREE).find(|&degree| width_of(degree) == width);
        let Some(degree) = degree.filter(|&degree| palette.degree.is_none_or(|said| said == degree)) else {
            let widths = match palette.degree {
                Some(said) => width_of(said).to_string(),
                None => "192, 512 or 960".into(),
            };
            return Err(mismatch(format_args!("`{}` {width} pixels wide", plane.name), widths));
        };
        let n_entries = PALETTE_COLUMNS * height;
        if let Some(said) = palette.n_entries
            && said > n_entries
        {
            let found = format!("a palette of {said} spherical harmonics");
            return Err(mismatch(found, format_args!("at most {n_entries}, as `{}` holds", plane.name)));
        }
        palette.n_entries.get_or_insert(n_entries);
        self.degree = degree;
        Ok(())
    }

    /// The number of Gaussians.
    pub fn count(&self) -> usize {
        self.meta.count
    }

    /// The metadata.
    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// Decodes the planes side by side.
    pub fn decode(self, work: &Work) -> Result<Gaussians, Mismatch> {
        let decode = |plane: StoredPlane| {
            work.check()?;
            plane.decode()
        };
        let planes: Result<Vec<Plane>, Mismatch> = self.planes.into_par_iter().map(decode).collect();
        let planes = planes?;
        work.check()?;
        let powers = powers(&self.meta);
        let palette = palette(&self.meta, &planes, self.degree);
        let components = components();
        let gaussians =
            Gaussians { meta: self.meta, planes, palette, degree: self.degree, powers, components };
        gaussians.check_labels()?;
        Ok(gaussians)
    }
}

/// Decoded planes.
pub(super) struct Gaussians {
    meta: Meta,
    planes: Vec<Plane>,
    /// Coefficients of the palette's entries, RGB innermost; empty if there is none.
    palette: Vec<f32>,
    degree: u8,
    /// Factors of exp u by the upper and by the lower byte of a mean's code, for each axis.
    powers: [[[f64; 256]; 2]; 3],
    /// Components of rotations by their codes.
    components: Table,
}

/// The palette in numbers: looking them up once per entry is faster than once per Gaussian.
fn palette(meta: &Meta, planes: &[Plane], degree: u8) -> Vec<f32> {
    let Some(palette) = &meta.palette else { return Vec::new() };
    // Rows of the plane are whole entries, so that all texels follow one another.
    let n_texels = palette.n_entries.unwrap_or(0) * (sh::n_coefficients(degree) - 1);
    let mut numbers = vec![0.0; 3 * n_texels];
    numbers.as_chunks_mut::<3>().0.par_iter_mut().enumerate().for_each(|(i, rgb)| {
        let [r, g, b, _] = planes[5].texel(i);
        *rgb = [r, g, b].map(|code| palette.table[usize::from(code)]);
    });
    numbers
}

/// Components of quaternions beside the largest, by their codes: from -1 / sqrt(2) to 1 / sqrt(2).
fn components() -> Table {
    std::array::from_fn(|code| (code as f32 / 255.0 * 2.0 - 1.0) * FRAC_1_SQRT_2)
}

/// u = min + span (256 upper + lower) / 65,535, so exp u is a product of two factors of 256 values each. That
/// is faster than an exponential per coordinate.
fn powers(meta: &Meta) -> [[[f64; 256]; 2]; 3] {
    [0, 1, 2].map(|axis| {
        let u = |code: usize| meta.spans[axis] * code as f64 / 65_535.0;
        let upper = std::array::from_fn(|byte| (meta.mins[axis] + u(256 * byte)).exp());
        [upper, std::array::from_fn(|byte| u(byte).exp())]
    })
}

impl Gaussians {
    /// Checks that every label is one of the palette.
    fn check_labels(&self) -> Result<(), Mismatch> {
        let Some(palette) = &self.meta.palette else { return Ok(()) };
        let n_entries = palette.n_entries.unwrap_or(0);
        let largest = (0..self.meta.count).into_par_iter().map(|i| self.label(i)).max();
        match largest {
            Some(label) if label >= n_entries => Err(mismatch(
                format_args!("label {label} in `{}`", self.meta.planes[6]),
                format_args!("labels below {n_entries}, the palette's size"),
            )),
            _ => Ok(()),
        }
    }

    /// Adds the Gaussians in `range` to `scene`. Its spherical harmonics are there already: zeros, of this
    /// degree or a higher one. Returns how many have no valid rotation.
    pub fn append(&self, range: Range<usize>, scene: &mut Scene) -> usize {
        let indices = || range.clone().into_par_iter();
        if let Some(sh) = &mut scene.sh {
            let width = 3 * sh::n_coefficients(sh.degree);
            sh.coefficients[width * scene.means.len()..]
                .par_chunks_exact_mut(width)
                .zip(indices())
                .for_each(|(coefficients, i)| self.write_coefficients(i, coefficients));
        }
        scene.means.par_extend(indices().map(|i| self.mean(i)));
        scene.rotations.par_extend(indices().map(|i| self.rotation(i).unwrap_or(Quat::IDENTITY)));
        scene.scales.par_extend(indices().map(|i| {
            let [r, g, b, _] = self.planes[3].texel(i);
            let [x, y, z] = &self.meta.scales;
            Vec3::new(x[usize::from(r)], y[usize::from(g)], z[usize::from(b)])
        }));
        let opacity = |i| self.meta.opacities[usize::from(self.planes[4].texel(i)[3])];
        scene.opacities.par_extend(indices().map(opacity));
        indices().filter(|&i| self.planes[2].texel(i)[3] < FIRST_TAG).count()
    }

    /// v = sign(u) (exp |u| - 1), where u lies between the ends of its axis by a code of 16 bits.
    fn mean(&self, i: usize) -> Vec3 {
        let (low, high) = (self.planes[0].texel(i), self.planes[1].texel(i));
        let axis = |axis: usize| {
            let [upper, lower] = &self.powers[axis];
            let power = upper[usize::from(high[axis])] * lower[usize::from(low[axis])];
            (if power >= 1.0 { power - 1.0 } else { 1.0 - 1.0 / power }) as f32
        };
        Vec3::new(axis(0), axis(1), axis(2))
    }

    /// The rotation: alpha is [`FIRST_TAG`] and the place of the largest component in the order w, x, y, z. The
    /// others are in this order, each between -1 / sqrt(2) and 1 / sqrt(2). `None` if alpha is another.
    fn rotation(&self, i: usize) -> Option<Quat> {
        let [r, g, b, tag] = self.planes[2].texel(i);
        let [a, b, c] = [r, g, b].map(|code| self.components[usize::from(code)]);
        let rest = 1.0 - a * a - b * b - c * c;
        let largest = rest.max(0.0).sqrt();
        let at = tag.checked_sub(FIRST_TAG)?;
        // Choices instead of jumps, which no processor can foretell here.
        let w = if at == 0 { largest } else { a };
        let x = [b, a][usize::from(at == 0)];
        let x = if at == 1 { largest } else { x };
        let y = [c, b][usize::from(at < 2)];
        let y = if at == 2 { largest } else { y };
        let z = if at == 3 { largest } else { c };
        let rotation = Quat::from_xyzw(x, y, z, w);
        // Rounded components may leave nothing for the largest, and be too long themselves.
        Some(if rest < 0.0 { rotation.normalize() } else { rotation })
    }

    fn label(&self, i: usize) -> usize {
        let [low, high, ..] = self.planes[6].texel(i);
        usize::from(u16::from_le_bytes([low, high]))
    }

    /// The coefficients of Gaussian `i`, RGB innermost.
    fn write_coefficients(&self, i: usize, coefficients: &mut [f32]) {
        let (dc, rest) = coefficients.split_at_mut(3);
        let codes = self.planes[4].texel(i);
        for (channel, value) in dc.iter_mut().enumerate() {
            *value = self.meta.dc[channel][usize::from(codes[channel])];
        }
        if !self.palette.is_empty() {
            let n_rest = 3 * (sh::n_coefficients(self.degree) - 1);
            rest[..n_rest].copy_from_slice(&self.palette[self.label(i) * n_rest..][..n_rest]);
        }
    }
}
