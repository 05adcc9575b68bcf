//! The cameras of a capture in its scene file.
//!
//! A row of 13 numbers for each: the turn from world to view as a unit quaternion (x, y, z, w) and the way from world to view
//! after it (x, y, z); focal lengths (x, y) and center (x, y) in pixels; width and height in pixels. View space is x right, y down, z
//! forward.

use glam::{Affine3A, Quat, UVec2, Vec2, Vec3};

use crate::camera::Camera;

use super::super::{
    error::{Mismatch, mismatch},
    tensors::{
        Dimension::{Any, Is},
        Reader, Writer,
    },
};

/// The tensor's name.
pub(super) const TENSOR: &str = "cameras";

/// Numbers of a camera.
const WIDTH: usize = 13;

/// Largest side of a picture, in pixels: what the largest sensors take.
const MOST_PIXELS: f32 = 65_536.0;

/// Reads the cameras.
pub(super) fn from_tensor(reader: &Reader) -> Result<Vec<Camera>, Mismatch> {
    let values = reader.floats(TENSOR, &[Any("M"), Is(WIDTH)])?;
    values.as_chunks::<WIDTH>().0.iter().enumerate().map(|(i, row)| camera(i, row)).collect()
}

fn camera(i: usize, row: &[f32; WIDTH]) -> Result<Camera, Mismatch> {
    let turn = Quat::from_slice(&row[..4]);
    // As for the rotations of Gaussians: other writers may round to f16. NaN fails the comparison, too.
    let is_turn = (turn.length() - 1.0).abs() <= 1e-3;
    let size = Vec2::from_slice(&row[11..]);
    let is_size = size.min_element() >= 1.0 && size.max_element() <= MOST_PIXELS;
    let camera = Camera {
        view_from_world: Affine3A::from_rotation_translation(turn.normalize(), Vec3::from_slice(&row[4..7])),
        focal: Vec2::from_slice(&row[7..9]),
        center: Vec2::from_slice(&row[9..11]),
        size: size.as_uvec2().max(UVec2::ONE),
    };
    if is_turn && is_size && camera.is_usable() {
        return Ok(camera);
    }
    Err(mismatch(
        format_args!("camera {i} of `{TENSOR}`: {row:?}"),
        "a unit quaternion, a place, focal lengths above 0, a center, and a width and height of 1 to 65536",
    ))
}

/// Adds the cameras to a file.
pub(super) fn to_tensor(cameras: &[Camera], writer: &mut Writer) -> Result<(), Mismatch> {
    let mut values = Vec::with_capacity(WIDTH * cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let row = row_of(camera);
        // What could not be read again is not written.
        self::camera(i, &row)?;
        values.extend(row);
    }
    writer.made(TENSOR, &[cameras.len(), WIDTH], move |i| values[i]);
    Ok(())
}

fn row_of(camera: &Camera) -> [f32; WIDTH] {
    let turn = Quat::from_mat3a(&camera.view_from_world.matrix3);
    let way = camera.view_from_world.translation;
    let (focal, center, size) = (camera.focal, camera.center, camera.size.as_vec2());
    [
        turn.x, turn.y, turn.z, turn.w, way.x, way.y, way.z, focal.x, focal.y, center.x, center.y, size.x,
        size.y,
    ]
}
