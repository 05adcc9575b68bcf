//! One primitive with Gaussians.

use std::collections::BTreeSet;

use glam::{DQuat, Quat, Vec3};
use rayon::prelude::*;
use serde_json::Value;
use stylegaussian::{
    light::srgb_from_linear,
    scene::{Scene, Sh},
    sh,
    work::Work,
};

use super::{
    accessor::{Accessor, Component},
    document::{Document, index},
};
use crate::{
    error::{Mismatch, mismatch},
    pages::enlarge,
    spz,
};

/// The extension.
pub(super) const EXTENSION: &str = "KHR_gaussian_splatting";

/// Drafts in which an SPZ file takes the place of accessors, the newest first. The last is by itself; the
/// others lie within the extension.
pub(super) const SPZ_EXTENSIONS: [&str; 3] = [
    "KHR_gaussian_splatting_compression_spz_2",
    "KHR_gaussian_splatting_compression_spz",
    "KHR_spz_gaussian_splats_compression",
];

/// A primitive whose points are Gaussians.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splats<'a> {
    /// The primitive.
    pub primitive: &'a Value,
    /// Its extension.
    extension: &'a Value,
}

/// Bounds of a reading.
pub(super) struct Limits<'a> {
    /// Bytes that Gaussians may still take. It is lowered before they are allocated.
    pub memory_left: &'a mut usize,
    /// Whether nothing but application attributes is read from the document after this primitive.
    pub is_last: bool,
}

/// Bytes of a Gaussian in memory without its spherical harmonics: mean, rotation, scales, opacity, order.
pub(super) const GAUSSIAN_BYTES: usize = 48;

impl<'a> Splats<'a> {
    /// The Gaussians of a primitive, or `None` if it has none.
    pub fn new(primitive: &'a Value) -> Option<Self> {
        let extensions = &primitive["extensions"];
        let mut names = [EXTENSION].into_iter().chain(SPZ_EXTENSIONS);
        let extension = names.find_map(|name| extensions.get(name))?;
        Some(Self { primitive, extension })
    }

    /// Reads the Gaussians in the axes of the mesh.
    pub fn read(
        &self,
        document: &mut Document,
        are_logarithms: bool,
        Limits { memory_left, is_last }: Limits,
        warnings: &mut Vec<String>,
        work: &Work,
    ) -> Result<Scene, Mismatch> {
        self.warn_of_unknowns(warnings);
        let mut reserve = |n: usize, n_coefficients: usize| {
            let needed = n.saturating_mul(GAUSSIAN_BYTES + 12 * n_coefficients);
            *memory_left = memory_left.checked_sub(needed).ok_or_else(|| {
                mismatch(
                    format_args!("nodes and accessors that repeat Gaussians {n} at a time"),
                    "at most 64 bytes of Gaussians for a byte of the file",
                )
            })?;
            Ok(())
        };
        if let Some(compressed) = self.compressed() {
            return self.read_spz(document, compressed, &mut reserve, warnings, work);
        }
        let n = self.accessor(document, "POSITION", 3)?.count;
        if u32::try_from(n).is_err() {
            return Err(mismatch(format_args!("{n} Gaussians"), "fewer than 2^32"));
        }
        self.geometry(document, n)?;
        let harmonics = self.harmonics(document, n)?;
        reserve(n, harmonics.len().max(1))?;
        let sh = match harmonics.is_empty() {
            true => self.fallback_colors(document, n, warnings)?,
            false => Some(self.colors(&harmonics, n, warnings, work)),
        };
        work.at(0.6)?;
        if is_last {
            // Most of the file is in them.
            document.release(&self.views_of_harmonics(&document.json));
        }
        let [position, rotation, scale, opacity] = self.geometry(document, n)?;
        let scale = |i: usize| {
            let scale = Vec3::from_array(scale.row(i));
            if are_logarithms { scale.exp() } else { scale }
        };
        let means = indices(n).map(|i| Vec3::from_array(position.row(i))).collect();
        work.at(0.7)?;
        let rotations = indices(n).map(|i| unit(rotation.row(i))).collect();
        work.at(0.8)?;
        let scales = indices(n).map(scale).collect();
        work.at(0.9)?;
        Ok(Scene {
            means,
            rotations,
            scales,
            opacities: indices(n).map(|i| opacity.row::<1>(i)[0].clamp(0.0, 1.0)).collect(),
            sh,
            order: (0..n as u32).collect(),
            n_source: n,
            ..Scene::default()
        })
    }

    /// The draft in which the primitive is an SPZ file, and its buffer view; or `None` if it has accessors.
    fn compressed(&self) -> Option<(&'static str, usize)> {
        let of = [&self.extension["extensions"], &self.primitive["extensions"]];
        SPZ_EXTENSIONS.into_iter().find_map(|name| {
            let draft = of.iter().find_map(|extensions| extensions.get(name))?;
            Some((name, index(&draft["bufferView"])?))
        })
    }

