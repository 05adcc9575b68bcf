//! Writing the native 3DGS layout: binary little endian, normals of zero, the source's order. Positions of a
//! scene with an offset are doubles, in the coordinates of its source.

use std::io::{self, Write};

use glam::DVec3;
use stylegaussian::{
    scene::{Scene, ScreenFilter},
    sh::n_coefficients,
};

use super::distant;
use crate::format::WriteOptions;

/// Writes Gaussians and their spherical harmonics in the source's order, mid-gray if the scene keeps no colors.
/// Parts of a source Gaussian are Gaussians of their own here, one after another.
/// Features, neighbors and decoder have no place in a `.ply`.
pub(crate) fn write(out: &mut dyn Write, scene: &Scene, options: &WriteOptions) -> io::Result<()> {
    let captured = scene.sh.as_ref().map_or(0, |sh| sh.degree);
    let degree = if options.fills_sh { captured.max(options.sh_degree) } else { captured };
    let n_rest = n_coefficients(degree) - 1;
    write_header(out, scene, 3 * n_rest)?;
    let mut row = Vec::new();
    for i in scene.by_source() {
        row.clear();
        push_row(scene, i as usize, n_rest, &mut row);
        out.write_all(bytemuck::cast_slice(&row))?;
    }
    Ok(())
}

/// Writes the first lines of a header, with the comments that the readers of this crate know.
pub(super) fn write_start(out: &mut dyn Write, scene: &Scene) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    if let Some(up) = scene.up {
        writeln!(out, "comment up {} {} {}", up.x, up.y, up.z)?;
    }
    if scene.filter == ScreenFilter::Antialiased {
        writeln!(out, "comment SplatRenderMode: mip")?;
    }
    Ok(())
}

/// Writes the header, with `n_rest` coefficients beyond degree 0 per Gaussian.
fn write_header(out: &mut dyn Write, scene: &Scene, n_rest: usize) -> io::Result<()> {
    write_start(out, scene)?;
    let DVec3 { x, y, z } = scene.offset;
    if scene.offset != DVec3::ZERO {
        writeln!(out, "comment {} {x} {y} {z}", distant::COMMENT)?;
    }
    writeln!(out, "element vertex {}", scene.len())?;
    let fixed = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let coordinate = if scene.offset == DVec3::ZERO { "float" } else { "double" };
    for name in ["x", "y", "z"] {
        writeln!(out, "property {coordinate} {name}")?;
    }
    let mut names = fixed(&["nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]);
    names.extend((0..n_rest).map(|i| format!("f_rest_{i}")));
    names.extend(fixed(&["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]));
    for name in names {
        writeln!(out, "property float {name}")?;
    }
    writeln!(out, "end_header")
}

/// Appends the values of Gaussian `i` before their activations, each in little endian, doubles in two parts.
fn push_row(scene: &Scene, i: usize, n_rest: usize, row: &mut Vec<[u8; 4]>) {
    if scene.offset != DVec3::ZERO {
        let position = (scene.offset + scene.means[i].as_dvec3()).to_array();
        position.iter().for_each(|value| row.extend_from_slice(value.to_le_bytes().as_chunks().0));
    } else {
        row.extend(scene.means[i].to_array().map(f32::to_le_bytes));
    }
    let mut push = |value: f32| row.push(value.to_le_bytes());
    [0.0; 3].into_iter().for_each(&mut push);
    let of_gaussian = scene.sh.as_ref().map(|sh| {
        let width = 3 * n_coefficients(sh.degree);
        &sh.coefficients[i * width..(i + 1) * width]
    });
    let (dc, rest) = of_gaussian.unwrap_or(&[0.0; 3]).split_at(3);
    dc.iter().copied().for_each(&mut push);
    // Channel-major in the file, RGB innermost in memory. Degrees that the scene lacks are zeros.
    for channel in 0..3 {
        let stored = rest.iter().skip(channel).step_by(3).copied();
        stored.chain(std::iter::repeat(0.0)).take(n_rest).for_each(&mut push);
    }
    push(logit(scene.opacities[i]));
    scene.scales[i].to_array().map(log_scale).into_iter().for_each(&mut push);
    let rotation = scene.rotations[i];
    [rotation.w, rotation.x, rotation.y, rotation.z].into_iter().for_each(&mut push);
}

/// The inverse of the sigmoid, kept finite. Opacities 0 and 1 are moved inward by half the f32 step below 1
/// (2^-25).
fn logit(opacity: f32) -> f32 {
    // In f64, because 1 - 2^-25 rounds to 1 in f32.
    const EDGE: f64 = f32::EPSILON as f64 / 4.0;
    let opacity = f64::from(opacity).clamp(EDGE, 1.0 - EDGE);
    (opacity / (1.0 - opacity)).ln() as f32
}

/// The logarithm, kept finite: the thickness of a flat Gaussian becomes the smallest normal number.
pub(super) fn log_scale(scale: f32) -> f32 {
    scale.max(f32::MIN_POSITIVE).ln()
}
