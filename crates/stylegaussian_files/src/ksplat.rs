//! `.ksplat`, the format of GaussianSplats3D: sections of Gaussians, plain or relative to the center of their
//! bucket.
//!
//! A header of 4,096 bytes, one of 1,024 for each section, then the sections' data: a table of the sizes of
//! buckets that are not full (u32), the centers of all buckets (three f32), and the Gaussians. By level of
//! compression:
//!
//! | level | mean | standard deviations | quaternion w, x, y, z | RGB, opacity | SH |
//! | --- | --- | --- | --- | --- | --- |
//! | 0 | f32 | f32, linear | f32 | u8 | f32 |
//! | 1 | u16 in the bucket | f16, linear | f16 | u8 | f16 |
//! | 2 | u16 in the bucket | f16, linear | f16 | u8 | u8 |
//!
//! Spherical harmonics are stored degree by degree, channel-major within a degree. The file has no mark: it is
//! known by its extension. Axes are those of `.ply` files. (`SplatBuffer.js` of
//! github.com/mkkellogg/GaussianSplats3D, MIT.)

use glam::Vec3;
use half::f16;
use stylegaussian::{
    scene::{Scene, Sh},
    sh::{MAX_DEGREE, dc_from_color, n_coefficients},
    slices::SLICE,
    work::{Canceled, Work},
};

use super::{
    activate::{drop_broken, unit_quaternion},
    error::{Loaded, Mismatch, mismatch},
    format::Format,
    pages::enlarge,
};

mod header;

use header::{Header, Section};

/// The format.
pub(super) const FORMAT: Format = Format {
    name: ".ksplat",
    extensions: &["ksplat"],
    recognizes: |_, extension| extension == "ksplat",
    read: |files, _| Ok(read(&files.main, &files.work)?),
    write: None,
};

/// Reads a scene.
pub(super) fn read(bytes: &[u8], work: &Work) -> Result<Loaded, Mismatch> {
    let header = Header::parse(bytes)?;
    // Sections lie behind one another in the file, so that their sum is bounded by its size.
    let n = header.sections.iter().map(Section::len).sum();
    if u32::try_from(n).is_err() {
        return Err(mismatch(format_args!("{n} Gaussians"), "fewer than 2^32"));
    }
    let degree = header.sections.iter().map(|section| section.degree).max().unwrap_or(0);
    let mut scene = Scene {
        means: Vec::with_capacity(n),
        rotations: Vec::with_capacity(n),
        scales: Vec::with_capacity(n),
        opacities: Vec::with_capacity(n),
        sh: Some(Sh { degree, coefficients: Vec::with_capacity(3 * n_coefficients(degree) * n) }),
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    scene.sh.iter_mut().for_each(|sh| enlarge(&mut sh.coefficients));
    for section in &header.sections {
        add(section, &header, &mut scene, work)?;
    }
    let mut warnings = Vec::new();
    let scene = drop_broken(scene, &mut warnings);
    Ok(Loaded::new(scene, warnings))
}

/// Adds the Gaussians of a section.
///
/// # Errors
/// If `work` is canceled.
fn add(section: &Section, header: &Header, scene: &mut Scene, work: &Work) -> Result<(), Canceled> {
    let wide = header.level == 0;
    let number = |row: &[u8], i: usize| match wide {
        true => f32_at(row, 4 * i),
        false => f16::from_le_bytes([row[2 * i], row[2 * i + 1]]).to_f32(),
    };
    let width = if wide { 4 } else { 2 };
    for (row, center) in section.rows.chunks_exact(section.row).zip(section.centers()) {
        if scene.means.len().is_multiple_of(SLICE) {
            work.at(scene.means.len() as f32 / scene.n_source as f32)?;
        }
        let mean = match wide {
            true => Vec3::from_array([0, 1, 2].map(|axis| number(row, axis))),
            false => {
                let step = |axis: usize| f32::from(u16::from_le_bytes([row[2 * axis], row[2 * axis + 1]]));
                let steps = Vec3::from_array([0, 1, 2].map(|axis| step(axis) - section.range));
                center + steps * (section.block / 2.0 / section.range)
            }
        };
        scene.means.push(mean);
        scene.scales.push(Vec3::from_array([3, 4, 5].map(|i| number(row, i))).abs());
        scene.rotations.push(unit_quaternion([6, 7, 8, 9].map(|i| number(row, i))));
        let [r, g, b, opacity] = [0, 1, 2, 3].map(|i| f32::from(row[10 * width + i]) / 255.0);
        scene.opacities.push(opacity);
        let rest = header.coefficients(&row[10 * width + 4..]);
        if let Some(sh) = &mut scene.sh {
            push_coefficients([r, g, b], &rest, section.degree, sh);
        }
    }
    Ok(())
}

/// Appends a Gaussian's coefficients: the constant one of a color, and `rest`, degree by degree and
/// channel-major within.
fn push_coefficients(color: [f32; 3], rest: &[f32], stored: u8, sh: &mut Sh) {
    let end = sh.coefficients.len() + 3 * n_coefficients(sh.degree);
    sh.coefficients.extend(dc_from_color(color));
    for degree in 1..=stored.min(MAX_DEGREE) {
        let n = usize::from(2 * degree + 1);
        let band = &rest[3 * (n_coefficients(degree - 1) - 1)..];
        for i in 0..n {
            sh.coefficients.extend([0, 1, 2].map(|channel| band[channel * n + i]));
        }
    }
    // Sections of a lower degree than others are filled up.
    sh.coefficients.resize(end, 0.0);
}

/// A number in a row or a header.
fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

#[cfg(test)]
pub(super) mod tests;
