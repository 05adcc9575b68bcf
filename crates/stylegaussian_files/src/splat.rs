//! `.splat`, the format of antimatter15's viewer: 32 bytes for each Gaussian and nothing else.
//!
//! | bytes | |
//! | --- | --- |
//! | 0..12 | mean, three f32 |
//! | 12..24 | standard deviations, three f32, linear |
//! | 24..28 | red, green, blue and opacity, 0..255; the color is 0.5 + Y_00 f_dc |
//! | 28..32 | quaternion w, x, y, z as 128 q + 128 |
//!
//! The file has no mark: it is known by its extension. Axes are those of `.ply` files. (`convert.py` of
//! github.com/antimatter15/splat, MIT.)

use std::io::{self, Write};

use glam::Vec3;
use rayon::prelude::*;
use stylegaussian::{
    scene::{Scene, Sh},
    sh::{color_from_dc, dc_from_color, n_coefficients},
    work::Work,
};

use super::{
    activate::{drop_broken, unit_quaternion},
    distant,
    error::{Loaded, Mismatch, bytes_in_words, mismatch},
    format::Format,
};

/// The format.
pub(super) const FORMAT: Format = Format {
    name: ".splat",
    extensions: &["splat"],
    recognizes: |_, extension| extension == "splat",
    read: |files, _| Ok(read(&files.main, &files.work)?),
    write: Some(|out, scene, _| Ok(write(out, scene).map(|()| clamped(scene))?)),
};

/// Size of a Gaussian, in bytes.
pub(super) const ROW: usize = 32;

/// Reads a scene.
pub(super) fn read(bytes: &[u8], work: &Work) -> Result<Loaded, Mismatch> {
    let (rows, rest) = bytes.as_chunks::<ROW>();
    if !rest.is_empty() {
        let expected = format!("a multiple of {ROW}, the size of a Gaussian in a .splat");
        return Err(mismatch(bytes_in_words(bytes.len() as u64), expected));
    }
    let n = rows.len();
    if u32::try_from(n).is_err() {
        return Err(mismatch(format_args!("{n} Gaussians"), "fewer than 2^32"));
    }
    let vec3 = |row: &[u8; ROW], at: usize| {
        Vec3::from_array([0, 4, 8].map(|i| {
            let at = at + i;
            f32::from_le_bytes([row[at], row[at + 1], row[at + 2], row[at + 3]])
        }))
    };
    let color = |row: &[u8; ROW]| dc_from_color([24, 25, 26].map(|i| f32::from(row[i]) / 255.0));
    let base: Vec<[f32; 3]> = rows.par_iter().map(color).collect();
    work.at(0.3)?;
    let scene = Scene {
        means: rows.par_iter().map(|row| vec3(row, 0)).collect(),
        // A Gaussian with a negative standard deviation is drawn as its positive twin.
        scales: rows.par_iter().map(|row| vec3(row, 12).abs()).collect(),
        rotations: rows.par_iter().map(|row| rotation([row[28], row[29], row[30], row[31]])).collect(),
        opacities: rows.par_iter().map(|row| f32::from(row[27]) / 255.0).collect(),
        sh: Some(Sh { degree: 0, coefficients: base.into_flattened() }),
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    work.at(0.9)?;
    let mut warnings = Vec::new();
    let scene = drop_broken(scene, &mut warnings);
    Ok(Loaded::new(scene, warnings))
}

/// The unit quaternion of four bytes w, x, y, z, or NaN if all of them stand for 0.
fn rotation(wxyz: [u8; 4]) -> glam::Quat {
    unit_quaternion(wxyz.map(|byte| (f32::from(byte) - 128.0) / 128.0))
}

/// Writes base colors and Gaussians in the source's order. Colors beyond 0..1 are clamped, and view dependence
/// is lost.
fn write(out: &mut dyn Write, scene: &Scene) -> io::Result<()> {
    for i in scene.by_source() {
        out.write_all(&row(scene, i as usize))?;
    }
    Ok(())
}

/// Warnings of the colors that [`write`] clamps, and of an offset.
fn clamped(scene: &Scene) -> Vec<String> {
    // Half a step beyond the end is rounded and not clamped. Below 0 a color is drawn as 0 in any format.
    let is_beyond = |value: &f32| value * 255.0 > 255.5;
    let n = scene.base_colors().iter().filter(|rgb| rgb.iter().any(is_beyond)).count();
    let warning = || format!("{n} Gaussians have colors above 1, which were clamped");
    distant::left_out(scene).into_iter().chain((n > 0).then(warning)).collect()
}

fn row(scene: &Scene, i: usize) -> [u8; ROW] {
    let mut row = [0; ROW];
    row[..12].copy_from_slice(bytemuck::bytes_of(&scene.means[i].to_array().map(f32::to_le_bytes)));
    row[12..24].copy_from_slice(bytemuck::bytes_of(&scene.scales[i].to_array().map(f32::to_le_bytes)));
    let color = scene.sh.as_ref().map_or([0.5; 3], |sh| {
        let at = 3 * n_coefficients(sh.degree) * i;
        color_from_dc([0, 1, 2].map(|channel| sh.coefficients[at + channel]))
    });
    // A cast saturates, so that 1 becomes 255 and not 256.
    let [r, g, b] = color.map(|value| (value * 255.0).round() as u8);
    let opacity = (scene.opacities[i] * 255.0).round() as u8;
    row[24..28].copy_from_slice(&[r, g, b, opacity]);
    let q = scene.rotations[i];
    row[28..].copy_from_slice(&[q.w, q.x, q.y, q.z].map(|value| (value * 128.0 + 128.0).round() as u8));
    row
}

#[cfg(test)]
mod tests;
