//! SPZ, Niantic's compressed scenes: versions 1 to 4 are read, 3 and 4 are written.
//!
//! A header, then one array per property, each value in one to three bytes. Versions 1 to 3 lie in gzip;
//! version 4 has a header of its own and a zstd frame for each array. Layout and values are those of Niantic's
//! library (github.com/nianticlabs/spz, `src/cc/load-spz.cc`).
//!
//! Axes are RUB by the specification. Several programs write those of `.ply` files without a word, which the
//! user has to tell by [`ReadOptions::axes`](super::ReadOptions).

use glam::{DAffine3, DMat3, DVec3};
use stylegaussian::{axes::Axes, scene::Scene, work::Work};

use super::{
    error::{Loaded, Mismatch},
    files::{Files, Unread},
    format::{Format, ReadOptions},
    place,
    upright::laid_back,
};

mod container;
mod decode;
mod encode;
mod extension;
mod header;

/// The format.
pub(super) const FORMAT: Format = Format {
    name: "SPZ",
    extensions: &["spz"],
    // No other scene format is a gzip file.
    recognizes: |bytes, _| bytes.starts_with(header::MAGIC) || bytes.starts_with(&container::GZIP),
    read: |files: &mut Files, options: &ReadOptions| {
        Ok::<_, Unread>(read(&files.main, options, &files.work)?)
    },
    write: Some(encode::write),
};

/// Reads a scene.
pub(super) fn read(bytes: &[u8], options: &ReadOptions, work: &Work) -> Result<Loaded, Mismatch> {
    let contents = container::unpack(bytes, &work.part(0.0, 0.7))?;
    work.at(0.7)?;
    let mut warnings = Vec::new();
    let mut scene = decode::decode(&contents, &mut warnings);
    work.at(0.9)?;
    let found = extension::read(&contents.extensions, &mut warnings);
    let (axes, because) = match (options.axes, found.coordinate_system) {
        (Some(axes), _) => (axes, "they were asked for"),
        (None, None) => (Axes::RUB, "the specification of SPZ says so"),
        (None, Some(system)) => match extension::axes(system) {
            (axes, false) => (axes, "the file says so (extension 0xADBE0003)"),
            (axes, true) => {
                // (x, y, z) to (x, z, -y).
                let turn = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
                place::place(&mut scene, DAffine3::from_mat3(turn), &mut warnings)?;
                (axes, "the file says so (extension 0xADBE0003), after a quarter turn about its first axis")
            }
        },
    };
    let up_before = found.up_before.filter(|_| options.axes.is_none());
    laid_back(Loaded::turned(scene, warnings, axes, because), up_before)
}

/// Reads a scene without turning its axes, for files that have one inside.
pub(super) fn in_its_own_axes(
    bytes: &[u8],
    warnings: &mut Vec<String>,
    work: &Work,
) -> Result<Scene, Mismatch> {
    let contents = container::unpack(bytes, &work.part(0.0, 0.7))?;
    work.at(0.7)?;
    Ok(decode::decode(&contents, warnings))
}

#[cfg(test)]
mod tests;