    /// Reads an SPZ file inside of the glTF. Its numbers count in the axes of the mesh.
    fn read_spz(
        &self,
        document: &Document,
        (name, view): (&str, usize),
        reserve: &mut dyn FnMut(usize, usize) -> Result<(), Mismatch>,
        warnings: &mut Vec<String>,
        work: &Work,
    ) -> Result<Scene, Mismatch> {
        let scene = spz::in_its_own_axes(document.view(view)?.0, warnings, work).map_err(|mismatch| {
            let found = format!("{} in {name}", mismatch.found);
            Mismatch { found, ..mismatch }
        })?;
        let degree = scene.sh.as_ref().map_or(0, |sh| sh.degree);
        reserve(scene.n_source, sh::n_coefficients(degree))?;
        Ok(scene)
    }

    /// Warns of kernels, projections and color spaces that are not known, which the extension asks to draw as
    /// ellipses.
    fn warn_of_unknowns(&self, warnings: &mut Vec<String>) {
        for (key, known) in [
            ("kernel", &["ellipse"][..]),
            ("projection", &["perspective"]),
            ("colorSpace", &["srgb_rec709_display", "lin_rec709_display"]),
        ] {
            match self.extension[key].as_str() {
                Some(found) if !known.contains(&found) => {
                    let short: String = found.chars().take(40).collect();
                    warnings.push(format!("unknown {key} `{short}`: taken for {}", known[0]));
                }
                _ => {}
            }
        }
    }

    fn attribute(&self, name: &str) -> Option<&'a Value> {
        self.primitive["attributes"].get(name)
    }

    fn accessor<'d>(
        &self,
        document: &'d Document,
        name: &str,
        width: usize,
    ) -> Result<Accessor<'d>, Mismatch> {
        let index = self
            .attribute(name)
            .ok_or_else(|| mismatch(format_args!("Gaussians without attribute {name}"), "all attributes"))?;
        Accessor::new(document, index, width, name)
    }

    /// An attribute of the extension, with a row for each Gaussian.
    fn property<'d>(
        &self,
        document: &'d Document,
        name: &str,
        width: usize,
        n: usize,
    ) -> Result<Accessor<'d>, Mismatch> {
        with_rows(self.accessor(document, &format!("{EXTENSION}:{name}"), width)?, name, n)
    }

    /// Positions, rotations, scales and opacities.
    fn geometry<'d>(&self, document: &'d Document, n: usize) -> Result<[Accessor<'d>; 4], Mismatch> {
        Ok([
            self.accessor(document, "POSITION", 3)?,
            self.property(document, "ROTATION", 4, n)?,
            self.property(document, "SCALE", 3, n)?,
            self.property(document, "OPACITY", 1, n)?,
        ])
    }

    /// The buffer views of coefficients that no other attribute shares.
    fn views_of_harmonics(&self, json: &Value) -> BTreeSet<usize> {
        let prefix = format!("{EXTENSION}:SH_DEGREE_");
        let attributes = self.primitive["attributes"].as_object().into_iter().flatten();
        let view = |accessor: &Value| {
            let accessor = json["accessors"].get(index(accessor)?)?;
            let sparse = &accessor["sparse"];
            let of = [accessor, &sparse["indices"], &sparse["values"]];
            Some(of.into_iter().filter_map(move |of| index(&of["bufferView"])))
        };
        let (harmonics, others): (Vec<_>, Vec<_>) =
            attributes.partition(|(name, _)| name.starts_with(&prefix));
        let views = |of: Vec<(&String, &Value)>| {
            of.into_iter().filter_map(|(_, index)| view(index)).flatten().collect()
        };
        let (harmonics, others): (BTreeSet<usize>, BTreeSet<usize>) = (views(harmonics), views(others));
        &harmonics - &others
    }

    /// The accessors of all coefficients, whole degrees; empty if there are none.
    fn harmonics<'d>(&self, document: &'d Document, n: usize) -> Result<Vec<Accessor<'d>>, Mismatch> {
        let mut found = Vec::new();
        for degree in 0..=sh::MAX_DEGREE {
            let names: Vec<String> =
                (0..=2 * degree).map(|i| format!("SH_DEGREE_{degree}_COEF_{i}")).collect();
            if !names.iter().any(|name| self.attribute(&format!("{EXTENSION}:{name}")).is_some()) {
                break;
            }
            for name in names {
                found.push(self.property(document, &name, 3, n)?);
            }
        }
        Ok(found)
    }

    /// The spherical harmonics in display-referred colors.
    fn colors(&self, harmonics: &[Accessor], n: usize, warnings: &mut Vec<String>, work: &Work) -> Sh {
        let mut coefficients = vec![0.0; n * 3 * harmonics.len()];
        enlarge(&mut coefficients);
        let is_linear = self.extension["colorSpace"] == "lin_rec709_display";
        if is_linear {
            warnings
                .push("linear colors were turned to sRGB for each Gaussian: blends differ a little".into());
        }
        let rows = coefficients.par_chunks_exact_mut(3 * harmonics.len());
        rows.enumerate().with_min_len(MIN_SHARE).for_each(|(i, row)| {
            if work.is_canceled() {
                return;
            }
            for (rgb, accessor) in row.as_chunks_mut::<3>().0.iter_mut().zip(harmonics) {
                *rgb = accessor.row(i);
            }
            if is_linear {
                to_display(row);
            }
        });
        // The number of coefficients is a square: whole degrees were read.
        let degree = (0..sh::MAX_DEGREE).find(|&degree| sh::n_coefficients(degree) == harmonics.len());
        Sh { degree: degree.unwrap_or(sh::MAX_DEGREE), coefficients }
    }

    /// Colors for viewers without the extension, which are linear.
    fn fallback_colors(
        &self,
        document: &Document,
        n: usize,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Sh>, Mismatch> {
        let Some(index) = self.attribute("COLOR_0") else {
            warnings.push("no color (SH_DEGREE_0_COEF_0 or COLOR_0): every Gaussian is mid-gray".into());
            return Ok(None);
        };
        warnings.push("no SH_DEGREE_0_COEF_0: colors of COLOR_0".into());
        let color = |linear: [f32; 3]| sh::dc_from_color(linear.map(srgb_from_linear));
        let coefficients = match Accessor::new(document, index, 4, "COLOR_0") {
            Ok(rgba) => {
                let rgba = with_rows(rgba, "COLOR_0", n)?;
                (0..n)
                    .flat_map(|i| {
                        let [r, g, b, _] = rgba.row(i);
                        color([r, g, b])
                    })
                    .collect()
            }
            Err(_) => {
                let rgb = with_rows(Accessor::new(document, index, 3, "COLOR_0")?, "COLOR_0", n)?;
                (0..n).flat_map(|i| color(rgb.row(i))).collect()
            }
        };
        Ok(Some(Sh { degree: 0, coefficients }))
    }
}

