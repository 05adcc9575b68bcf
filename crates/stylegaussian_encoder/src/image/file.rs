//! Image files: their formats, bounds and decoders.

use std::{
    borrow::Cow,
    fs::File,
    io::{self, BufRead, BufReader, Cursor, Read, Seek},
    path::Path,
};

use ::image::{
    DynamicImage, ImageDecoder, ImageError as DecodeError, ImageFormat, ImageReader, Limits, guess_format,
    metadata::Orientation,
};

use super::{
    Image, ImageError, MAX_DECODER_BYTES, MAX_FILE_BYTES, MAX_PIXELS, MAX_SIDE, Warned,
    ending::{Ending, ending},
    photo::{Turn, turn},
};
use crate::guard::{guarded, one_line};

/// A format that is read.
struct Format {
    name: &'static str,
    format: ImageFormat,
    /// In lower case.
    extensions: &'static [&'static str],
}

const fn format(name: &'static str, format: ImageFormat, extensions: &'static [&'static str]) -> Format {
    Format { name, format, extensions }
}

/// The formats that are read. All but the first two are cargo features.
const READ: &[Format] = &[
    format("PNG", ImageFormat::Png, &["png"]),
    format("JPEG", ImageFormat::Jpeg, &["jpg", "jpeg"]),
    #[cfg(feature = "webp")]
    format("WebP", ImageFormat::WebP, &["webp"]),
    #[cfg(feature = "bmp")]
    format("BMP", ImageFormat::Bmp, &["bmp"]),
    #[cfg(feature = "gif")]
    format("GIF", ImageFormat::Gif, &["gif"]),
    #[cfg(feature = "tiff")]
    format("TIFF", ImageFormat::Tiff, &["tif", "tiff"]),
];

const AVIF: &str = "an AVIF image";
const HEIC: &str = "a HEIC image";
const HEIF: &str = "a HEIF image";

/// The first bytes of images that are not read, from a given byte on.
const NOT_READ: &[(usize, &[u8], &str)] = &[
    (4, b"ftypavif", AVIF),
    (4, b"ftypavis", AVIF),
    (4, b"ftyphei", HEIC),
    (4, b"ftyphev", HEIC),
    (4, b"ftypmif1", HEIF),
    (4, b"ftypmsf1", HEIF),
    (0, b"\xFF\x0A", "a JPEG XL image"),
    (0, b"\0\0\0\x0CJXL ", "a JPEG XL image"),
    (0, b"\0\0\0\x0CjP  ", "a JPEG 2000 image"),
    (0, b"\xFF\x4F\xFF\x51", "a JPEG 2000 image"),
    (0, b"8BPS", "a Photoshop document"),
    (0, b"\x76\x2F\x31\x01", "an OpenEXR image"),
    (0, b"<svg", "an SVG drawing"),
];

/// Bytes in which [`NOT_READ`] and the format are looked for. The brands of a HEIF file are among them.
const HEAD: usize = 64;

/// The formats that are read, for people: `PNG, JPEG or TIFF`.
pub fn format_names() -> String {
    let names: Vec<&str> = READ.iter().map(|format| format.name).collect();
    match names.split_last() {
        Some((last, first)) => format!("{} or {last}", first.join(", ")),
        None => String::new(),
    }
}

/// The extensions of files in the formats that are read, in lower case.
pub fn extensions() -> impl Iterator<Item = &'static str> {
    READ.iter().flat_map(|format| format.extensions).copied()
}

/// The file's contents. A device or a huge file ends in an error and not in memory.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, ImageError> {
    let read = |source| ImageError::Read { path: path.into(), source };
    let mut bytes = Vec::new();
    File::open(path).map_err(read)?.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(read)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(ImageError::TooManyBytes { path: path.into() });
    }
    Ok(bytes)
}

/// The image in `bytes`, turned upright.
pub(super) fn upright(bytes: &[u8], path: &Path) -> Result<Warned, ImageError> {
    safe(path, || decoded(bytes, path, |_, _| Ok(Turn::Upright)))
}

/// The photo in `bytes`, as its camera of `size` sees it.
pub(super) fn photo(bytes: &[u8], path: &Path, size: (u32, u32)) -> Result<Warned, ImageError> {
    safe(path, || decoded(bytes, path, |stored, orientation| turn(stored, orientation, size, path)))
}

/// Width and height of the file's image, as it is stored.
pub(super) fn size(path: &Path) -> Result<(u32, u32), ImageError> {
    safe(path, || Ok(decoder(open(path)?, path)?.dimensions()))
}

/// Runs `read`. A decoder's panic over the file is an error.
fn safe<T>(path: &Path, read: impl FnOnce() -> Result<T, ImageError>) -> Result<T, ImageError> {
    guarded(read).map_err(|panic| ImageError::Malformed { path: path.into(), panic })?
}

fn open(path: &Path) -> Result<BufReader<File>, ImageError> {
    let file = File::open(path).map_err(|source| ImageError::Read { path: path.into(), source })?;
    Ok(BufReader::new(file))
}

