//! File formats: scenes, decoders, style statistics, colors.
//!
//! A reader takes the whole file into memory (its own size bounds what is allocated), decides by content, and checks
//! every count against the bytes there are. A writer never leaves a half-written file: see [`write_atomically`].

use std::{
    fmt, io,
    path::{Path, PathBuf},
};

use crate::{decoder::Decoder, scene::Scene, statistics::ChannelStatistics};

mod activate;
mod atomic;
mod checkpoint;
mod colors;
mod decoder;
mod ply;
pub mod pytorch;
mod sgs;
mod style;
mod tensors;

pub use atomic::write_atomically;
pub use colors::write_colors;

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// What the file holds, or what should go into it, is not what it must be.
    #[error("{}: found {found}, expected {expected}", path.display())]
    Unexpected {
        /// The file.
        path: PathBuf,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
}

/// A mismatch inside some bytes; [`FileError::Unexpected`] adds the file's name.
#[derive(Debug)]
struct Mismatch {
    found: String,
    expected: String,
}

impl Mismatch {
    fn at(self, path: &Path) -> FileError {
        FileError::Unexpected { path: path.into(), found: self.found, expected: self.expected }
    }
}

/// A [`Mismatch`] in the words of the message "found .., expected ..".
fn mismatch(found: impl fmt::Display, expected: impl fmt::Display) -> Mismatch {
    Mismatch { found: found.to_string(), expected: expected.to_string() }
}

/// A scene as read, with what its user should know.
#[derive(Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// What was dropped, missing or ignored, one sentence each.
    pub warnings: Vec<String>,
}

/// The precision of stored decoder weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Half precision: half the size, relative error 2^-11.
    F16,
    /// Single precision: exact.
    F32,
}

/// Which kind of file some bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Ply,
    Safetensors,
    Checkpoint,
}

/// The kind that the first bytes tell.
fn kind_of(bytes: &[u8]) -> Result<Kind, Mismatch> {
    const EXPECTED: &str = "a 3DGS .ply, a .sgs scene or a zip-format StyleGaussian checkpoint";
    match bytes {
        [] => Err(mismatch("an empty file", EXPECTED)),
        [b'p', b'l', b'y', b'\n' | b'\r' | b' ' | b'\t', ..] => Ok(Kind::Ply),
        [b'P', b'K', 3, 4, ..] => Ok(Kind::Checkpoint),
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

/// Reads a scene: a 3DGS `.ply` in any dialect, a `.sgs`, or one of StyleGaussian's own checkpoints. The content
/// decides, not the name.
///
/// Gaussians that are not finite or have a zero quaternion are dropped; a warning counts them.
///
/// # Errors
/// When the file cannot be read, is none of these, contradicts itself, or holds no Gaussian.
pub fn read_scene(path: &Path) -> Result<Loaded, FileError> {
    parse_scene(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads a scene from the bytes of any file that [`read_scene`] takes; `name` stands for the file in errors.
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

/// Writes a scene: `.sgs` with everything it has, or 3DGS `.ply` with Gaussians and colors only, by the extension.
///
/// # Errors
/// When the extension is another, the scene contradicts itself, or the file cannot be written.
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

/// Checks what files and their readers rely on: shapes and indices, finite values, unit quaternions, opacities in 0..1.
fn check_scene(scene: &Scene) -> Result<(), Mismatch> {
    scene.validate().map_err(|error| mismatch(format_args!("an inconsistent {error}"), "a valid scene"))?;
    for (i, source_index) in scene.order.iter().enumerate() {
        let wrong = |what: String, expected| {
            Err(mismatch(format_args!("{what} of source Gaussian {source_index}"), expected))
        };
        if !activate::is_usable(scene, i) {
            return wrong("NaN or infinity".into(), "finite numbers");
        }
        let length = scene.rotations[i].length();
        if (length - 1.0).abs() > 1e-3 {
            return wrong(format!("a rotation of length {length}"), "unit quaternions");
        }
        let opacity = scene.opacities[i];
        if !(0.0..=1.0).contains(&opacity) {
            return wrong(format!("opacity {opacity}"), "0 to 1");
        }
    }
    Ok(())
}

/// Reads a decoder (`*.decoder.safetensors`).
///
/// # Errors
/// When the file cannot be read, is no decoder, or its layers do not fit one another.
pub fn read_decoder(path: &Path) -> Result<Decoder, FileError> {
    decoder::from_bytes(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads a decoder from the bytes of a `*.decoder.safetensors`; `name` stands for the file in errors.
///
/// # Errors
/// As [`read_decoder`].
pub fn decoder_from_bytes(bytes: &[u8], name: &str) -> Result<Decoder, FileError> {
    decoder::from_bytes(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

/// Writes a decoder (`*.decoder.safetensors`). Biases are always exact; `precision` is that of the weights.
///
/// # Errors
/// When the layers do not fit one another, a value is not finite, or the file cannot be written.
pub fn write_decoder(path: &Path, decoder: &Decoder, precision: Precision) -> Result<(), FileError> {
    let tensors = decoder::prepare(decoder, precision).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| tensors.write(out))
}

/// Reads the statistics of a style (`*.style.safetensors`).
///
/// # Errors
/// When the file cannot be read, is no style, or a value is not finite.
pub fn read_style(path: &Path) -> Result<ChannelStatistics, FileError> {
    style::from_bytes(&read_bytes(path)?).map_err(|mismatch| mismatch.at(path))
}

/// Reads the statistics of a style from the bytes of a `*.style.safetensors`; `name` stands for the file in errors.
///
/// # Errors
/// As [`read_style`].
pub fn style_from_bytes(bytes: &[u8], name: &str) -> Result<ChannelStatistics, FileError> {
    style::from_bytes(bytes).map_err(|mismatch| mismatch.at(Path::new(name)))
}

/// Writes the statistics of a style (`*.style.safetensors`).
///
/// # Errors
/// When shapes do not fit one another, a value is not finite, or the file cannot be written.
pub fn write_style(path: &Path, style: &ChannelStatistics) -> Result<(), FileError> {
    let tensors = style::prepare(style).map_err(|mismatch| mismatch.at(path))?;
    write_atomically(path, |out| tensors.write(out))
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    std::fs::read(path).map_err(|source| FileError::Io { path: path.into(), source })
}

/// The extension in lower case; empty where there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

#[cfg(test)]
mod tests;
