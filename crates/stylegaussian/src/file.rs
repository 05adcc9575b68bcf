//! File formats: scenes, decoders, style statistics, looks, colors.
//!
//! A reader takes the whole file into memory, recognizes the format by the content, and checks every count against the
//! size of the file before it allocates. A writer never leaves a half-written file: see [`write_atomically`].

use std::path::Path;

use crate::{decoder::Decoder, look::Look, paint::Paint, scene::Scene, statistics::ChannelStatistics};

mod activate;
mod atomic;
mod bytes;
mod check;
mod checkpoint;
mod colors;
mod decoder;
mod error;
mod look;
mod ply;
pub mod pytorch;
mod sgs;
mod style;
mod tensors;

pub use atomic::{abandon_partial_files, expect_writable, write_atomically};
use bytes::read_bytes;
use check::check_scene;
pub use colors::write_colors;
pub use decoder::Precision;
pub use error::{FileError, Loaded};
use error::{Mismatch, mismatch};

/// A kind of scene file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Ply,
    Safetensors,
    Checkpoint,
}

/// The kind of file that begins with these bytes. Formats that people try and that are not read are named in the error.
fn kind_of(bytes: &[u8]) -> Result<Kind, Mismatch> {
    const EXPECTED: &str = "a 3DGS .ply, a .sgs scene or a zip-format StyleGaussian checkpoint";
    match bytes {
        [] => Err(mismatch("an empty file", EXPECTED)),
        [b'p', b'l', b'y', b'\n' | b'\r' | b' ' | b'\t', ..] => Ok(Kind::Ply),
        // A zip archive, the container of `torch.save`.
        [b'P', b'K', 3, 4, ..] => Ok(Kind::Checkpoint),
        // Safetensors begin with the length of their JSON header, 8 bytes.
        [_, _, _, _, _, _, _, _, b'{', ..] => Ok(Kind::Safetensors),
        [b'N', b'G', b'S', b'P', ..] => Err(mismatch("an SPZ file", EXPECTED)),
        [0x1f, 0x8b, ..] => Err(mismatch("a gzip stream (SPZ?)", EXPECTED)),
        [b'g', b'l', b'T', b'F', ..] => Err(mismatch("a binary glTF file", EXPECTED)),
        [0x80, 2, ..] => Err(mismatch("a bare pickle stream (torch.save before version 1.6)", EXPECTED)),
        _ => {
            let start = bytes[..bytes.len().min(8)].escape_ascii();
            Err(mismatch(format_args!("a file that starts with `{start}`"), EXPECTED))
        }
    }
}

/// Reads a scene: a 3DGS `.ply` in any dialect, a `.sgs`, or one of StyleGaussian's own checkpoints. The format is
/// recognized by the content, not by the name.
///
/// Gaussians that are not finite or have a zero quaternion are dropped, and a warning counts them.
///
/// # Errors
/// If the file cannot be read, is none of these, contradicts itself, or holds no Gaussian.
pub fn read_scene(path: &Path) -> Result<Loaded, FileError> {
    parse_scene(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads a scene from the bytes of any file that [`read_scene`] takes. Errors call the file `name`.
///
/// # Errors
/// As [`read_scene`].
pub fn scene_from_bytes(bytes: &[u8], name: &str) -> Result<Loaded, FileError> {
    parse_scene(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

fn parse_scene(bytes: &[u8]) -> Result<Loaded, Mismatch> {
    let loaded = match kind_of(bytes)? {
        Kind::Ply => ply::read(bytes),
        Kind::Safetensors => sgs::read(bytes),
        Kind::Checkpoint => checkpoint::read(bytes),
    }?;
    if loaded.scene.is_empty() {
        return Err(match loaded.scene.n_source {
            0 => mismatch("no Gaussian", "at least one"),
            n => mismatch(format_args!("no usable Gaussian among {n}"), "at least one that is finite"),
        });
    }
    Ok(loaded)
}

/// Writes a scene. The extension chooses the format: `.sgs` keeps everything, 3DGS `.ply` Gaussians and colors only.
///
/// # Errors
/// If the extension is another, the scene contradicts itself, or the file cannot be written.
pub fn write_scene(path: &Path, scene: &Scene) -> Result<(), FileError> {
    if scene.is_empty() {
        return Err(mismatch("no Gaussian", "at least one").at(path));
    }
    check_scene(scene).map_err(|mismatch| mismatch.at(path))?;
    match extension(path).as_str() {
        "ply" => write_atomically(path, |out| ply::write(out, scene)),
        "sgs" => sgs::write(path, scene),
        other => Err(mismatch(format_args!("extension `{other}`"), "`.ply` or `.sgs`").at(path)),
    }
}

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

/// Writes a look (`*.look.safetensors`). Each channel of the colors is rounded to 256 steps between its smallest and its
/// largest value, which takes 3 bytes per Gaussian.
///
/// # Errors
/// If a value is not finite, there is not one color per Gaussian of the scene, or the file cannot be written.
pub fn write_look(path: &Path, look: &Look) -> Result<(), FileError> {
    let tensors = look::prepare(look).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| tensors.write(out))
}

/// Writes a style with the paint of its painting (`*.style.safetensors`). [`read_style`] reads its statistics and
/// [`read_paint`] its paint.
///
/// # Errors
/// As [`write_style`], or if the paint's shapes do not fit one another.
pub fn write_painted_style(path: &Path, style: &ChannelStatistics, paint: &Paint) -> Result<(), FileError> {
    let mut tensors = style::prepare(style).map_err(|mismatch| mismatch.at(path))?;
    style::add_paint(&mut tensors, paint).map_err(|mismatch| mismatch.at(path))?;
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

/// The extension in lower case, or an empty text if there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

#[cfg(test)]
mod tests;
