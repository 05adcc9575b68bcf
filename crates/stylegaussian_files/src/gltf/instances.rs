//! Instances: a mesh that a node shows many times (EXT_mesh_gpu_instancing).

use glam::{DAffine3, DMat3, DQuat, DVec3};
use serde_json::Value;
use stylegaussian::scene::Scene;

use super::{accessor::Accessor, document::Document};
use crate::error::{Mismatch, mismatch};

/// The extension.
pub(super) const EXTENSION: &str = "EXT_mesh_gpu_instancing";

/// Memory that instances may take whatever the size of the file: a leaf of a few kilobytes makes a forest.
pub(super) const FREE_MEMORY: usize = 64 << 20;

/// Bytes of an instance besides its Gaussians: its transform, and the lists of a scene.
const INSTANCE_BYTES: usize = size_of::<DAffine3>() + size_of::<Scene>();

/// The transforms of a mesh's instances to the world. `part` is the mesh's scene, of which `memory_left` takes
/// a copy for each but the first.
pub(super) fn places(
    document: &Document,
    attributes: &Value,
    world_from_node: DAffine3,
    part: &Scene,
    memory_left: &mut usize,
    warnings: &mut Vec<String>,
) -> Result<Vec<DAffine3>, Mismatch> {
    let accessor = |name: &str, width: usize| match attributes.get(name) {
        Some(index) => Accessor::new(document, index, width, name).map(Some),
        None => Ok(None),
    };
    let [translations, rotations, scales] =
        [accessor("TRANSLATION", 3)?, accessor("ROTATION", 4)?, accessor("SCALE", 3)?];
    let counts = [&translations, &rotations, &scales].map(|found| found.as_ref().map(|found| found.count));
    let Some(n) = counts.into_iter().flatten().min() else {
        // Other attributes say nothing about places.
        return Ok(vec![world_from_node]);
    };
    if let Some(other) = counts.into_iter().flatten().find(|&count| count != n) {
        let found =
            format_args!("instances ({EXTENSION}) with {n} and {other} rows of attributes").to_string();
        return Err(mismatch(found, "one row of each for an instance"));
    }
    let coefficients = part.sh.as_ref().map_or(0, |sh| sh.coefficients.len());
    let copy_bytes = part.len() * super::primitive::GAUSSIAN_BYTES + 4 * coefficients + INSTANCE_BYTES;
    let n_kept = n.min(1 + *memory_left / copy_bytes);
    *memory_left -= n_kept.saturating_sub(1) * copy_bytes;
    if n_kept < n {
        warnings.push(format!(
            "left out {} of {n} instances of a mesh ({EXTENSION}): all would take {} MB",
            n - n_kept,
            n.saturating_mul(copy_bytes) / 1_000_000
        ));
    }
    let mut places = Vec::with_capacity(n_kept);
    let mut n_flat = 0;
    for i in 0..n_kept {
        let vector = |of: &Option<Accessor>, default: f64| match of {
            Some(accessor) => DVec3::from_array(accessor.row::<3>(i).map(f64::from)),
            None => DVec3::splat(default),
        };
        let (translation, scale) = (vector(&translations, 0.0), vector(&scales, 1.0));
        let rotation = match &rotations {
            Some(accessor) => DQuat::from_array(accessor.row::<4>(i).map(f64::from)),
            None => DQuat::IDENTITY,
        };
        // NaN is in no range.
        if !(translation.is_finite() && scale.is_finite() && (0.5..2.0).contains(&rotation.length())) {
            return Err(mismatch(
                format_args!("instance {i} ({EXTENSION}) with a wrong number"),
                "a finite translation and scale, and a unit rotation",
            ));
        }
        // Programs hide instances in this way.
        if scale.min_element() == 0.0 && scale.max_element() == 0.0 {
            n_flat += 1;
            continue;
        }
        let matrix3 = DMat3::from_quat(rotation.normalize()) * DMat3::from_diagonal(scale);
        places.push(world_from_node * DAffine3 { matrix3, translation });
    }
    if n_flat > 0 {
        warnings.push(format!("left out {n_flat} of {n} instances of a mesh ({EXTENSION}) whose scale is 0"));
    }
    Ok(places)
}
