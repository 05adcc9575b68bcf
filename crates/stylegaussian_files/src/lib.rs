//! File formats: scenes, decoders, style statistics, looks, masks, pinned places, colors, films.
//!
//! A reader takes the whole file into memory, recognizes the format by the content, and checks every count
//! against the size of the file before it allocates. A writer never leaves a half-written file: see
//! [`write_atomically`].
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use stylegaussian::fold;
//! use stylegaussian_files::{read_decoder, read_scene, read_style, write_scene};
//!
//! let mut scene = read_scene("scene.sgs".as_ref())?.scene;
//! let style = read_style("painting.style.safetensors".as_ref())?;
//! let decoder = read_decoder("a.decoder.safetensors".as_ref())?;
//! let features = scene.features.as_ref().ok_or("the scene was never embedded")?;
//! let map = fold::transfer(features, &[(&style, 1.0)], 0.0)?;
//! let colors = fold::stylize(&scene, &decoder, &map)?;
//! scene.set_colors(&colors);
//! write_scene("styled.ply".as_ref(), &scene)?;
//! # Ok(())
//! # }
//! ```

use std::path::Path;

use stylegaussian::{
    decoder::Decoder,
    look::Look,
    mask::StoredMask,
    paint::{Paint, StoredPins},
    statistics::ChannelStatistics,
};

mod activate;
mod animation;
mod archive;
mod atomic;
mod bytes;
mod check;
mod checkpoint;
mod colors;
mod decoder;
mod distant;
mod error;
mod files;
mod format;
mod formats;
mod gltf;
mod json;
mod ksplat;
mod look;
mod mask;
mod names;
mod pages;
pub mod part;
mod pins;
mod place;
mod ply;
pub mod pytorch;
mod rows;
mod scenes;
mod sgs;
mod slices;
mod sog;
mod splat;
mod spz;
mod style;
pub mod tensors;
pub mod tile;
mod upright;
pub mod world;

pub use animation::WebpAnimation;
pub use atomic::{abandon_partial_files, expect_writable, write_atomically, write_by_name};
use bytes::read_bytes;
pub use colors::write_colors;
pub use decoder::Precision;
pub use error::{FileError, Loaded, Mismatch};
pub use format::{ReadOptions, WriteOptions};
pub use formats::{readable_extensions, writable_extensions};
pub use scenes::{
    Reading, SceneReader, read_scene, read_scene_with, read_world_at, scene_from_bytes, scene_to_bytes,
    write_scene, write_scene_with,
};
pub use slices::Slices;

