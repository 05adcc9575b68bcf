//! Files without an end: read with a warning if every row is there, and refused if one is not.
//!
//! `data` has JPEG files of 50 x 38 pixels of noise over gradients, made with libjpeg: `baseline.jpg` and
//! `progressive.jpg` (4:2:0), `restart.jpg` (4:4:4, a restart marker after each third block), `gray.jpg`.

use std::path::Path;

use image::{Rgb, RgbImage};
use stylegaussian_encoder::{Image, ImageError, image::Warned};

const JPEGS: [(&str, &[u8]); 4] = [
    ("baseline.jpg", include_bytes!("data/baseline.jpg")),
    ("progressive.jpg", include_bytes!("data/progressive.jpg")),
    ("restart.jpg", include_bytes!("data/restart.jpg")),
    ("gray.jpg", include_bytes!("data/gray.jpg")),
];

/// A file of these bytes, read.
fn read(bytes: &[u8], name: &str) -> Result<Warned, ImageError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    Image::open_warned(&path)
}

/// Checks that a damaged file shows what `whole` shows, with one warning.
#[track_caller]
fn check_warned(bytes: &[u8], name: &str, whole: &[u8]) {
    let found = read(bytes, name).unwrap();
    assert!(found.image == read(whole, name).unwrap().image, "{name}: other pixels");
    let warning = found.warning.unwrap();
    assert!(warning.contains(name) && warning.contains("all of its rows are there"), "{warning}");
    assert!(!warning.contains('\n'), "{warning}");
}

#[test]
fn a_jpeg_without_its_end_marker_is_whole() {
    for (name, whole) in JPEGS {
        assert_eq!(read(whole, name).unwrap().warning, None, "{name}");
        // Cameras add data behind the end.
        assert_eq!(read(&[whole, b"more"].concat(), name).unwrap().warning, None, "{name}");
        assert!(whole.ends_with(&[0xFF, 0xD9]));
        for n_missing in [1, 2] {
            check_warned(&whole[..whole.len() - n_missing], name, whole);
        }
    }
}

/// Bytes of the last scan are looked at one by one; those before it by hundreds.
#[test]
fn a_jpeg_that_lost_pixels_is_refused() {
    for (name, whole) in JPEGS {
        let whole_image = read(whole, name).unwrap().image;
        let ends = (whole.len() - 40..whole.len() - 2).chain((30..whole.len() - 40).step_by(97));
        for end in ends {
            match read(&whole[..end], name) {
                Err(error) => {
                    let error = error.to_string();
                    assert!(error.contains(name) && !error.contains('\n'), "{error}");
                }
                // The last bits may be padding, or code what the pixels do not show.
                Ok(found) => {
                    assert!(found.image == whole_image && found.warning.is_some(), "{name} of {end} bytes");
                    assert!(end > whole.len() - 8, "{name} of {end} bytes");
                }
            }
        }
    }
}

#[test]
fn half_a_jpeg_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.jpg");
    RgbImage::from_fn(64, 64, noise).save(&path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    Image::from_bytes(&whole, "whole.jpg".as_ref()).unwrap();
    for end in [whole.len() / 2, whole.len() - 20] {
        let error = Image::from_bytes(&whole[..end], "half.jpg".as_ref()).unwrap_err();
        assert!(matches!(error, ImageError::Truncated { .. }), "{end}: {error}");
    }
    check_warned(&whole[..whole.len() - 2], "half.jpg", &whole);
}

/// Noise, so that the scan is long.
fn noise(x: u32, y: u32) -> Rgb<u8> {
    Rgb([x.wrapping_mul(0x9E37_79B1).wrapping_add(y.wrapping_mul(0x85EB_CA6B)) as u8; 3])
}

/// The scans of a progressive file refine one picture, so that a file without the last ones has every row.
#[test]
fn a_progressive_jpeg_without_its_last_scans_is_refused() {
    let (name, whole) = JPEGS[1];
    let scans: Vec<usize> = (0..whole.len() - 1).filter(|&i| whole[i..i + 2] == [0xFF, 0xDA]).collect();
    assert!(scans.len() > 4, "{scans:?}");
    for &scan in &scans[1..] {
        // Tables stand before a scan: cut them away, which leaves the data of the scan before.
        let tables = (0..scan).rev().take_while(|&i| i > scans[0]).find(|&i| whole[i..i + 2] == [0xFF, 0xC4]);
        for end in [Some(scan), tables].into_iter().flatten() {
            let error = read(&whole[..end], name).unwrap_err();
            assert!(matches!(error, ImageError::Truncated { .. }), "{end}: {error}");
        }
    }
}

fn png() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.png");
    RgbImage::from_fn(40, 30, noise).save(&path).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn a_png_without_its_end_is_whole() {
    let whole = png();
    assert!(whole[whole.len() - 8..].starts_with(b"IEND"));
    assert_eq!(read(&whole, "whole.png").unwrap().warning, None);
    // Parts of the last chunk of 12 bytes, and of the checksum before it.
    for n_missing in 1..=16 {
        check_warned(&whole[..whole.len() - n_missing], "cut.png", &whole);
    }
}

#[test]
fn a_png_that_lost_rows_is_refused() {
    let whole = png();
    for end in [whole.len() - 17, whole.len() - 40, whole.len() / 2, 60, 33, 20] {
        let error = read(&whole[..end], "cut.png").unwrap_err().to_string();
        assert!(error.contains("cut.png") && !error.contains('\n'), "{end}: {error}");
    }
    let error = read(&whole[..whole.len() / 2], "cut.png").unwrap_err();
    assert!(matches!(error, ImageError::Truncated { format: "PNG", .. }), "{error}");
    let told = "cut.png: the PNG ends before its last row, expected a whole image as PNG";
    assert!(error.to_string().contains(told), "{error}");
}

/// Pixels in several chunks, of which the last is missing: what is left looks like a file without its end.
#[test]
fn a_png_that_lost_a_whole_chunk_is_refused() {
    let whole = png();
    let start = whole.windows(4).position(|kind| kind == b"IDAT").unwrap() - 4;
    let length = u32::from_be_bytes(whole[start..start + 4].try_into().unwrap()) as usize;
    let (first, second) = whole[start + 8..start + 8 + length].split_at(length / 2);
    let both = [&whole[..start], &chunk(first), &chunk(second)].concat();
    check_warned(&both, "both.png", &whole);
    let one = [&whole[..start], &chunk(first)].concat();
    assert!(read(&one, "one.png").is_err());
    assert!(read(&[&one[..], &whole[whole.len() - 12..]].concat(), "one.png").is_err());
}

/// A chunk of pixels.
fn chunk(data: &[u8]) -> Vec<u8> {
    let contents = [b"IDAT", data].concat();
    let crc = !contents.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    });
    [&(data.len() as u32).to_be_bytes(), &contents[..], &crc.to_be_bytes()].concat()
}

#[test]
fn a_painting_is_read_with_its_warning() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.jpg");
    let whole = JPEGS[0].1;
    std::fs::write(&path, &whole[..whole.len() - 2]).unwrap();
    let painting = Image::open_painting_warned(&path).unwrap();
    assert!(painting.warning.is_some());
    assert_eq!(Image::open_painting(&path).unwrap(), painting.image);
    assert_eq!(Image::painting_from_bytes(whole, Path::new("whole.jpg")).unwrap(), painting.image);
}
