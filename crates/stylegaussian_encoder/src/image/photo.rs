//! Photos of known cameras: which way a photo with an EXIF orientation is turned.

use ::image::metadata::Orientation;

use super::ImageError;
use std::path::Path;

/// Largest relative difference of the proportions of a photo from those of its camera.
const ASPECT_WITHIN: f64 = 0.01;

/// How the pixels of a photo lie in its camera's picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// As they are stored.
    Stored,
    /// Turned upright by the EXIF orientation.
    Upright,
}

/// The turn of a photo of `stored` pixels, whose camera has pictures of `camera` pixels.
///
/// COLMAP and nerfstudio pose the stored pixels, other programs turn photos first. The size tells which. If
/// both sizes fit, as for square pictures, the stored pixels are taken.
pub(super) fn turn(
    stored: (u32, u32),
    orientation: Orientation,
    camera: (u32, u32),
    path: &Path,
) -> Result<Turn, ImageError> {
    let turned = match is_on_its_side(orientation) {
        true => (stored.1, stored.0),
        false => stored,
    };
    match (fits(stored, camera), fits(turned, camera)) {
        // Nearly square pictures: the one that fits better.
        (true, true) if off(turned, camera) < off(stored, camera) => Ok(Turn::Upright),
        (true, _) => Ok(Turn::Stored),
        (false, true) => Ok(Turn::Upright),
        (false, false) => Err(ImageError::OtherAspect { path: path.into(), photo: stored, camera }),
    }
}

/// Whether the orientation swaps rows and columns.
fn is_on_its_side(orientation: Orientation) -> bool {
    matches!(orientation.to_exif(), 5..=8)
}

/// Whether a photo is the camera's picture, perhaps at another size: sides of scaled pictures are rounded to
/// whole pixels.
fn fits(photo: (u32, u32), camera: (u32, u32)) -> bool {
    let (photo, camera) = (sides(photo), sides(camera));
    let off_by_one = |scale: f64| (0..2).all(|i| (photo[i] - scale * camera[i]).abs() <= 1.0);
    let aspect = (photo[0] * camera[1]) / (photo[1] * camera[0]);
    (aspect - 1.0).abs() <= ASPECT_WITHIN || off_by_one(photo[0].max(photo[1]) / camera[0].max(camera[1]))
}

/// The difference of the proportions: 0 if they are equal.
fn off(photo: (u32, u32), camera: (u32, u32)) -> u64 {
    // Each product has at most 64 bits.
    let product = |a: u32, b: u32| u64::from(a) * u64::from(b);
    product(photo.0, camera.1).abs_diff(product(photo.1, camera.0))
}

fn sides((width, height): (u32, u32)) -> [f64; 2] {
    [f64::from(width.max(1)), f64::from(height.max(1))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(stored: (u32, u32), orientation: u8, camera: (u32, u32), expected: Option<Turn>) {
        let orientation = Orientation::from_exif(orientation).unwrap();
        assert_eq!(turn(stored, orientation, camera, "a.jpg".as_ref()).ok(), expected);
    }

    #[test]
    fn the_camera_decides_how_a_photo_is_turned() {
        for sideways in 5..=8 {
            check((96, 72), sideways, (96, 72), Some(Turn::Stored));
            check((96, 72), sideways, (72, 96), Some(Turn::Upright));
            // Other scales of both.
            check((48, 36), sideways, (96, 72), Some(Turn::Stored));
            check((192, 144), sideways, (72, 96), Some(Turn::Upright));
            check((72, 72), sideways, (72, 72), Some(Turn::Stored));
            check((72, 72), sideways, (96, 72), None);
        }
        for upright in 1..=4 {
            check((96, 72), upright, (96, 72), Some(Turn::Stored));
            check((96, 72), upright, (72, 96), None);
        }
        // Nearly square: both fit within the tolerance, and one exactly.
        check((1000, 1004), 6, (1004, 1000), Some(Turn::Upright));
        check((1000, 1004), 6, (1000, 1004), Some(Turn::Stored));
        check((500, 502), 6, (1004, 1000), Some(Turn::Upright));
    }

    #[test]
    fn scaled_photos_are_rounded_to_whole_pixels() {
        // 4946 x 3286, as COLMAP's cameras of Mip-NeRF 360, by 2, 4 and 8, rounded down, up and to the nearest.
        for photo in [(2473, 1643), (1236, 821), (1237, 822), (618, 410), (619, 411), (618, 411)] {
            check(photo, 1, (4946, 3286), Some(Turn::Stored));
        }
        // A hundredth: 9.6 x 7.2.
        check((9, 7), 1, (960, 720), Some(Turn::Stored));
        check((10, 8), 1, (960, 720), Some(Turn::Stored));
        // A row of sixteen is cropped away; a picture of 16:9 instead of 4:3.
        check((960, 675), 1, (960, 720), None);
        check((960, 540), 1, (960, 720), None);
    }
}
