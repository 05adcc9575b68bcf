//! Images as the encoder takes them: RGB 0..1, the display-referred sRGB values of the file.

mod ending;
mod file;
mod photo;
mod resize;

use std::path::{Path, PathBuf};

pub use ::image::DynamicImage;
use ::image::RgbImage;

use fast_image_resize::{
    FilterType,
    pixels::{F32, F32x3},
};
pub use file::{extensions, format_names};
use stylegaussian::{
    paint::{AreaError, pixels_of},
    work::{Canceled, Work},
};

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

/// An RGB image.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows, from the top.
    pub height: u32,
    /// Row-major, interleaved, 0..1 `[height, width, 3]`. Transparent pixels lie over white.
    pub rgb: Vec<f32>,
    /// Opacity, 0..1 `[height, width]`, or `None` if all of the image is opaque.
    pub alpha: Option<Vec<f32>>,
}

/// An image that was read, and what is wrong with its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Warned {
    /// The image, whole.
    pub image: Image,
    /// A warning for people, which names the file, if it is damaged.
    pub warning: Option<String>,
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
    #[error("{}: not a readable image ({reason}), expected a whole one as {}", path.display(), format_names())]
    Decode {
        /// The file.
        path: PathBuf,
        /// The decoder's error, on one line.
        reason: String,
    },
    /// The decoder panicked over the file.
    #[error("{}: not a readable image: it is malformed ({panic})", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The panic's message.
        panic: String,
    },
    /// The file is an image of a kind that is not read, or no image.
    #[error("{}: found {found}, expected an image as {}", path.display(), format_names())]
    OtherFormat {
        /// The file.
        path: PathBuf,
        /// The kind of the file.
        found: &'static str,
    },
    /// A photo is not the picture of its camera.
    #[error(
        "{}: the photo is {}x{} and its camera's picture {}x{}, expected the same proportions",
        path.display(), photo.0, photo.1, camera.0, camera.1
    )]
    OtherAspect {
        /// The file.
        path: PathBuf,
        /// Its width and height, as they are stored.
        photo: (u32, u32),
        /// Width and height of the camera's picture.
        camera: (u32, u32),
    },
    /// A file without an end, which lacks pixels. Some decoders fill the missing part with gray.
    #[error(
        "{}: the {format} ends before its last row, expected a whole image as {} (truncated?)",
        path.display(), format_names()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The name of its format.
        format: &'static str,
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
    /// Reads an image file in any of the formats of [`format_names`]: any bit depth, gray or color, turned
    /// upright by its EXIF orientation; the first picture of an animation. Transparent pixels are laid over
    /// white, as on paper, and their opacity is kept: no paint is taken from them.
    ///
    /// # Errors
    /// If the file is absent, is no image, lacks pixels, or is larger than [`MAX_SIDE`] or [`MAX_PIXELS`].
    /// The size is checked before any pixel is allocated. A panic of the decoder is an error too.
    pub fn open(path: &Path) -> Result<Self, ImageError> {
        Ok(Self::open_warned(path)?.image)
    }

    /// [`open`](Self::open), with the warning if the file is damaged.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_warned(path: &Path) -> Result<Warned, ImageError> {
        file::upright(&file::bytes(path)?, path)
    }

    /// [`open_warned`](Self::open_warned) for a painting, which must be large enough for any encoder.
    ///
    /// # Errors
    /// As [`open`](Self::open), or if a side is shorter than [`MIN_SIDE`].
    pub fn open_painting_warned(path: &Path) -> Result<Warned, ImageError> {
        let read = Self::open_warned(path)?;
        read.image.expect_painting(path)?;
        Ok(read)
    }

    /// [`open`](Self::open) for a painting, which must be large enough for any encoder.
    ///
    /// # Errors
    /// As [`open_painting_warned`](Self::open_painting_warned).
    pub fn open_painting(path: &Path) -> Result<Self, ImageError> {
        Ok(Self::open_painting_warned(path)?.image)
    }

    /// [`from_bytes`](Self::from_bytes) for a painting, which must be large enough for any encoder.
    ///
    /// # Errors
    /// As [`open_painting`](Self::open_painting).
    pub fn painting_from_bytes(bytes: &[u8], path: &Path) -> Result<Self, ImageError> {
        let image = Self::from_bytes(bytes, path)?;
        image.expect_painting(path)?;
        Ok(image)
    }

    /// Reads an image from the bytes of a file, which errors call `path`.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self, ImageError> {
        Ok(file::upright(bytes, path)?.image)
    }

    /// Reads the photo of a camera whose pictures have `size` (width, height), or the same at another scale.
    ///
    /// The pixels are taken as they are stored, or turned by the EXIF orientation if only that gives the
    /// camera's proportions. The image keeps the photo's own scale.
    ///
    /// # Errors
    /// As [`open`](Self::open), or if the photo has other proportions than its camera, by more than a pixel
    /// and by more than 1 percent.
    pub fn open_photo(path: &Path, size: (u32, u32)) -> Result<Warned, ImageError> {
        file::photo(&file::bytes(path)?, path, size)
    }

    /// Width and height in pixels, from the beginning of an image file. The EXIF orientation is not looked at.
    ///
    /// # Errors
    /// If the file is absent, is no image, or is larger than [`MAX_SIDE`] or [`MAX_PIXELS`].
    pub fn size(path: &Path) -> Result<(u32, u32), ImageError> {
        file::size(path)
    }

    fn expect_painting(&self, path: &Path) -> Result<(), ImageError> {
        let (width, height) = (self.width, self.height);
        match width.min(height) < MIN_SIDE {
            true => Err(ImageError::TooSmall { path: path.into(), width, height }),
            false => Ok(()),
        }
    }

    /// The part of the image in `area`: its left, top, right and bottom edges as shares of the sides, 0..1.
    /// Edges are moved to the nearest pixels, so that an edge between pixels of two images is the same in both.
    ///
    /// # Errors
    /// If the area is outside of the image, or holds no pixel. The message says what was found and expected.
    pub fn cropped(&self, area: [f32; 4]) -> Result<Self, AreaError> {
        let [left, top, right, bottom] = pixels_of(area, [self.width as usize, self.height as usize])?;
        let part = |values: &[f32], n: usize| -> Vec<f32> {
            let row = |y: usize| &values[(y * self.width as usize + left) * n..][..(right - left) * n];
            (top..bottom).flat_map(row).copied().collect()
        };
        Ok(Self {
            width: (right - left) as u32,
            height: (bottom - top) as u32,
            rgb: part(&self.rgb, 3),
            alpha: self.alpha.as_ref().map(|alpha| part(alpha, 1)),
        })
    }

    /// The image at another size. Each pixel averages the area that it covers (Lanczos of 3 lobes, clamped to
    /// 0..1).
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let work = Work::default();
        self.resized_if_wanted(width, height, &work).expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`resized`](Self::resized).
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn resized_if_wanted(&self, width: u32, height: u32, work: &Work) -> Result<Self, Canceled> {
        self.resized_with(width, height, FilterType::Lanczos3, work)
    }

    pub(crate) fn resized_with(
        &self,
        width: u32,
        height: u32,
        filter: FilterType,
        work: &Work,
    ) -> Result<Self, Canceled> {
        work.check()?;
        if (width, height) == (self.width, self.height) {
            return Ok(self.clone());
        }
        let (from, to) = ([self.width, self.height], [width, height]);
        let n_pixels = |[width, height]: [u32; 2]| width as usize * height as usize;
        let has_pixels = |values: &[f32], n: usize| !values.is_empty() && values.len() >= n * n_pixels(from);
        // The fields are public, so the size may not fit the values.
        if n_pixels(from) == 0 || n_pixels(to) == 0 || !has_pixels(&self.rgb, 3) {
            return Ok(Self { width, height, rgb: vec![0.0; 3 * n_pixels(to)], alpha: None });
        }
        // Lanczos has negative lobes and overshoots at edges.
        let clamped = |mut values: Vec<f32>| {
            values.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
            values
        };
        let alpha = self.alpha.as_ref().filter(|alpha| has_pixels(alpha, 1));
        let of_rgb = if alpha.is_some() { 0.75 } else { 1.0 };
        let (before, after) = (work.part(0.0, of_rgb), work.part(of_rgb, 1.0));
        let rgb = clamped(resize::resized::<F32x3>(&self.rgb, from, to, filter, &before)?);
        let alpha = alpha.map(|alpha| resize::resized::<F32>(alpha, from, to, filter, &after)).transpose()?;
        let alpha = alpha.map(clamped);
        Ok(Self { width, height, rgb, alpha })
    }

    /// The part of a decoded image between `edges`, which lie within it: its first column and row, and its last
    /// ones, exclusive, as left, top, right and bottom. Transparent pixels are laid over white.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn of_part(image: &DynamicImage, edges: [usize; 4], work: &Work) -> Result<Self, Canceled> {
        let [left, top, right, bottom] = edges.map(|edge| edge as u32);
        let (width, height) = (right - left, bottom - top);
        let rows = (resize::BAND / (width as usize).max(1)).max(1);
        let mut rgb: Vec<f32> = Vec::with_capacity(3 * width as usize * height as usize);
        let mut alpha: Option<Vec<f32>> = None;
        for first in (0..height).step_by(rows) {
            work.at(first as f32 / height as f32)?;
            let n_rows = (rows as u32).min(height - first);
            let band = Self::from(image.crop_imm(left, top + first, width, n_rows));
            if band.alpha.is_some() || alpha.is_some() {
                // Bands before the first translucent one are opaque.
                let known = alpha.get_or_insert_with(|| vec![1.0; rgb.len() / 3]);
                match band.alpha {
                    Some(of_band) => known.extend(of_band),
                    None => known.resize((rgb.len() + band.rgb.len()) / 3, 1.0),
                }
            }
            rgb.extend(band.rgb);
        }
        Ok(Self { width, height, rgb, alpha })
    }
}

