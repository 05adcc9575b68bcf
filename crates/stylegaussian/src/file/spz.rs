//! SPZ, Niantic's compressed scenes: versions 1 to 4 are read, 3 and 4 are written.
//!
//! A header, then one array per property, each value in one to three bytes. Versions 1 to 3 lie in gzip; version 4 has a
//! header of its own and a zstd frame for each array. Layout and values are those of Niantic's library
//! (github.com/nianticlabs/spz, `src/cc/load-spz.cc`).
//!
//! Axes are RUB by the specification. Several programs write those of `.ply` files without a word, which the user has to
//! tell by [`ReadOptions::axes`](super::ReadOptions).

use super::{
    error::{Loaded, Mismatch, mismatch},
    files::{Files, Unread},
    format::{Format, ReadOptions},
};
use crate::{axes::Axes, scene::Scene};

mod container;
mod decode;
mod encode;
mod extension;
mod header;

use container::Contents;

/// The format.
pub(super) const FORMAT: Format = Format {
    name: "SPZ",
    extensions: &["spz"],
    // No other scene format is a gzip file.
    recognizes: |bytes, _| bytes.starts_with(header::MAGIC) || bytes.starts_with(&GZIP),
    read: |files: &Files, options: &ReadOptions| Ok::<_, Unread>(read(&files.main, options)?),
    write: Some(encode::write),
};

/// The first two bytes of a gzip file.
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Reads a scene.
pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<Loaded, Mismatch> {
    let contents = container::unpack(bytes)?;
    let mut warnings = Vec::new();
    let scene = decode::decode(&contents, &mut warnings);
    let (axes, because) = axes(&contents, options, &mut warnings)?;
    Ok(Loaded::turned(scene, warnings, axes, because))
}

/// Reads a scene without turning its axes, for files that have one inside.
pub(super) fn in_its_own_axes(bytes: &[u8], warnings: &mut Vec<String>) -> Result<Scene, Mismatch> {
    Ok(decode::decode(&container::unpack(bytes)?, warnings))
}

/// The axes of the coordinates, and the reason for them.
fn axes(
    contents: &Contents,
    options: &ReadOptions,
    warnings: &mut Vec<String>,
) -> Result<(Axes, &'static str), Mismatch> {
    let told = extension::coordinate_system(&contents.extensions, warnings);
    if let Some(axes) = options.axes {
        return Ok((axes, "they were asked for"));
    }
    match told {
        Some(system) => Ok((extension::axes(system)?, "the file says so (extension 0xADBE0003)")),
        None => Ok((Axes::RUB, "the specification of SPZ says so")),
    }
}

#[cfg(test)]
mod tests;
