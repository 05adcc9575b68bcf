//! Gaussians on disk while they are sorted: 14 numbers each, for this machine alone.

use std::{fs::File, io::Read, path::Path};

use glam::{Quat, Vec3};
use stylegaussian::{
    Scene,
    scene::{ScreenFilter, Sh},
    sh,
};

use crate::error::{FileError, mismatch};

/// Mean, rotation, scales, opacity, and the coefficients of degree 0.
pub(super) type Record = [f32; 14];

/// The records of a scene, whose means are moved by `offset`.
pub(super) fn records(scene: &Scene, offset: Vec3) -> impl Iterator<Item = Record> {
    (0..scene.len()).map(move |i| {
        let mean = (scene.means[i] + offset).to_array();
        let rotation = scene.rotations[i].to_array();
        let scales = scene.scales[i].to_array();
        // Mid-gray if there are no colors.
        let dc = scene.sh.as_ref().map_or([0.0; 3], |sh| {
            let at = 3 * sh::n_coefficients(sh.degree) * i;
            [0, 1, 2].map(|channel| sh.coefficients[at + channel])
        });
        let mut record = [0.0; 14];
        let values = mean.iter().chain(&rotation).chain(&scales).chain([&scene.opacities[i]]).chain(&dc);
        record.iter_mut().zip(values).for_each(|(place, value)| *place = *value);
        record
    })
}

/// The scene of these records.
pub(super) fn scene(records: &[Record], filter: ScreenFilter) -> Scene {
    let n = records.len();
    Scene {
        means: records.iter().map(|record| Vec3::from_slice(&record[..3])).collect(),
        rotations: records.iter().map(|record| Quat::from_slice(&record[3..7])).collect(),
        scales: records.iter().map(|record| Vec3::from_slice(&record[7..10])).collect(),
        opacities: records.iter().map(|record| record[10]).collect(),
        sh: Some(Sh {
            degree: 0,
            coefficients: records.iter().flat_map(|record| &record[11..]).copied().collect(),
        }),
        order: (0..n as u32).collect(),
        n_source: n,
        filter,
        ..Scene::default()
    }
}

/// The mean of a record.
pub(super) fn mean(record: &Record) -> Vec3 {
    Vec3::from_slice(&record[..3])
}

/// Reads a file of `n` records.
///
/// # Errors
/// If it has another size, or cannot be read.
pub(super) fn read(path: &Path, n: usize) -> Result<Vec<Record>, FileError> {
    let at = |source| FileError::Io { path: path.into(), source };
    let mut file = File::open(path).map_err(at)?;
    let size = file.metadata().map_err(at)?.len();
    let expected = (n as u64).saturating_mul(size_of::<Record>() as u64);
    if size != expected {
        let found = format_args!("{size} bytes").to_string();
        return Err(mismatch(found, format_args!("{expected}: remove the folder, and start anew")).at(path));
    }
    let mut records = vec![[0.0; 14]; n];
    file.read_exact(bytemuck::cast_slice_mut(&mut records)).map_err(at)?;
    Ok(records)
}
