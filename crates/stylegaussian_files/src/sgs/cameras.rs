//! The cameras of a capture in its scene file.
//!
//! A row of 18 numbers for each: the rigid map from world to view as a matrix `[3, 4]`, row-major; focal
//! lengths (x, y) and center (x, y) in pixels; width and height in pixels. View space is x right, y down, z
//! forward.

use glam::{Affine3A, Mat3A, Vec2, Vec3A};
use stylegaussian::camera::Camera;

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
const WIDTH: usize = 18;

/// Largest side of a picture, in pixels: more than the largest sensors have.
const MOST_PIXELS: f32 = 65_536.0;

/// Largest error of an element of a turn times its transpose. As for the rotations of Gaussians: other writers
/// may round to f16.
const MOST_ERROR: f32 = 2e-3;

/// Reads the cameras.
pub(super) fn from_tensor(reader: &Reader) -> Result<Vec<Camera>, Mismatch> {
    let values = reader.floats(TENSOR, &[Any("M"), Is(WIDTH)])?;
    values.as_chunks::<WIDTH>().0.iter().enumerate().map(|(i, row)| camera(i, row)).collect()
}

fn camera(i: usize, row: &[f32; WIDTH]) -> Result<Camera, Mismatch> {
    let column = |j: usize| Vec3A::new(row[j], row[4 + j], row[8 + j]);
    let turn = Mat3A::from_cols(column(0), column(1), column(2));
    // NaN fails the comparisons, too.
    let is_turn =
        (turn * turn.transpose()).abs_diff_eq(Mat3A::IDENTITY, MOST_ERROR) && turn.determinant() > 0.0;
    let size = Vec2::from_slice(&row[16..]);
    let is_size = size.cmpge(Vec2::ONE).all() && size.cmple(Vec2::splat(MOST_PIXELS)).all();
    let camera = Camera {
        view_from_world: Affine3A { matrix3: turn, translation: column(3) },
        focal: Vec2::from_slice(&row[12..14]),
        center: Vec2::from_slice(&row[14..16]),
        size: size.as_uvec2(),
        near: Camera::NEAR,
    };
    if is_turn && is_size && camera.is_usable() {
        return Ok(camera);
    }
    Err(mismatch(
        format_args!("camera {i} of `{TENSOR}`: {row:?}"),
        "a turn and a place, focal lengths above 0, a center, and a width and height of 1 to 65536",
    ))
}

/// Adds the cameras to a file.
pub(super) fn to_tensor(cameras: &[Camera], writer: &mut Writer) -> Result<(), Mismatch> {
    let mut values = Vec::with_capacity(WIDTH * cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let row = row_of(camera);
        // Cameras that could not be read again are not written.
        self::camera(i, &row)?;
        values.extend(row);
    }
    writer.made(TENSOR, &[cameras.len(), WIDTH], move |i| values[i]);
    Ok(())
}

fn row_of(camera: &Camera) -> [f32; WIDTH] {
    let Affine3A { matrix3, translation } = camera.view_from_world;
    let row = |i: usize| matrix3.row(i).extend(translation[i]).to_array();
    let (size, [x, y, z]) = (camera.size.as_vec2(), [row(0), row(1), row(2)]);
    let Camera { focal, center, .. } = camera;
    let picture = [focal.x, focal.y, center.x, center.y, size.x, size.y];
    let mut values = [0.0; WIDTH];
    values
        .iter_mut()
        .zip([x, y, z].as_flattened().iter().chain(&picture))
        .for_each(|(place, value)| *place = *value);
    values
}

#[cfg(test)]
mod tests {
    use glam::{UVec2, Vec3};

    use super::*;

    #[test]
    fn what_is_no_camera_is_refused() {
        let good = row_of(&Camera::look_at(Vec3::ONE, Vec3::ZERO, Vec3::NEG_Y, 0.8, UVec2::new(640, 480)));
        assert_eq!(row_of(&camera(0, &good).unwrap()), good);
        // A stretch, a place beyond f32's squares, no focal length, no center, no pixels, too many.
        let bad = [
            (0, 3.0),
            (3, f32::INFINITY),
            (7, 1e30),
            (12, 0.0),
            (14, f32::NAN),
            (16, 0.0),
            (17, 1e9),
            (16, f32::NAN),
        ];
        for (place, value) in bad {
            let mut row = good;
            row[place] = value;
            let found = camera(3, &row).unwrap_err().found;
            assert!(found.contains("camera 3"), "{place}: {found}");
        }
        let mut mirrored = good;
        mirrored[..4].iter_mut().for_each(|value| *value = -*value);
        assert!(camera(0, &mirrored).is_err());
    }
}
