//! 3DGS scenes as `.ply`, in every dialect in use.
//!
//! The crate ply-rs parses the header, after a check for lines on which it would panic. The rows are read by
//! our own reader: ply-rs returns every value with a fresh copy of its property's name, and its ascii numbers
//! include neither NaN nor `1E5`.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use stylegaussian::{
    scene::{Scene, Sh},
    sh::{self, n_coefficients},
};

use super::{
    activate::{StoredGaussians, activate},
    error::{Loaded, Mismatch, mismatch},
    format::Format,
    pages::enlarge,
};

mod columns;
mod compressed;
mod distant;
mod header;
mod write;

use columns::{Rows, read_columns};
use header::Header;

/// Properties that each vertex must have, in the order of the columns that are read.
const GEOMETRY: [&str; 11] =
    ["x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];

/// The format: binary and ascii, native and compressed.
pub(super) const FORMAT: Format = Format {
    name: "3DGS .ply",
    extensions: &["ply"],
    recognizes: |bytes, _| matches!(bytes, [b'p', b'l', b'y', b'\n' | b'\r' | b' ' | b'\t', ..]),
    read: |files, _| Ok(read(files.take_main())?),
    write: Some(|out, scene, _| Ok(write::write(out, scene).map(|()| Vec::new())?)),
};

/// The properties of a 3DGS file, for messages.
const EXPECTED: &str = "3DGS properties x y z, opacity, scale_0..2, rot_0..3 of element `vertex`";

/// Reads a scene of either layout, compressed or native.
pub(super) fn read(bytes: Vec<u8>) -> Result<Loaded, Mismatch> {
    let header = Header::parse(&bytes)?;
    let is_compressed = compressed::is_compressed(&header);
    let mut loaded =
        if is_compressed { compressed::read(&header, &bytes)? } else { read_native(&header, bytes)? };
    loaded.scene.up = header.up();
    loaded.scene.filter = header.filter(&mut loaded.warnings);
    Ok(loaded)
}

/// Reads the layout of the 3DGS reference implementation: one vertex per Gaussian, before the activations.
fn read_native(header: &Header, bytes: Vec<u8>) -> Result<Loaded, Mismatch> {
    let vertex = header.element("vertex").ok_or_else(|| mismatch("no element `vertex`", EXPECTED))?;
    if u32::try_from(vertex.count).is_err() {
        return Err(mismatch(format_args!("{} Gaussians", vertex.count), "fewer than 2^32"));
    }
    let missing: Vec<&str> =
        GEOMETRY.into_iter().filter(|name| !vertex.properties.contains_key(*name)).collect();
    if !missing.is_empty() {
        let found: Vec<&str> = vertex.properties.keys().map(String::as_str).take(20).collect();
        let found = format!("a vertex without {} (it has: {})", missing.join(" "), found.join(" "));
        return Err(mismatch(found, EXPECTED));
    }
    let mut warnings = Vec::new();
    let color = Color::choose(vertex)?;
    if color == Color::None {
        warnings.push("no color (f_dc_0..2 or red green blue): every Gaussian is mid-gray".into());
    }
    if matches!(color, Color::SphericalHarmonics { degree, n_stored } if n_stored >= n_coefficients(degree)) {
        warnings.push(format!("dropped spherical harmonics beyond degree {}", sh::MAX_DEGREE));
    }
    let names: Vec<String> = GEOMETRY.into_iter().map(Into::into).chain(color.names()).collect();
    let rows = read_columns(header, bytes.into(), "vertex", &names)?;
    let distant = distant::means(&rows, header);
    let mut stored = stored_gaussians(rows, &color);
    let offset = distant.map_or(DVec3::ZERO, |(offset, means)| {
        stored.means = means;
        offset
    });
    let scene = Scene { offset, ..activate(stored, &mut warnings) };
    Ok(Loaded::new(scene, warnings))
}

/// The properties that hold a vertex's color.
#[derive(Clone, Debug, PartialEq)]
enum Color {
    /// `f_dc_0..2` and the higher coefficients `f_rest_*` up to `degree`, of `n_stored` in each channel.
    SphericalHarmonics { degree: u8, n_stored: usize },
    /// `red green blue`, from 0 to this brightest value.
    Rgb(f32),
    /// There are none.
    None,
}

impl Color {
    /// The spherical harmonics if there are any, otherwise `red green blue`. Point-cloud tools add the latter
    /// to 3DGS files for display.
    fn choose(vertex: &ply_rs::ply::ElementDef) -> Result<Self, Mismatch> {
        use ply_rs::ply::{PropertyType::Scalar, ScalarType};
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
            Scalar(ScalarType::Float | ScalarType::Double) => 1.0,
            Scalar(ScalarType::UShort | ScalarType::Short) => 65_535.0,
            _ => 255.0,
        }))
    }

    /// The properties to read, in the order of [`Sh`]. Higher spherical harmonics are channel-major in the
    /// file: first all of red, then green, then blue.
    fn names(&self) -> Vec<String> {
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

/// Takes the rows apart. Spherical harmonics come first: most of the file is in them, and its memory is free
/// after that.
fn stored_gaussians(mut rows: Rows, color: &Color) -> StoredGaussians {
    let sh = spherical_harmonics(&rows, color);
    rows.keep(GEOMETRY.len());
    let indices = || (0..rows.n_rows()).into_par_iter();
    StoredGaussians {
        means: indices().map(|i| Vec3::from_array(rows.array(i, 0))).collect(),
        opacity_logits: indices().map(|i| rows.array::<1>(i, 3)[0]).collect(),
        log_scales: indices().map(|i| Vec3::from_array(rows.array(i, 4))).collect(),
        rotations_wxyz: indices().map(|i| rows.array(i, 7)).collect(),
        sh,
        features: None,
    }
}

/// The colors as coefficients in the order of [`Sh`], RGB innermost.
fn spherical_harmonics(rows: &Rows, color: &Color) -> Option<Sh> {
    let first = GEOMETRY.len();
    let (degree, brightest) = match *color {
        Color::None => return None,
        Color::Rgb(brightest) => (0, Some(brightest)),
        Color::SphericalHarmonics { degree, .. } => (degree, None),
    };
    let width = 3 * n_coefficients(degree);
    let mut coefficients = vec![0.0; rows.n_rows() * width];
    enlarge(&mut coefficients);
    coefficients.par_chunks_exact_mut(width).enumerate().for_each(|(i, row)| match brightest {
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
fn rest_names(n_rest: usize, n_stored: usize) -> impl Iterator<Item = String> {
    (0..n_rest).flat_map(move |i| (0..3).map(move |channel| format!("f_rest_{}", channel * n_stored + i)))
}

#[cfg(test)]
pub(super) mod tests;
