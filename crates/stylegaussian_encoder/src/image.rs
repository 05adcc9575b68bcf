//! Images as the encoder takes them: RGB 0..1, the display-referred sRGB values of the file.

use std::{
    fs::File,
    io::{self, BufRead, BufReader, Cursor, Read, Seek},
    path::{Path, PathBuf},
};

use ::image::{
    DynamicImage, ImageBuffer, ImageDecoder, ImageError as DecodeError, ImageReader, Limits, Rgb, RgbImage,
    imageops::{self, FilterType},
};

use crate::guard::guarded;

/// Least width and height of an image for any encoder, in pixels. VGG with reflection padding needs 5; with 8
/// there are 2x2 positions, so that a standard deviation exists.
pub const MIN_SIDE: u32 = 8;

/// Width and height of the image on which a network is tried when it is opened.
pub(crate) const PROBE_SIDE: usize = 64;

/// Longest side that is read, in pixels.
pub const MAX_SIDE: u32 = 16_384;
/// Most pixels that are read: 8192 x 8192, 768 MiB as f32 RGB.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Most bytes that decoding may take: 16-bit RGBA of [`MAX_PIXELS`].
const MAX_DECODER_BYTES: u64 = MAX_PIXELS * 8;
/// Most bytes of a file: 16-bit RGBA of [`MAX_PIXELS`] that does not compress, and as much again for its
/// metadata.
const MAX_FILE_BYTES: u64 = 2 * MAX_DECODER_BYTES;
/// The first bytes of a JPEG file: the start marker, and the first byte of another.
const JPEG: [u8; 3] = [0xFF, 0xD8, 0xFF];

/// An RGB image.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows, from the top.
    pub height: u32,
    /// Row-major, interleaved, 0..1 `[height, width, 3]`.
    pub rgb: Vec<f32>,
}

/// An image file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file could not be opened.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is not an image that can be decoded.
    #[error("{}: not a readable image: {source}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// The decoder's error.
        source: DecodeError,
    },
    /// The decoder panicked over the file.
    #[error("{}: not a readable image: it is malformed ({panic})", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The panic's message.
        panic: String,
    },
    /// A JPEG file without an end. Decoders fill the missing part with gray.
    #[error("{}: the JPEG ends before its last row, expected a whole image (truncated?)", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
    },
    /// The file is larger than any image that is read.
    #[error("{}: expected an image of at most {MAX_FILE_BYTES} bytes, the file has more", path.display())]
    TooManyBytes {
        /// The file.
        path: PathBuf,
    },
    /// The painting is too small for an encoder to see a stroke.
    #[error(
        "{}: the image is {width}x{height}, expected at least {MIN_SIDE}x{MIN_SIDE} pixels",
        path.display()
    )]
    TooSmall {
        /// The file.
        path: PathBuf,
        /// Its columns.
        width: u32,
        /// Its rows.
        height: u32,
    },
    /// The image is larger than [`MAX_SIDE`] or [`MAX_PIXELS`].
    #[error(
        "{}: the image is {width}x{height}, expected at most {MAX_SIDE} on a side and {MAX_PIXELS} pixels",
        path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its columns.
        width: u32,
        /// Its rows.
        height: u32,
    },
}

impl Image {
    /// Reads a PNG or JPEG file: any bit depth, gray or color, turned upright by its EXIF orientation.
    /// Transparent pixels are laid over white, as on paper.
    ///
    /// # Errors
    /// If the file is absent, is no image, ends too early, or is larger than [`MAX_SIDE`] or [`MAX_PIXELS`].
    /// The size is checked before any pixel is allocated. A panic of the decoder is an error too.
    pub fn open(path: &Path) -> Result<Self, ImageError> {
        Self::from_bytes(&file_bytes(path)?, path)
    }

    /// [`open`](Self::open) for a painting, which must be large enough for any encoder.
    ///
    /// # Errors
    /// As [`open`](Self::open), or if a side is shorter than [`MIN_SIDE`].
    pub fn open_painting(path: &Path) -> Result<Self, ImageError> {
        Self::painting_from_bytes(&file_bytes(path)?, path)
    }

    /// [`from_bytes`](Self::from_bytes) for a painting, which must be large enough for any encoder.
    ///
    /// # Errors
    /// As [`open_painting`](Self::open_painting).
    pub fn painting_from_bytes(bytes: &[u8], path: &Path) -> Result<Self, ImageError> {
        let image = Self::from_bytes(bytes, path)?;
        let (width, height) = (image.width, image.height);
        if width.min(height) < MIN_SIDE {
            return Err(ImageError::TooSmall { path: path.into(), width, height });
        }
        Ok(image)
    }

