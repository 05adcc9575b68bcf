//! Reading and writing scenes: the options that all commands share, and the formats of outputs.

use std::path::Path;

use anyhow::Result;
use clap::Args;
use stylegaussian::Axes;
use stylegaussian_files::{Loaded, ReadOptions, WriteOptions, read_scene_with, writable_extensions};

use crate::terminal::{usage_error, warn};

/// Options of reading a scene.
#[derive(Args, Clone, Copy, Debug)]
pub struct ReadArgs {
    /// The axes of the scene's file, three letters for x, y and z: r or l (right, left), u or d (up, down), f
    /// or b (forward, back). rdf is that of 3DGS .ply files, rub that of SPZ and glTF. Default: those that the
    /// file or its format's specification says, which `info` tells.
    #[arg(long, value_name = "AXES")]
    axes: Option<Axes>,
    /// The most Gaussians of a scene that has several levels of detail (streamed SOG). Default: the finest
    /// level.
    #[arg(long, value_name = "N", value_parser = at_least_1)]
    budget: Option<usize>,
}

impl ReadArgs {
    /// The options.
    pub fn options(self) -> ReadOptions {
        let Self { axes, budget } = self;
        ReadOptions { axes, budget }
    }

    /// Reads a scene and prints its warnings.
    ///
    /// # Errors
    /// If the file cannot be read or is no scene.
    pub fn read(self, path: &Path) -> Result<Loaded> {
        let loaded = read_scene_with(path, self.options())?;
        warn(&loaded.warnings);
        Ok(loaded)
    }
}

/// Options of writing a scene.
#[derive(Args, Clone, Copy, Debug)]
pub struct WriteArgs {
    /// The version of an .spz: 3, which most programs read, or 4, whose parts are unpacked side by side.
    #[arg(long, value_name = "3|4", default_value_t = WriteOptions::default().spz_version,
        value_parser = clap::value_parser!(u8).range(3..=4))]
    spz_version: u8,
}

impl WriteArgs {
    /// The options, with spherical harmonics of all degrees.
    pub fn options(self) -> WriteOptions {
        WriteOptions { spz_version: self.spz_version, ..WriteOptions::default() }
    }
}

fn at_least_1(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n > 0).ok_or_else(|| "expected a number of at least 1".into())
}

/// The extension of a path, in lower case and without the leading dot.
pub fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// Whether a scene can be written under this name.
pub fn is_writable(path: &Path) -> bool {
    writable_extensions().contains(&&*extension(path))
}

/// The usage error of an output with an extension that is not among those of scenes and `others`.
pub fn unexpected_extension(path: &Path, others: &[&str]) -> anyhow::Error {
    let extensions: Vec<String> =
        writable_extensions().into_iter().chain(others.iter().copied()).map(|e| format!(".{e}")).collect();
    usage_error(format!("{}: expected an extension of {}", path.display(), extensions.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets() {
        assert_eq!(at_least_1("20"), Ok(20));
        for text in ["0", "-1", "1e6", ""] {
            assert!(at_least_1(text).is_err(), "{text}");
        }
    }

    #[test]
    fn extensions_are_those_of_the_library() {
        assert!(is_writable("a/b.PLY".as_ref()) && is_writable("a.sgs".as_ref()));
        assert!(!is_writable("a.pth".as_ref()) && !is_writable("ply".as_ref()));
        let message = unexpected_extension("a.x".as_ref(), &["decoder.safetensors"]).to_string();
        assert!(message.contains("a.x: expected an extension of .ply, .spz"), "{message}");
        assert!(message.contains(", .decoder.safetensors"), "{message}");
    }
}