/// Gaussians that one thread reads at least: handing over fewer takes longer than reading them, and a file may
/// have very many primitives of very few.
const MIN_SHARE: usize = 1024;

/// 0 to n - 1, for several threads.
fn indices(n: usize) -> impl IndexedParallelIterator<Item = usize> {
    (0..n).into_par_iter().with_min_len(MIN_SHARE)
}

/// Checks that an accessor has a row for each of `n` Gaussians.
pub(super) fn with_rows<'a>(accessor: Accessor<'a>, name: &str, n: usize) -> Result<Accessor<'a>, Mismatch> {
    match accessor.count {
        count if count == n => Ok(accessor),
        count => {
            Err(mismatch(format_args!("{count} rows of {name}"), format_args!("{n}, one for each Gaussian")))
        }
    }
}

/// Turns the linear spherical harmonics of a Gaussian to display-referred ones: the base color by the sRGB
/// curve, the others by its slope there.
fn to_display(coefficients: &mut [f32]) {
    let base = sh::color_from_dc([coefficients[0], coefficients[1], coefficients[2]]);
    for rgb in coefficients.as_chunks_mut::<3>().0 {
        for (value, base) in rgb.iter_mut().zip(base) {
            *value *= slope(base);
        }
    }
    coefficients[..3].copy_from_slice(&sh::dc_from_color(base.map(srgb_from_linear)));
}

/// The slope of [`srgb_from_linear`].
fn slope(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 } else { 1.055 / 2.4 * linear.powf(1.0 / 2.4 - 1.0) }
}

/// The quaternion at length 1. One that has it keeps its bits.
fn unit(xyzw: [f32; 4]) -> Quat {
    let stored = DQuat::from_array(xyzw.map(f64::from));
    // f32 rounds each component by up to 6e-8 of it.
    match (stored.length_squared() - 1.0).abs() < 1e-6 {
        true => Quat::from_array(xyzw),
        // A zero quaternion becomes 0 times infinity, which is NaN.
        false => (stored * stored.length().recip()).as_quat(),
    }
}

/// Whether the file's scales are logarithms, as in drafts of the extension: some are below 0, or of a signed
/// integer type, which the ratified extension does not allow.
pub(super) fn scales_are_logarithms<'a>(
    document: &Document,
    found: impl Iterator<Item = Splats<'a>>,
) -> Result<bool, Mismatch> {
    let mut seen = BTreeSet::new();
    for splats in found {
        let name = format!("{EXTENSION}:SCALE");
        let Some(index) = splats.attribute(&name).filter(|_| splats.compressed().is_none()) else { continue };
        // Many primitives may share an accessor.
        if !seen.insert(index.as_u64()) {
            continue;
        }
        let scales = Accessor::new(document, index, 3, &name)?;
        let is_signed = matches!(scales.component, Component::I8 | Component::I16);
        if is_signed || indices(scales.count).any(|i| scales.row::<3>(i).iter().any(|&s| s < 0.0)) {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_is_that_of_the_curve() {
        for linear in [-0.5, 0.0, 0.001, 0.01, 0.2, 0.9, 1.5] {
            let difference = srgb_from_linear(linear + 5e-4) - srgb_from_linear(linear - 5e-4);
            assert!((difference / 1e-3 - slope(linear)).abs() < 0.02 * slope(linear), "{linear}");
        }
    }
}
