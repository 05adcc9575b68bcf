//! 3DGS scenes as `.ply`, in every dialect that people have.
//!
//! The header goes through ply-rs after a check that it cannot upset it. The rows are read by our own reader: ply-rs
//! hands out every value with a fresh copy of its property's name, and its ascii numbers know neither NaN nor `1E5`.

use glam::Vec3;
use ply_rs::ply::Encoding;

use crate::{
    scene::Sh,
    sh::{self, n_coefficients},
};

use super::{
    Loaded, Mismatch,
    activate::{StoredGaussians, activate},
    mismatch,
};

mod columns;
mod compressed;
mod header;
mod write;

use columns::{Columns, read_columns};
use header::Header;

pub(super) use write::write;

/// What each vertex must have.
const GEOMETRY: [&str; 11] =
    ["x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];

/// What a 3DGS file is expected to hold, for messages.
const EXPECTED: &str = "3DGS properties x y z, opacity, scale_0..2, rot_0..3 of element `vertex`";

pub(super) fn read(bytes: &[u8]) -> Result<Loaded, Mismatch> {
    let header = Header::parse(bytes)?;
    let is_compressed = compressed::is_compressed(&header);
    let mut loaded = if is_compressed { compressed::read(&header)? } else { read_native(&header)? };
    loaded.scene.up = header.up();
    Ok(loaded)
}

fn read_native(header: &Header) -> Result<Loaded, Mismatch> {
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
    let names: Vec<String> = GEOMETRY.into_iter().map(Into::into).chain(color.names()).collect();
    let columns = read_columns(header, "vertex", &names)?;
    let stored = stored_gaussians(&columns, &color);
    Ok(Loaded { scene: activate(stored, &mut warnings), warnings })
}

/// Where the colors of a vertex stand.
#[derive(Clone, Debug, PartialEq)]
enum Color {
    /// `f_dc_0..2` and the higher coefficients `f_rest_*` of this degree.
    SphericalHarmonics(u8),
    /// `red green blue`, of which this value is the brightest.
    Rgb(f32),
    None,
}

impl Color {
    fn choose(vertex: &ply_rs::ply::ElementDef) -> Result<Self, Mismatch> {
        use ply_rs::ply::{PropertyType::Scalar, ScalarType};
        let has = |name: &str| vertex.properties.contains_key(name);
        let rest = vertex.properties.keys().filter(|name| name.starts_with("f_rest_")).count();
        if ["f_dc_0", "f_dc_1", "f_dc_2"].into_iter().all(has) {
            let degree = (0..=sh::MAX_DEGREE).find(|&degree| 3 * (n_coefficients(degree) - 1) == rest);
            return degree.map(Self::SphericalHarmonics).ok_or_else(|| {
                mismatch(format_args!("{rest} properties f_rest_*"), "0, 9, 24 or 45 (SH degree 0 to 3)")
            });
        }
        if !["red", "green", "blue"].into_iter().all(has) {
            return Ok(Self::None);
        }
        Ok(Self::Rgb(match vertex.properties["red"].data_type {
            Scalar(ScalarType::Float | ScalarType::Double) => 1.0,
            Scalar(ScalarType::UShort | ScalarType::Short) => 65_535.0,
            _ => 255.0,
        }))
    }

    /// The properties to read; those of spherical harmonics are channel-major.
    fn names(&self) -> Vec<String> {
        match self {
            Self::SphericalHarmonics(degree) => {
                let n_rest = 3 * (n_coefficients(*degree) - 1);
                let dc = (0..3).map(|i| format!("f_dc_{i}"));
                dc.chain((0..n_rest).map(|i| format!("f_rest_{i}"))).collect()
            }
            Self::Rgb(_) => ["red", "green", "blue"].map(Into::into).into(),
            Self::None => Vec::new(),
        }
    }
}

fn stored_gaussians(columns: &Columns, color: &Color) -> StoredGaussians {
    let rows = || columns.rows();
    StoredGaussians {
        means: rows().map(|v| Vec3::new(v[0], v[1], v[2])).collect(),
        opacity_logits: rows().map(|v| v[3]).collect(),
        log_scales: rows().map(|v| Vec3::new(v[4], v[5], v[6])).collect(),
        rotations_wxyz: rows().map(|v| [v[7], v[8], v[9], v[10]]).collect(),
        sh: spherical_harmonics(columns, color),
        features: None,
    }
}

fn spherical_harmonics(columns: &Columns, color: &Color) -> Option<Sh> {
    let start = GEOMETRY.len();
    let (degree, coefficients) = match *color {
        Color::None => return None,
        Color::Rgb(brightest) => {
            let dc = |v: &[f32]| sh::dc_from_color([0, 1, 2].map(|c| v[start + c] / brightest));
            (0, columns.rows().flat_map(dc).collect())
        }
        Color::SphericalHarmonics(degree) => {
            let n_rest = n_coefficients(degree) - 1;
            let mut coefficients = Vec::with_capacity(columns.n_rows() * 3 * (n_rest + 1));
            for v in columns.rows() {
                let (dc, rest) = v[start..].split_at(3);
                coefficients.extend_from_slice(dc);
                for i in 0..n_rest {
                    coefficients.extend((0..3).map(|channel| rest[channel * n_rest + i]));
                }
            }
            (degree, coefficients)
        }
    };
    Some(Sh { degree, coefficients })
}

#[cfg(test)]
pub(super) mod tests;