/// Composites alpha over white.
impl From<DynamicImage> for Image {
    fn from(image: DynamicImage) -> Self {
        let (width, height) = (image.width(), image.height());
        // Files of floats can hold anything.
        let clamp = |value: f32| if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
        if !image.color().has_alpha() {
            let mut rgb = image.into_rgb32f().into_raw();
            rgb.iter_mut().for_each(|value| *value = clamp(*value));
            return Self { width, height, rgb, alpha: None };
        }
        let over_white = |rgba: [f32; 4]| {
            let [r, g, b, alpha] = rgba.map(clamp);
            [r, g, b].map(|color| color * alpha + 1.0 - alpha)
        };
        let rgba = image.into_rgba32f();
        let alpha: Vec<f32> = rgba.pixels().map(|pixel| clamp(pixel.0[3])).collect();
        Self {
            width,
            height,
            rgb: rgba.pixels().flat_map(|pixel| over_white(pixel.0)).collect(),
            alpha: alpha.iter().any(|alpha| *alpha < 1.0).then_some(alpha),
        }
    }
}

impl From<&RgbImage> for Image {
    fn from(image: &RgbImage) -> Self {
        let rgb = image.as_raw().iter().map(|&value| f32::from(value) / 255.0).collect();
        Self { width: image.width(), height: image.height(), rgb, alpha: None }
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
