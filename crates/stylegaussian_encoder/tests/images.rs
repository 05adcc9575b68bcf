//! Reading images of every kind, and refusing what is no image or too large.

use std::{fs, path::Path};

use image::{GrayImage, ImageBuffer, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use stylegaussian_encoder::{Image, ImageError};

fn open(name: &str, write: impl FnOnce(&Path)) -> Result<Image, ImageError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write(&path);
    Image::open(&path)
}

#[test]
fn gray_becomes_color() {
    let image = open("gray.png", |path| GrayImage::from_pixel(2, 1, Luma([51])).save(path).unwrap()).unwrap();
    assert_eq!((image.width, image.height, image.rgb.len()), (2, 1, 6));
    // 51 / 255 = 0.2.
    assert!(image.rgb.iter().all(|value| (value - 0.2).abs() < 1e-6), "{:?}", image.rgb);
}

#[test]
fn sixteen_bits_keep_their_precision() {
    // 257 x 51 is 51 of 8 bits, and the 100 beyond it would be lost in 8 bits.
    let pixels = ImageBuffer::from_pixel(1, 1, Rgb([257_u16 * 51 + 100, 0, 65535]));
    let image = open("deep.png", |path| pixels.save(path).unwrap()).unwrap();
    assert_eq!(image.rgb, [(257.0 * 51.0 + 100.0) / 65535.0, 0.0, 1.0]);
}

#[test]
fn alpha_lies_over_white() {
    let mut pixels = RgbaImage::from_pixel(2, 1, Rgba([0, 255, 0, 0]));
    pixels.put_pixel(1, 0, Rgba([0, 255, 0, 51]));
    let image = open("alpha.png", |path| pixels.save(path).unwrap()).unwrap();
    // Fully transparent green is white. At an alpha of 0.2, 0.8 of the white remains.
    let expected = [1.0, 1.0, 1.0, 0.8, 1.0, 0.8];
    assert!(image.rgb.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{:?}", image.rgb);
}

/// A JPEG whose EXIF orientation is 6: the camera was turned, the picture has to be turned clockwise.
fn turned_jpeg(path: &Path) {
    // Halves of 16 pixels are whole JPEG blocks, so the edge stays sharp.
    let left_dark = RgbImage::from_fn(32, 16, |x, _| Rgb([if x < 16 { 0 } else { 255 }; 3]));
    left_dark.save(path).unwrap();
    let plain = fs::read(path).unwrap();
    // TIFF header, one directory of one entry: tag 0x0112 (orientation), a short, count 1, value 6.
    let exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let mut turned = plain[..2].to_vec();
    // A segment APP1, right after the start of the image. Its length counts its own two bytes.
    turned.extend([0xFF, 0xE1, 0, exif.len() as u8 + 2]);
    turned.extend(exif);
    turned.extend(&plain[2..]);
    fs::write(path, turned).unwrap();
}

#[test]
fn exif_orientation_is_applied() {
    let image = open("turned.jpg", turned_jpeg).unwrap();
    assert_eq!((image.width, image.height), (16, 32));
    assert!(image.rgb[0] < 0.1, "what was left is now on top");
    assert!(image.rgb[31 * 16 * 3] > 0.9);
}

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// A chunk of a PNG file.
fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let contents = [kind, data].concat();
    let crc = !contents.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    });
    [&(data.len() as u32).to_be_bytes(), &contents[..], &crc.to_be_bytes()].concat()
}

/// The header chunk of a PNG file of 8 bits without interlacing.
fn header(width: u32, height: u32, color: u8) -> Vec<u8> {
    chunk(b"IHDR", &[&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, color, 0, 0, 0]].concat())
}

/// A PNG's signature and header, and the start of the pixel data, which the decoder looks for before it tells
/// the size.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    [PNG, &header(width, height, 6), b"\0\0\0\x02IDAT\x78\x9c"].concat()
}

/// The decoder panics over a palette whose length is no multiple of 3.
#[test]
fn a_malformed_palette_is_an_error() {
    // One pixel of index 0: a row of filter 0, as a stored block of zlib (RFC 1950, 1951) with its checksum.
    let pixel = [0x78, 0x01, 1, 2, 0, 0xFD, 0xFF, 0, 0, 0, 2, 0, 1];
    let palette = |n: usize| {
        let parts =
            [header(1, 1, 3), chunk(b"PLTE", &vec![9; n]), chunk(b"IDAT", &pixel), chunk(b"IEND", &[])];
        [PNG, &parts.concat()].concat()
    };
    let good = open("good.png", |path| fs::write(path, palette(3)).unwrap()).unwrap();
    assert_eq!(good.rgb, [9.0 / 255.0; 3]);
    for n in [1, 2, 4, 5, 7] {
        let error = open("palette.png", |path| fs::write(path, palette(n)).unwrap()).unwrap_err().to_string();
        assert!(error.contains("palette.png: not a readable image"), "{error}");
        assert!(!error.contains('\n'), "{error}");
    }
}

#[test]
fn a_painting_has_room_for_a_stroke() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one.png");
    RgbImage::new(1, 9).save(&path).unwrap();
    assert_eq!(Image::size(&path).unwrap(), (1, 9));
    Image::open(&path).unwrap();
    let error = Image::open_painting(&path).unwrap_err().to_string();
    assert!(error.ends_with("one.png: the image is 1x9, expected at least 8x8 pixels"), "{error}");
}

#[test]
fn lying_sizes_are_refused() {
    for (width, height) in [(0x7FFF_FFFF, 0x7FFF_FFFF), (1_000_000, 1_000_000), (40_000, 2), (12_000, 12_000)]
    {
        let error = open("huge.png", |path| fs::write(path, png_header(width, height)).unwrap()).unwrap_err();
        assert!(error.to_string().contains("huge.png"), "{error}");
    }
    let error = open("huge.png", |path| fs::write(path, png_header(12_000, 12_000)).unwrap()).unwrap_err();
    assert!(matches!(error, ImageError::TooLarge { width: 12_000, height: 12_000, .. }), "{error}");
    // Small enough to be read, but the pixels are not there.
    assert!(open("short.png", |path| fs::write(path, png_header(4_000, 4_000)).unwrap()).is_err());
}

#[test]
fn no_image_is_an_error() {
    let error = open("text.png", |path| fs::write(path, "hello").unwrap()).unwrap_err();
    assert!(error.to_string().contains("text.png"), "{error}");
    assert!(matches!(open("nothing.png", |_| ()), Err(ImageError::Read { .. })));
}

#[test]
fn resizing_averages_and_stays_in_range() {
    // A fine checkerboard becomes gray where it is shrunk, rather than black or white.
    let board = RgbImage::from_fn(64, 64, |x, y| Rgb([if (x + y) % 2 == 0 { 255 } else { 0 }; 3]));
    let small = Image::from(&board).resized(8, 4);
    assert_eq!((small.width, small.height, small.rgb.len()), (8, 4, 96));
    assert!(small.rgb.iter().all(|value| (value - 0.5).abs() < 0.05), "{:?}", small.rgb);
    // Lanczos overshoots at an edge; the result must not.
    let edge = Image::from(&RgbImage::from_fn(8, 8, |x, _| Rgb([if x < 4 { 0 } else { 255 }; 3])));
    assert!(edge.resized(64, 64).rgb.iter().all(|value| (0.0..=1.0).contains(value)));
}

#[test]
fn eight_bits_survive_the_round_trip() {
    let image = RgbImage::from_fn(16, 16, |x, y| Rgb([(y * 16 + x) as u8, 7, 200]));
    assert_eq!(RgbImage::from(&Image::from(&image)), image);
}
