//! Volumes that tint clouds, as the kernel takes them.

use glam::Affine3A;
use stylegaussian::{
    layers::Region,
    light::{MAX_TINT_VOLUMES, TintVolume},
};
use stylegaussian_shaders::splat::light as shaders;

use super::rows;
use crate::{
    regions::PackedRegion,
    splat::camera::{Camera, in_f64},
};

/// The last volumes that change anything, of points in a camera's view, and their number. `volumes` are of
/// points in the world.
pub(super) fn of_view(
    volumes: &[TintVolume],
    camera: &Camera,
) -> ([shaders::TintVolume; MAX_TINT_VOLUMES], u32) {
    let last = &volumes[volumes.len().saturating_sub(MAX_TINT_VOLUMES)..];
    let (mut packed, mut n) = ([shaders::TintVolume::default(); MAX_TINT_VOLUMES], 0);
    for volume in last.iter().filter_map(|volume| of_camera(volume, camera)) {
        packed[n] = volume;
        n += 1;
    }
    (packed, n as u32)
}

fn of_camera(volume: &TintVolume, camera: &Camera) -> Option<shaders::TintVolume> {
    let [red, green, blue] = rows(volume.change()?);
    // In f64: far from the world's origin both factors are large.
    let shape_from_view = in_f64(&volume.region.shape_from_scene) * in_f64(&camera.world_from_view);
    let shape_from_scene = Affine3A::from_mat3_translation(
        shape_from_view.matrix3.as_mat3(),
        shape_from_view.translation.as_vec3(),
    );
    let region = PackedRegion::new(&Region { shape_from_scene, ..volume.region })?;
    let [shape_from_view_x, shape_from_view_y, shape_from_view_z] = region.rows;
    Some(shaders::TintVolume {
        shape_from_view_x,
        shape_from_view_y,
        shape_from_view_z,
        sizes: region.sizes,
        red,
        green,
        blue,
        shape: region.shape,
        softness: region.softness,
        inverse_softness: region.inverse_softness,
        padding: 0,
    })
}
