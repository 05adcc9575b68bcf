//! Gaussians on disk while they are sorted: numbers, for this machine alone.

use std::{fs::File, io::Read, path::Path};

use glam::{Quat, Vec3};
use stylegaussian::{
    Scene,
    scene::{ScreenFilter, Sh},
    sh,
};

use crate::error::{FileError, bytes_in_words, mismatch};

/// The place of the coefficients in a record, after mean, rotation, scales and opacity.
const COEFFICIENTS: usize = 11;

/// Numbers of a record whose coefficients end at this degree: 14 for degree 0, 59 for degree 3.
pub(super) const fn width(degree: u8) -> usize {
    COEFFICIENTS + 3 * sh::n_coefficients(degree)
}

/// The degree of a scene's spherical harmonics, 0 if there are none.
pub(super) fn degree(scene: &Scene) -> u8 {
    scene.sh.as_ref().map_or(0, |sh| sh.degree)
}

/// Writes Gaussian `i` of a scene, whose mean is moved by `offset`, to `record` `[width]`. Coefficients that do
/// not fit are left out, and those that the scene lacks are 0: mid-gray, the same from every side.
pub(super) fn fill(record: &mut [f32], scene: &Scene, i: usize, offset: Vec3) {
    let (geometry, coefficients) = record.split_at_mut(COEFFICIENTS);
    let mean = (scene.means[i] + offset).to_array();
    let rotation = scene.rotations[i].to_array();
    let scales = scene.scales[i].to_array();
    let values = mean.iter().chain(&rotation).chain(&scales).chain([&scene.opacities[i]]);
    geometry.iter_mut().zip(values).for_each(|(place, value)| *place = *value);
    coefficients.fill(0.0);
    if let Some(sh) = &scene.sh {
        let stored = 3 * sh::n_coefficients(sh.degree);
        let values = &sh.coefficients[stored * i..][..stored];
        coefficients.iter_mut().zip(values).for_each(|(place, value)| *place = *value);
    }
}

/// The scene of records `[n, width(degree)]`.
pub(super) fn scene(records: &[f32], degree: u8, filter: ScreenFilter) -> Scene {
    let rows = || records.chunks_exact(width(degree));
    let n = rows().len();
    Scene {
        means: rows().map(mean).collect(),
        rotations: rows().map(|record| Quat::from_slice(&record[3..7])).collect(),
        scales: rows().map(|record| Vec3::from_slice(&record[7..10])).collect(),
        opacities: rows().map(|record| record[10]).collect(),
        sh: Some(Sh {
            degree,
            coefficients: rows().flat_map(|record| &record[COEFFICIENTS..]).copied().collect(),
        }),
        order: (0..n as u32).collect(),
        n_source: n,
        filter,
        ..Scene::default()
    }
}

/// The mean of a record.
pub(super) fn mean(record: &[f32]) -> Vec3 {
    Vec3::from_slice(&record[..3])
}

/// Reads a file of `n` records `[n, width(degree)]`.
///
/// # Errors
/// If it has another size, or cannot be read.
pub(super) fn read(path: &Path, n: usize, degree: u8) -> Result<Vec<f32>, FileError> {
    let at = |source| FileError::Io { path: path.into(), source };
    let mut file = File::open(path).map_err(at)?;
    let size = file.metadata().map_err(at)?.len();
    let n_numbers = n.saturating_mul(width(degree));
    let expected = (n_numbers as u64).saturating_mul(size_of::<f32>() as u64);
    if size != expected {
        return Err(mismatch(
            bytes_in_words(size),
            format_args!("{expected}: remove the folder, and start anew"),
        )
        .at(path));
    }
    let mut records = vec![0.0; n_numbers];
    file.read_exact(bytemuck::cast_slice_mut(&mut records)).map_err(at)?;
    Ok(records)
}
