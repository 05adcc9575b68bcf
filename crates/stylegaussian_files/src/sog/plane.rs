//! Planes: lossless WebP images whose texels are codes.

use std::io::Cursor;

use image_webp::WebPDecoder;

use crate::error::{Mismatch, mismatch};

/// The widest and the highest plane, WebP's own limit.
pub(super) const MAX_SIDE: u32 = 16_383;

/// A plane as it is stored.
pub(super) struct StoredPlane<'a> {
    /// Its file, for messages.
    pub name: String,
    decoder: WebPDecoder<Cursor<&'a [u8]>>,
}

/// A decoded plane.
pub(super) struct Plane {
    /// RGB or RGBA bytes, row by row.
    bytes: Vec<u8>,
    /// 3 or 4.
    n_channels: usize,
}

impl<'a> StoredPlane<'a> {
    /// Reads the header, and nothing more.
    pub fn open(name: String, bytes: &'a [u8]) -> Result<Self, Mismatch> {
        let mut decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(|error| broken(&name, &error))?;
        if decoder.is_lossy() || decoder.is_animated() {
            let kind = if decoder.is_animated() { "an animation" } else { "a lossy image" };
            return Err(mismatch(format_args!("{kind} in `{name}`"), "a lossless WebP image"));
        }
        let (width, height) = decoder.dimensions();
        if width.max(height) > MAX_SIDE {
            let found = format!("`{name}` of {width} x {height} pixels");
            return Err(mismatch(found, format_args!("at most {MAX_SIDE} on a side")));
        }
        Ok(Self { name, decoder })
    }

    /// Width and height, in pixels.
    pub fn size(&self) -> [usize; 2] {
        let (width, height) = self.decoder.dimensions();
        [width as usize, height as usize]
    }

    /// The number of texels.
    pub fn n_texels(&self) -> usize {
        let [width, height] = self.size();
        width * height
    }

    /// Decodes the image. The caller has checked that its size is in proportion.
    pub fn decode(mut self) -> Result<Plane, Mismatch> {
        let n_channels = if self.decoder.has_alpha() { 4 } else { 3 };
        let mut bytes = vec![0; n_channels * self.n_texels()];
        self.decoder.read_image(&mut bytes).map_err(|error| broken(&self.name, &error))?;
        Ok(Plane { bytes, n_channels })
    }
}

fn broken(name: &str, error: &image_webp::DecodingError) -> Mismatch {
    mismatch(format_args!("a damaged image in `{name}` ({error})"), "a lossless WebP image")
}

impl Plane {
    /// A texel's red, green, blue and alpha. A plane without alpha is opaque.
    #[inline]
    pub fn texel(&self, i: usize) -> [u8; 4] {
        match self.n_channels {
            4 => self.bytes.as_chunks::<4>().0[i],
            _ => {
                let [r, g, b] = self.bytes.as_chunks::<3>().0[i];
                [r, g, b, u8::MAX]
            }
        }
    }
}