/// Reads a decoder (`*.decoder.safetensors`).
///
/// # Errors
/// If the file cannot be read, is no decoder, or its layers do not fit one another.
pub fn read_decoder(path: &Path) -> Result<Decoder, FileError> {
    decoder::from_bytes(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads a decoder from the bytes of a `*.decoder.safetensors`. Errors call the file `name`.
///
/// # Errors
/// As [`read_decoder`].
pub fn decoder_from_bytes(bytes: &[u8], name: &str) -> Result<Decoder, FileError> {
    decoder::from_bytes(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

/// Writes a decoder (`*.decoder.safetensors`), its weights in the given precision. Biases are always exact.
///
/// # Errors
/// If the layers do not fit one another, a value is not finite, or the file cannot be written.
pub fn write_decoder(path: &Path, decoder: &Decoder, precision: Precision) -> Result<(), FileError> {
    let tensors = decoder::prepare(decoder, precision).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| tensors.write(out))
}

/// Reads the statistics of a style (`*.style.safetensors`).
///
/// # Errors
/// If the file cannot be read, is no style, or a value is not finite.
pub fn read_style(path: &Path) -> Result<ChannelStatistics, FileError> {
    style::from_bytes(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads the statistics of a style from the bytes of a `*.style.safetensors`. Errors call the file `name`.
///
/// # Errors
/// As [`read_style`].
pub fn style_from_bytes(bytes: &[u8], name: &str) -> Result<ChannelStatistics, FileError> {
    style::from_bytes(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

/// Writes the statistics of a style (`*.style.safetensors`).
///
/// # Errors
/// If shapes do not fit one another, a value is not finite, or the file cannot be written.
pub fn write_style(path: &Path, style: &ChannelStatistics) -> Result<(), FileError> {
    let tensors = style::prepare(style).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| tensors.write(out))
}

/// The bytes that [`write_style`] writes. Errors call the file `name`.
///
/// # Errors
/// If shapes do not fit one another, or a value is not finite.
pub fn style_to_bytes(name: &str, style: &ChannelStatistics) -> Result<Vec<u8>, FileError> {
    let path = Path::new(name);
    let tensors = style::prepare(style).map_err(|mismatch| mismatch.at(path))?;
    let mut bytes = Vec::new();
    tensors.write(&mut bytes).map_err(|source| FileError::Io { path: path.into(), source })?;
    Ok(bytes)
}

/// Reads a look (`*.look.safetensors`).
///
/// # Errors
/// If the file cannot be read, is no look, or a value is not finite.
pub fn read_look(path: &Path) -> Result<Look, FileError> {
    look::from_bytes(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads a look from the bytes of a `*.look.safetensors`. Errors call the file `name`.
///
/// # Errors
/// As [`read_look`].
pub fn look_from_bytes(bytes: &[u8], name: &str) -> Result<Look, FileError> {
    look::from_bytes(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

/// Writes a look (`*.look.safetensors`). Each channel of the colors is rounded to 256 steps between its
/// smallest and its largest value, which takes 3 bytes per Gaussian.
///
/// # Errors
/// If a value is not finite, there is not one color per Gaussian of the scene, or the file cannot be written.
pub fn write_look(path: &Path, look: &Look) -> Result<(), FileError> {
    let tensors = look::prepare(look).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| tensors.write(out))
}

/// Reads a mask (`*.mask.safetensors`).
///
/// # Errors
/// If the file cannot be read, is no mask, or has more than four channels.
pub fn read_mask(path: &Path) -> Result<StoredMask, FileError> {
    mask::from_bytes(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads a mask from the bytes of a `*.mask.safetensors`. Errors call the file `name`.
///
/// # Errors
/// As [`read_mask`].
pub fn mask_from_bytes(bytes: &[u8], name: &str) -> Result<StoredMask, FileError> {
    mask::from_bytes(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

/// Writes a mask (`*.mask.safetensors`): a byte per Gaussian for each channel up to the last one that is named
/// or painted.
///
/// # Errors
/// If there are not as many weights as the scene has Gaussians, or the file cannot be written.
pub fn write_mask(path: &Path, mask: &StoredMask) -> Result<(), FileError> {
    let tensors = mask::prepare(mask).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| tensors.write(out))
}

/// The bytes that [`write_mask`] writes. Errors call the file `name`.
///
/// # Errors
/// If there are not as many weights as the scene has Gaussians.
pub fn mask_to_bytes(name: &str, mask: &StoredMask) -> Result<Vec<u8>, FileError> {
    let path = Path::new(name);
    let tensors = mask::prepare(mask).map_err(|mismatch| mismatch.at(path))?;
    let mut bytes = Vec::new();
    tensors.write(&mut bytes).map_err(|source| FileError::Io { path: path.into(), source })?;
    Ok(bytes)
}

/// Writes a style with the paint of its painting (`*.style.safetensors`). [`read_style`] reads its statistics
/// and [`read_paint`] its paint.
///
/// # Errors
/// As [`write_style`], or if the paint's shapes do not fit one another.
pub fn write_painted_style(path: &Path, style: &ChannelStatistics, paint: &Paint) -> Result<(), FileError> {
    let tensors = style::prepare_painted(style, paint).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| tensors.write(out))
}

/// Reads the paint of a style (`*.style.safetensors`), or `None` if it carries none.
///
/// # Errors
/// If the file cannot be read, is no style, or its paint contradicts itself.
pub fn read_paint(path: &Path) -> Result<Option<Paint>, FileError> {
    style::paint_from_bytes(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads the paint of a style from the bytes of a `*.style.safetensors`. Errors call the file `name`.
///
/// # Errors
/// As [`read_paint`].
pub fn paint_from_bytes(bytes: &[u8], name: &str) -> Result<Option<Paint>, FileError> {
    style::paint_from_bytes(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

/// Reads pinned places (`*.pins.json`).
///
/// # Errors
/// If the file cannot be read, is not of pins, or one of its points is no point or outside of the painting.
pub fn read_pins(path: &Path) -> Result<StoredPins, FileError> {
    pins::from_bytes(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads pinned places from the bytes of a `*.pins.json`. Errors call the file `name`.
///
/// # Errors
/// As [`read_pins`].
pub fn pins_from_bytes(bytes: &[u8], name: &str) -> Result<StoredPins, FileError> {
    pins::from_bytes(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

/// Writes pinned places (`*.pins.json`).
///
/// # Errors
/// If the file cannot be written, or a point is no point or outside of the painting.
pub fn write_pins(path: &Path, pins: &StoredPins) -> Result<(), FileError> {
    let bytes = pins::to_bytes(pins).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| out.write_all(&bytes))
}

#[cfg(test)]
mod tests;
