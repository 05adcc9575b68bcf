//! A scene format: its marks, its reader and its writer, and the choices that they are given.

use std::io::{self, Write};

use stylegaussian::{axes::Axes, scene::Scene};

use super::{
    error::{Loaded, Mismatch},
    files::{Files, Unread},
};

/// A scene format.
pub(super) struct Format {
    /// The name, for people.
    pub name: &'static str,
    /// Extensions in lower case, without the leading dot. Writing goes by the first match. Reading goes by them
    /// only if the content has no mark.
    pub extensions: &'static [&'static str],
    /// Whether a file that begins like this is one of this format. The extension, in lower case, is for formats
    /// without a mark of their own.
    pub recognizes: fn(bytes: &[u8], extension: &str) -> bool,
    /// Reads a scene, or asks for the files that it still needs. Files of scenes that were read, or that were
    /// refused, are not needed any more and may be taken.
    pub read: fn(&mut Files, &ReadOptions) -> Result<Loaded, Unread>,
    /// Writes a scene, or `None` if the format is only read. The scene was checked and holds a Gaussian.
    pub write: Option<WriteScene>,
}

/// A writer of scenes. It returns warnings of clamped values, and of an offset that the format cannot hold, one
/// sentence each.
pub(super) type WriteScene = fn(&mut dyn Write, &Scene, &WriteOptions) -> Result<Vec<String>, Unwritten>;

/// A scene that was not written.
#[derive(Debug)]
pub(super) enum Unwritten {
    /// The format cannot hold it.
    Mismatch(Mismatch),
    /// The operating system refused.
    Io(io::Error),
}

impl From<Mismatch> for Unwritten {
    fn from(mismatch: Mismatch) -> Self {
        Self::Mismatch(mismatch)
    }
}

impl From<io::Error> for Unwritten {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Choices of a reader.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// The axes of the file's coordinates, or `None` for those that the file or its format's specification
    /// says. The scene is turned from them to the axes of 3DGS `.ply` files, [`Axes::RDF`].
    pub axes: Option<Axes>,
    /// The most Gaussians of a scene that is stored at several levels of detail, or `None` for the finest
    /// level.
    pub budget: Option<usize>,
}

/// Choices of a writer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteOptions {
    /// The highest degree of spherical harmonics that is kept, 0..=3.
    pub sh_degree: u8,
    /// Whether a 3DGS `.ply` has spherical harmonics up to `sh_degree` even if the scene has fewer, which are
    /// zeros then. Some programs read no file without all of degree 3.
    pub fills_sh: bool,
    /// The version of an SPZ file, 3 or 4.
    pub spz_version: u8,
}

impl Default for WriteOptions {
    /// All spherical harmonics, and the versions that most readers take.
    fn default() -> Self {
        Self { sh_degree: stylegaussian::sh::MAX_DEGREE, fills_sh: false, spz_version: 3 }
    }
}