    /// Reads an image from the bytes of a PNG or JPEG file, which errors call `path`.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self, ImageError> {
        guarded(|| decoded(bytes, path))
            .map_err(|panic| ImageError::Malformed { path: path.into(), panic })?
    }

    /// Width and height in pixels, from the beginning of a PNG or JPEG file. The EXIF orientation is not looked
    /// at.
    ///
    /// # Errors
    /// If the file is absent, is no image, or is larger than [`MAX_SIDE`] or [`MAX_PIXELS`].
    pub fn size(path: &Path) -> Result<(u32, u32), ImageError> {
        let file = File::open(path).map_err(|source| ImageError::Read { path: path.into(), source })?;
        let size = || Ok(decoder(BufReader::new(file), path)?.dimensions());
        guarded(size).map_err(|panic| ImageError::Malformed { path: path.into(), panic })?
    }

    /// The image at another size. Each pixel averages the area that it covers (Lanczos of 3 lobes, clamped to
    /// 0..1).
    pub fn resized(&self, width: u32, height: u32) -> Self {
        self.resized_with(width, height, FilterType::Lanczos3)
    }

    pub(crate) fn resized_with(&self, width: u32, height: u32, filter: FilterType) -> Self {
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let view = ImageBuffer::<Rgb<f32>, &[f32]>::from_raw(self.width, self.height, &self.rgb[..]);
        let Some(view) = view.filter(|view| view.width() > 0 && view.height() > 0) else {
            return Self { width, height, rgb: vec![0.0; width as usize * height as usize * 3] };
        };
        let mut rgb = imageops::resize(&view, width, height, filter).into_raw();
        // Lanczos has negative lobes and overshoots at edges.
        rgb.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        Self { width, height, rgb }
    }
}

/// The file's contents. A device or a huge file ends in an error and not in memory.
fn file_bytes(path: &Path) -> Result<Vec<u8>, ImageError> {
    let read = |source| ImageError::Read { path: path.into(), source };
    let mut bytes = Vec::new();
    File::open(path).map_err(read)?.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(read)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(ImageError::TooManyBytes { path: path.into() });
    }
    Ok(bytes)
}

/// The decoder of an image whose size is within the bounds.
fn decoder<'a>(
    file: impl BufRead + Seek + 'a,
    path: &Path,
) -> Result<Box<dyn ImageDecoder + 'a>, ImageError> {
    let decode = |source| ImageError::Decode { path: path.into(), source };
    let read = |source: io::Error| ImageError::Read { path: path.into(), source };
    let mut reader = ImageReader::new(file).with_guessed_format().map_err(read)?;
    let mut limits = Limits::default();
    // Limits the decoder's own allocations. The size of the pixels is checked below.
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(decode)?;
    let (width, height) = decoder.dimensions();
    let n_pixels = u64::from(width) * u64::from(height);
    if width.max(height) > MAX_SIDE || n_pixels > MAX_PIXELS || decoder.total_bytes() > MAX_DECODER_BYTES {
        return Err(ImageError::TooLarge { path: path.into(), width, height });
    }
    Ok(Box::new(decoder))
}

fn decoded(bytes: &[u8], path: &Path) -> Result<Image, ImageError> {
    let decode = |source| ImageError::Decode { path: path.into(), source };
    let mut decoder = decoder(Cursor::new(bytes), path)?;
    if bytes.starts_with(&JPEG) && !is_whole_jpeg(bytes) {
        return Err(ImageError::Truncated { path: path.into() });
    }
    // Asked of the decoder, since the decoded image no longer knows it.
    let orientation = decoder.orientation().map_err(decode)?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(decode)?;
    image.apply_orientation(orientation);
    Ok(Image::from(image))
}

/// Whether a JPEG file reaches its end marker (ITU T.81, B.1.1). Segments are skipped by their lengths, since
/// thumbnails in them have ends of their own.
fn is_whole_jpeg(bytes: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xDA;
    const END: u8 = 0xD9;
    // Behind the start marker.
    let mut rest = bytes.get(2..).unwrap_or_default();
    let mut in_scan = false;
    while let Some(at) = rest.iter().position(|&byte| byte == 0xFF) {
        let Some(&marker) = rest.get(at + 1) else { return false };
        rest = match marker {
            END => return true,
            // Fill bytes: the next one may begin the marker.
            0xFF => &rest[at + 1..],
            // A stuffed byte, a restart or a marker without a length.
            0x00 | 0x01 | 0xD0..=0xD8 => &rest[at + 2..],
            // Garbage between markers is skipped, as decoders do, but data of a scan is not a segment.
            _ => {
                let Some(length) = rest.get(at + 2..at + 4) else { return false };
                let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
                in_scan |= marker == START_OF_SCAN;
                let Some(rest) = rest.get(at + 2 + length..) else { return false };
                rest
            }
        };
    }
    // A file without a scan is for the decoder to refuse.
    !in_scan
}

/// Composites alpha over white.
impl From<DynamicImage> for Image {
    fn from(image: DynamicImage) -> Self {
        let (width, height) = (image.width(), image.height());
        if !image.color().has_alpha() {
            return Self { width, height, rgb: image.into_rgb32f().into_raw() };
        }
        let over_white = |[r, g, b, alpha]: [f32; 4]| [r, g, b].map(|color| color * alpha + 1.0 - alpha);
        let rgba = image.into_rgba32f();
        Self { width, height, rgb: rgba.pixels().flat_map(|pixel| over_white(pixel.0)).collect() }
    }
}

impl From<&RgbImage> for Image {
    fn from(image: &RgbImage) -> Self {
        let rgb = image.as_raw().iter().map(|&value| f32::from(value) / 255.0).collect();
        Self { width: image.width(), height: image.height(), rgb }
    }
}

/// Rounds to 8 bits. If `rgb` is too short, the missing pixels are black.
impl From<&Image> for RgbImage {
    fn from(image: &Image) -> Self {
        let mut out = Self::new(image.width, image.height);
        for (out, value) in out.iter_mut().zip(&image.rgb) {
            *out = (value * 255.0).round().clamp(0.0, 255.0) as u8;
        }
        out
    }
}
