//! Images as the encoder takes them: RGB 0..1, the display-referred sRGB values of the file.

use std::path::{Path, PathBuf};

use ::image::{
    DynamicImage, ImageBuffer, ImageDecoder, ImageError as DecodeError, ImageReader, Limits, Rgb, RgbImage,
    imageops::{self, FilterType},
};

/// Longest side that is read, in pixels.
pub const MAX_SIDE: u32 = 16_384;
/// Most pixels that are read: 8192 x 8192, 768 MiB as f32 RGB.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Most bytes that decoding may take: 16-bit RGBA of [`MAX_PIXELS`].
const MAX_DECODER_BYTES: u64 = MAX_PIXELS * 8;

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
    /// Reads a PNG or JPEG file: any bit depth, gray or color, turned upright by its EXIF orientation. Transparent
    /// pixels are laid over white, as on paper.
    ///
    /// # Errors
    /// If the file is absent, is no image, or is larger than [`MAX_SIDE`] or [`MAX_PIXELS`]. The size is checked before
    /// any pixel is allocated.
    pub fn open(path: &Path) -> Result<Self, ImageError> {
        let read = |source| ImageError::Read { path: path.into(), source };
        let decode = |source| ImageError::Decode { path: path.into(), source };

        let mut reader = ImageReader::open(path).map_err(read)?.with_guessed_format().map_err(read)?;
        let mut limits = Limits::default();
        // For what the decoder allocates by itself. The size of the pixels is checked below.
        limits.max_alloc = Some(MAX_DECODER_BYTES);
        reader.limits(limits);
        let mut decoder = reader.into_decoder().map_err(decode)?;
        let (width, height) = decoder.dimensions();
        let n_pixels = u64::from(width) * u64::from(height);
        if width.max(height) > MAX_SIDE || n_pixels > MAX_PIXELS || decoder.total_bytes() > MAX_DECODER_BYTES
        {
            return Err(ImageError::TooLarge { path: path.into(), width, height });
        }
        // Asked of the decoder, since the decoded image no longer knows it.
        let orientation = decoder.orientation().map_err(decode)?;
        let mut image = DynamicImage::from_decoder(decoder).map_err(decode)?;
        image.apply_orientation(orientation);
        Ok(Self::from(image))
    }

    /// The image at another size. Each pixel averages the area that it covers (Lanczos of 3 lobes, clamped to 0..1).
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