/// The decoder of an image whose size is within the bounds.
fn decoder<'a>(
    mut file: impl BufRead + Seek + 'a,
    path: &Path,
) -> Result<Box<dyn ImageDecoder + 'a>, ImageError> {
    let read = |source: io::Error| ImageError::Read { path: path.into(), source };
    let mut head = Vec::new();
    file.by_ref().take(HEAD as u64).read_to_end(&mut head).map_err(read)?;
    file.rewind().map_err(read)?;
    let starts = |(at, mark, _): &&(usize, &[u8], &str)| head.get(*at..).is_some_and(|h| h.starts_with(mark));
    if let Some(&(_, _, found)) = NOT_READ.iter().find(starts) {
        // The first brand of HEIF files says little: others follow.
        let has = |brand: &[u8; 4]| found == HEIF && head.windows(4).any(|window| window == brand);
        let found = if has(b"avif") {
            AVIF
        } else if has(b"heic") || has(b"heix") {
            HEIC
        } else {
            found
        };
        return Err(ImageError::OtherFormat { path: path.into(), found });
    }
    let mut reader = ImageReader::new(file).with_guessed_format().map_err(read)?;
    let known = reader.format().and_then(|format| READ.iter().find(|known| known.format == format));
    let Some(known) = known else {
        let found = match reader.format() {
            Some(format) => name_of(format),
            None if head.is_empty() => "an empty file",
            None => "a file of another kind",
        };
        return Err(ImageError::OtherFormat { path: path.into(), found });
    };
    let mut limits = Limits::default();
    // Limits the decoder's own allocations. The size of the pixels is checked below.
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|source| undecodable(source, known.name, path))?;
    let (width, height) = decoder.dimensions();
    let n_pixels = u64::from(width) * u64::from(height);
    if width.max(height) > MAX_SIDE || n_pixels > MAX_PIXELS || decoder.total_bytes() > MAX_DECODER_BYTES {
        return Err(ImageError::TooLarge { path: path.into(), width, height });
    }
    Ok(Box::new(decoder))
}

/// A format that is known and not read.
fn name_of(format: ImageFormat) -> &'static str {
    match format {
        ImageFormat::WebP => "a WebP image",
        ImageFormat::Bmp => "a BMP image",
        ImageFormat::Gif => "a GIF image",
        ImageFormat::Tiff => "a TIFF image",
        ImageFormat::Avif => AVIF,
        ImageFormat::Hdr => "a Radiance HDR image",
        ImageFormat::OpenExr => "an OpenEXR image",
        ImageFormat::Dds => "a DDS texture",
        ImageFormat::Qoi => "a QOI image",
        ImageFormat::Ico => "an icon",
        ImageFormat::Pnm => "a PNM image",
        _ => "an image of another format",
    }
}

/// The error for a file in the format of this name, which may have been cut off.
fn undecodable(source: DecodeError, format: &'static str, path: &Path) -> ImageError {
    match source {
        DecodeError::IoError(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
            ImageError::Truncated { path: path.into(), format }
        }
        source => ImageError::Decode { path: path.into(), reason: one_line(source) },
    }
}

fn orientation(decoder: &mut impl ImageDecoder, path: &Path) -> Result<Orientation, ImageError> {
    // Asked of the decoder, since the decoded image no longer knows it.
    decoder.orientation().map_err(|source| ImageError::Decode { path: path.into(), reason: one_line(source) })
}

/// Decodes a file. `turn` decides from the stored size and the orientation how its pixels are turned.
fn decoded(
    bytes: &[u8],
    path: &Path,
    turn: impl FnOnce((u32, u32), Orientation) -> Result<Turn, ImageError>,
) -> Result<Warned, ImageError> {
    // Checks the bounds before any end is looked for.
    let mut first = decoder(Cursor::new(bytes), path)?;
    let orientation = orientation(&mut first, path)?;
    let turn = turn(first.dimensions(), orientation)?;
    drop(first);
    let plain = |bytes: &[u8]| pixels(bytes, path).ok();
    let (bytes, warning) = match ending(bytes, plain) {
        Ending::Whole => (Cow::Borrowed(bytes), None),
        Ending::Completed(bytes, what) => {
            (bytes, Some(format!("{}: {what}, but all of its rows are there", path.display())))
        }
        Ending::Truncated => return Err(ImageError::Truncated { path: path.into(), format: "JPEG" }),
    };
    let mut image = pixels(&bytes, path)?;
    if turn == Turn::Upright {
        image.apply_orientation(orientation);
    }
    Ok(Warned { image: Image::from(image), warning })
}

fn pixels(bytes: &[u8], path: &Path) -> Result<DynamicImage, ImageError> {
    let decoder = decoder(Cursor::new(bytes), path)?;
    let format = guess_format(bytes).ok().and_then(|format| READ.iter().find(|known| known.format == format));
    let name = format.map_or("image", |format| format.name);
    DynamicImage::from_decoder(decoder).map_err(|source| undecodable(source, name, path))
}
