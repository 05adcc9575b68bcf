//! Photos with an EXIF orientation, whose cameras may be of the stored pixels or of the turned ones.

use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use stylegaussian_encoder::{Image, ImageError};

/// A JPEG of 32 x 16 pixels, dark on the left, with this EXIF orientation.
fn photo(folder: &Path, orientation: u8) -> PathBuf {
    let path = folder.join(format!("{orientation}.jpg"));
    // Halves of 16 pixels are whole JPEG blocks, so the edge stays sharp.
    RgbImage::from_fn(32, 16, |x, _| Rgb([if x < 16 { 0 } else { 255 }; 3])).save(&path).unwrap();
    let plain = std::fs::read(&path).unwrap();
    // TIFF header, one directory of one entry: tag 0x0112 (orientation), a short, count 1, the value.
    let exif =
        [b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".as_slice(), &[orientation], &[0; 6]];
    let exif = exif.concat();
    // A segment APP1, right after the start of the image. Its length counts its own two bytes.
    let segment = [&[0xFF, 0xE1, 0, exif.len() as u8 + 2], &exif[..]].concat();
    std::fs::write(&path, [&plain[..2], &segment, &plain[2..]].concat()).unwrap();
    path
}

#[test]
fn a_photo_lies_as_its_camera_sees_it() {
    let folder = tempfile::tempdir().unwrap();
    let stored = Image::open(&photo(folder.path(), 1)).unwrap();
    for orientation in 1..=8 {
        let path = photo(folder.path(), orientation);
        // Cameras of the stored pixels, at several scales: COLMAP's and nerfstudio's.
        for size in [(32, 16), (64, 32), (3200, 1600), (3201, 1600)] {
            let found = Image::open_photo(&path, size).unwrap().image;
            assert!(found == stored, "orientation {orientation}, camera {size:?}");
        }
        // Cameras of the turned pixels.
        for size in [(16, 32), (160, 320)] {
            match Image::open_photo(&path, size) {
                Ok(found) => {
                    assert!(orientation >= 5);
                    assert!(found.image == Image::open(&path).unwrap(), "orientation {orientation}");
                }
                Err(error) => assert!(orientation < 5, "orientation {orientation}: {error}"),
            }
        }
    }
    // Dark on the left is dark on top, if the photo is turned clockwise.
    let turned = Image::open_photo(&folder.path().join("6.jpg"), (16, 32)).unwrap().image;
    assert_eq!((turned.width, turned.height), (16, 32));
    assert!(turned.rgb[0] < 0.1 && turned.rgb[31 * 16 * 3] > 0.9);
}

#[test]
fn square_photos_stay_as_they_are_stored() {
    let folder = tempfile::tempdir().unwrap();
    let path = photo(folder.path(), 6);
    // As wide as high, by the camera and by the photo.
    let square = Image::open(&path).unwrap().resized(16, 16);
    let stored = folder.path().join("square.png");
    RgbImage::from(&square).save(&stored).unwrap();
    assert!(Image::open_photo(&stored, (100, 100)).unwrap().image == Image::open(&stored).unwrap());
}

#[test]
fn other_proportions_are_an_error_that_names_both() {
    let folder = tempfile::tempdir().unwrap();
    for orientation in [1, 6] {
        let path = photo(folder.path(), orientation);
        for camera in [(32, 32), (96, 72), (64, 40)] {
            let error = Image::open_photo(&path, camera).unwrap_err();
            assert!(matches!(error, ImageError::OtherAspect { .. }), "{error}");
            let (error, camera) = (error.to_string(), format!("{}x{}", camera.0, camera.1));
            assert!(error.contains(".jpg: the photo is 32x16") && error.contains(&camera), "{error}");
        }
    }
}

/// Four fields of 16 pixels, as printers store them (CMYK), and as the first of two pictures, as cameras of two
/// lenses do (MPO).
#[test]
fn photos_in_inks_and_of_two_pictures_are_read() {
    for (name, bytes) in [
        ("cmyk.jpg", &include_bytes!("data/cmyk.jpg")[..]),
        ("two_pictures.jpg", include_bytes!("data/two_pictures.jpg")),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let found = Image::open_photo(&path, (64, 64)).unwrap();
        assert_eq!((found.image.width, found.image.height, found.warning), (32, 32, None), "{name}");
        for (x, y, expected) in [
            (4, 4, [1.0, 0.0, 0.0]),
            (20, 4, [0.0, 1.0, 0.0]),
            (4, 20, [0.0, 0.0, 1.0]),
            (20, 20, [0.2, 0.4, 0.6]),
        ] {
            for (found, expected) in found.image.rgb[3 * (32 * y + x)..].iter().zip(expected) {
                assert!((found - expected).abs() < 0.02, "{name}: {found} at {x}, {y}");
            }
        }
    }
}
