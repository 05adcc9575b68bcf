//! The colors of a native .ply: spherical harmonics, or colors of points.

use ply_rs::ply::{ElementDef, PropertyType::Scalar, ScalarType};
use rayon::prelude::*;
use stylegaussian::{
    scene::Sh,
    sh::{self, n_coefficients},
    work::Work,
};

use super::columns::Rows;
use crate::{
    error::{Mismatch, mismatch},
    pages::enlarge,
};

/// The brightest value of colors of 8 and of 16 bits.
pub(super) const BYTE: f32 = 255.0;
const WORD: f32 = 65_535.0;

/// Channels above this are no display colors of 0..1, which reach a little beyond 1 at most.
pub(super) const MOST_OF_ONE: f32 = 2.0;

/// A share of this many Gaussians may have a channel beyond what a range of colors holds: strays.
const STRAYS: usize = 100;

/// The properties that hold a vertex's color.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Color {
    /// `f_dc_0..2` and the higher coefficients `f_rest_*` up to `degree`, of `n_stored` in each channel.
    SphericalHarmonics { degree: u8, n_stored: usize },
    /// `red green blue`.
    Rgb(Stored),
    /// There are none.
    None,
}

impl Color {
    /// The spherical harmonics if there are any, otherwise `red green blue`. Point-cloud tools add the latter
    /// to 3DGS files for display.
    pub(super) fn choose(vertex: &ElementDef) -> Result<Self, Mismatch> {
        let has = |name: &str| vertex.properties.contains_key(name);
        // The count decides the degree. Gaps in the numbering show up when the columns are read by name.
        let rest = vertex.properties.keys().filter(|name| name.starts_with("f_rest_")).count();
        if ["f_dc_0", "f_dc_1", "f_dc_2"].into_iter().all(has) {
            // SPZ and its neighbors have a fourth degree, too fine for any capture to show.
            let degree = (0..=4).find(|&degree| 3 * (n_coefficients(degree) - 1) == rest);
            let color = |degree: u8| Self::SphericalHarmonics {
                degree: degree.min(sh::MAX_DEGREE),
                n_stored: n_coefficients(degree) - 1,
            };
            return degree.map(color).ok_or_else(|| {
                mismatch(format_args!("{rest} properties f_rest_*"), "0, 9, 24, 45 or 72 (SH degree 0 to 4)")
            });
        }
        if !["red", "green", "blue"].into_iter().all(has) {
            return Ok(Self::None);
        }
        // The type of red stands for all three.
        Ok(Self::Rgb(match vertex.properties["red"].data_type {
            Scalar(ScalarType::Float | ScalarType::Double) => Stored::Float,
            Scalar(ScalarType::UShort | ScalarType::Short) => Stored::Word,
            _ => Stored::Byte,
        }))
    }

    /// The properties to read, in the order of [`Sh`]. Higher spherical harmonics are channel-major in the
    /// file: first all of red, then green, then blue.
    pub(super) fn names(&self) -> Vec<String> {
        match self {
            Self::SphericalHarmonics { degree, n_stored } => {
                let n_rest = n_coefficients(*degree) - 1;
                let dc = (0..3).map(|i| format!("f_dc_{i}"));
                dc.chain(rest_names(n_rest, *n_stored)).collect()
            }
            Self::Rgb(_) => ["red", "green", "blue"].map(Into::into).into(),
            Self::None => Vec::new(),
        }
    }
}

/// The type of `red green blue`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Stored {
    /// 8 bits, or whole numbers of more bits for the same values.
    Byte,
    /// 16 bits.
    Word,
    /// Any float.
    Float,
}

impl Stored {
    /// The value that means full brightness. Types do not tell it: floats go to 1 or to 255, and words may hold
    /// bytes. A warning says so if it is not the usual one.
    fn brightest(self, rows: &Rows, first: usize, warnings: &mut Vec<String>) -> f32 {
        let exceeds = |most: f32| {
            let is_beyond = |&i: &usize| rows.array::<3>(i, first).into_iter().any(|value| value > most);
            let n_beyond = (0..rows.n_rows()).into_par_iter().filter(is_beyond).count();
            STRAYS * n_beyond > rows.n_rows()
        };
        let (usual, found) = match self {
            Self::Byte => (BYTE, BYTE),
            Self::Word if exceeds(BYTE) => (WORD, WORD),
            // Nothing would be brighter than black.
            Self::Word => (WORD, BYTE),
            Self::Float if exceeds(BYTE) => (1.0, WORD),
            Self::Float if exceeds(MOST_OF_ONE) => (1.0, BYTE),
            Self::Float => (1.0, 1.0),
        };
        if usual != found {
            warnings.push(format!("colors (red green blue) are read as 0 to {found}, by their values"));
        }
        found
    }
}

/// The colors in columns from `first` on, as coefficients in the order of [`Sh`], RGB innermost.
pub(super) fn spherical_harmonics(
    rows: &Rows,
    color: &Color,
    first: usize,
    warnings: &mut Vec<String>,
    work: &Work,
) -> Option<Sh> {
    let (degree, brightest) = match *color {
        Color::None => return None,
        Color::Rgb(stored) => (0, Some(stored.brightest(rows, first, warnings))),
        Color::SphericalHarmonics { degree, .. } => (degree, None),
    };
    let width = 3 * n_coefficients(degree);
    let mut coefficients = vec![0.0; rows.n_rows() * width];
    enlarge(&mut coefficients);
    coefficients.par_chunks_exact_mut(width).enumerate().for_each(|(i, row)| match brightest {
        _ if work.is_canceled() => {}
        Some(brightest) => {
            let rgb: [f32; 3] = rows.array(i, first);
            row.copy_from_slice(&sh::dc_from_color(rgb.map(|value| value / brightest)));
        }
        None => rows.read(i, first, row),
    });
    Some(Sh { degree, coefficients })
}

/// The names of the first `n_rest` higher coefficients of each channel, of which the file has `n_stored`, RGB
/// innermost.
pub(super) fn rest_names(n_rest: usize, n_stored: usize) -> impl Iterator<Item = String> {
    (0..n_rest).flat_map(move |i| (0..3).map(move |channel| format!("f_rest_{}", channel * n_stored + i)))
}
