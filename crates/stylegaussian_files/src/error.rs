//! The outcomes of reading and writing: a scene with warnings, or an error.

use std::{
    fmt, io,
    path::{Path, PathBuf},
};

use stylegaussian::{axes::Axes, scene::Scene, work::Canceled};

/// A file that could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The contents, read or to be written, break a rule of the format.
    #[error("{}: found {found}, expected {expected}", path.display())]
    Unexpected {
        /// The file.
        path: PathBuf,
        /// The offending contents.
        found: String,
        /// The contents that the format demands.
        expected: String,
    },
    /// Nobody wants the scene any more.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

/// A mismatch inside some bytes. [`FileError::Unexpected`] adds the file's name.
#[derive(Debug, thiserror::Error)]
#[error("found {found}, expected {expected}")]
pub struct Mismatch {
    pub(super) found: String,
    pub(super) expected: String,
}

impl Mismatch {
    /// The mismatch as an error of the file at `path`.
    pub fn at(self, path: &Path) -> FileError {
        FileError::Unexpected { path: path.into(), found: self.found, expected: self.expected }
    }
}

/// A [`Mismatch`] in the words of the message "found .., expected ..".
pub(super) fn mismatch(found: impl fmt::Display, expected: impl fmt::Display) -> Mismatch {
    Mismatch { found: found.to_string(), expected: expected.to_string() }
}

/// A canceled reader stops like one that has found a mismatch. [`SceneReader`](crate::SceneReader) says
/// [`FileError::Canceled`] then.
impl From<Canceled> for Mismatch {
    fn from(canceled: Canceled) -> Self {
        mismatch(canceled, "a scene that somebody waits for")
    }
}

/// A number of bytes in words.
pub(super) fn bytes_in_words(n: u64) -> String {
    format!("{n} {}", if n == 1 { "byte" } else { "bytes" })
}

/// A scene as read, with warnings for its user.
#[derive(Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Anything that was dropped, missing or ignored, one sentence each.
    pub warnings: Vec<String>,
    /// The name of the format.
    pub format: &'static str,
    /// The axes of the file's coordinates, from which the scene was turned to [`Axes::RDF`].
    pub axes: Axes,
    /// The reason for these axes, as words that follow "because".
    pub axes_because: String,
}

impl Loaded {
    /// A scene in the axes of 3DGS `.ply` files.
    pub(super) fn new(scene: Scene, warnings: Vec<String>) -> Self {
        let axes_because = "the format keeps the coordinates of 3DGS".into();
        Self { scene, warnings, format: "", axes: Axes::RDF, axes_because }
    }

    /// Takes the file's coordinates for those of `axes` instead: the turn that was made is undone, and the
    /// other made.
    pub(super) fn retell(&mut self, axes: Axes) {
        if self.axes != axes {
            self.axes.turn(&mut self.scene);
            axes.turn(&mut self.scene);
            self.axes = axes;
        }
        self.axes_because = "they were asked for".into();
    }

    /// A scene in `axes`, turned to [`Axes::RDF`].
    pub(super) fn turned(mut scene: Scene, warnings: Vec<String>, axes: Axes, because: &str) -> Self {
        axes.turn(&mut scene);
        Self { scene, warnings, format: "", axes, axes_because: because.into() }
    }
}
