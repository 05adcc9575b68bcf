//! Formats that are cargo features, and formats that are not read.

#![cfg_attr(
    not(any(feature = "bmp", feature = "gif", feature = "tiff", feature = "webp")),
    allow(dead_code, reason = "without these features, no test needs the picture")
)]

use std::{fs, io::Cursor};

use image::{DynamicImage, ImageFormat, Rgb, RgbImage, Rgba, RgbaImage};
use stylegaussian_encoder::{Image, ImageError, image::format_names};

/// A picture of four colors, in fields that are larger than any block of a codec.
fn picture() -> RgbImage {
    RgbImage::from_fn(40, 24, |x, y| match (x < 20, y < 12) {
        (true, true) => Rgb([255, 0, 0]),
        (false, true) => Rgb([0, 255, 0]),
        (true, false) => Rgb([0, 0, 255]),
        (false, false) => Rgb([51, 102, 153]),
    })
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// Checks a format that keeps 8 bits, whole and cut off.
#[track_caller]
fn check(format: ImageFormat, name: &str) {
    let bytes = encoded(&picture().into(), format);
    let found = Image::from_bytes(&bytes, name.as_ref()).unwrap();
    assert_eq!(RgbImage::from(&found), picture());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, &bytes).unwrap();
    assert_eq!(Image::size(&path).unwrap(), (40, 24));
    for end in [bytes.len() / 2, bytes.len() / 4, 30, 14] {
        let error = Image::from_bytes(&bytes[..end], name.as_ref()).unwrap_err().to_string();
        assert!(error.contains(name) && !error.contains('\n'), "{end}: {error}");
    }
}

/// Checks that transparent pixels lie over white.
#[track_caller]
fn check_alpha(format: ImageFormat) {
    let mut pixels = RgbaImage::from_pixel(9, 9, Rgba([0, 255, 0, 255]));
    pixels.put_pixel(0, 0, Rgba([0, 0, 0, 0]));
    let found = Image::from_bytes(&encoded(&pixels.into(), format), "alpha".as_ref()).unwrap();
    assert_eq!(found.rgb[..6], [1.0, 1.0, 1.0, 0.0, 1.0, 0.0]);
}

#[cfg(feature = "webp")]
#[test]
fn webp() {
    check(ImageFormat::WebP, "a.webp");
    check_alpha(ImageFormat::WebP);
}

#[cfg(feature = "bmp")]
#[test]
fn bmp() {
    check(ImageFormat::Bmp, "a.bmp");
}

#[cfg(feature = "gif")]
#[test]
fn gif() {
    check(ImageFormat::Gif, "a.gif");
    check_alpha(ImageFormat::Gif);
}

/// The first picture of an animation.
#[cfg(feature = "gif")]
#[test]
fn gif_with_two_pictures() {
    use image::{Frame, codecs::gif::GifEncoder};
    let mut bytes = Vec::new();
    let frame = |color| Frame::new(RgbaImage::from_pixel(9, 9, color));
    let frames = [frame(Rgba([255, 0, 0, 255])), frame(Rgba([0, 0, 255, 255]))];
    GifEncoder::new(&mut bytes).encode_frames(frames).unwrap();
    let found = Image::from_bytes(&bytes, "two.gif".as_ref()).unwrap();
    assert_eq!(found.rgb[..3], [1.0, 0.0, 0.0]);
}

#[cfg(feature = "tiff")]
#[test]
fn tiff() {
    check(ImageFormat::Tiff, "a.tif");
    check_alpha(ImageFormat::Tiff);
    // Floats beyond what a picture shows.
    let floats = image::Rgb32FImage::from_pixel(8, 8, Rgb([-1.0, 0.5, f32::NAN]));
    let found = Image::from_bytes(&encoded(&floats.into(), ImageFormat::Tiff), "f.tif".as_ref()).unwrap();
    assert_eq!(found.rgb[..3], [0.0, 0.5, 0.0]);
}

#[cfg(all(feature = "webp", feature = "bmp", feature = "gif", feature = "tiff"))]
#[test]
fn formats_are_named() {
    assert_eq!(format_names(), "PNG, JPEG, WebP, BMP, GIF or TIFF");
}

#[track_caller]
fn check_not_read(bytes: &[u8], found: &str) {
    let error = Image::from_bytes(bytes, "photo".as_ref()).unwrap_err();
    assert!(matches!(error, ImageError::OtherFormat { .. }), "{error}");
    let expected = format!("photo: found {found}, expected an image as {}", format_names());
    assert_eq!(error.to_string(), expected);
}

#[test]
fn other_formats_are_named_with_what_is_read() {
    check_not_read(b"\0\0\0\x1cftypavif\0\0\0\0avifmif1miaf", "an AVIF image");
    check_not_read(b"\0\0\0\x1cftypmif1\0\0\0\0mif1avifmiaf", "an AVIF image");
    check_not_read(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic", "a HEIC image");
    check_not_read(b"\0\0\0\x18ftypheix\0\0\0\0mif1heix", "a HEIC image");
    check_not_read(b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic", "a HEIC image");
    check_not_read(b"\xFF\x0A\0\0\0\0\0\0\0\0", "a JPEG XL image");
    check_not_read(b"qoif\0\0\0\x08\0\0\0\x08\x03\0", "a QOI image");
    check_not_read(b"A painting, in words.", "a file of another kind");
    check_not_read(b"", "an empty file");
}

#[cfg(not(feature = "webp"))]
#[test]
fn a_format_without_its_feature_is_not_read() {
    check_not_read(b"RIFF\0\0\0\0WEBPVP8 ", "a WebP image");
}
