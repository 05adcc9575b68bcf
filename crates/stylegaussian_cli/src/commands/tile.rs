//! `stylegaussian tile`: makes a world of scenes, levels of detail in chunks that are streamed.

use std::{
    fs, iter,
    path::{Path, PathBuf},
    time::{Instant, UNIX_EPOCH},
};

use anyhow::{Result, bail};
use clap::Args;
use serde::Serialize;
use stylegaussian_files::{
    FileError, Loaded, ReadOptions, Slices,
    tile::{TileError, TileOptions, tile},
};

use crate::{
    outputs::expect_folder,
    scenes::ReadArgs,
    terminal::{Interrupt, lossy, print, warn, with_bar_until},
};

/// Make a world: a folder with levels of detail in chunks that are streamed (streamed SOG, lod-meta.json).
///
/// Gaussians that are near one another and alike are merged, level by level, each with a quarter of the one
/// before. Scenes may be larger than memory: .ply and .splat are read in slices and sorted on disk. Those whose
/// up direction is known are turned until -y is up, as in all worlds. Ctrl-C stops between two steps; the same
/// command then goes on.
#[derive(Args, Debug)]
pub struct TileArgs {
    /// Scenes in any format (`stylegaussian --help` lists them). Together they are one world.
    #[arg(value_name = "SCENE", required = true)]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    reading: ReadArgs,
    /// The folder of the world: a new or an empty one, or that of an interrupted call.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Levels of detail. The coarsest has 4 / 4^L of the Gaussians.
    #[arg(long, value_name = "L", default_value_t = TileOptions::default().n_levels as u32,
        value_parser = clap::value_parser!(u32).range(1..=32))]
    levels: u32,
    /// Most Gaussians of a chunk, which is read as a whole. Its parts, of which each is shown at a level of its
    /// own, have a quarter at most.
    #[arg(long, value_name = "N", default_value_t = TileOptions::default().chunk as u32,
        value_parser = clap::value_parser!(u32).range(4..))]
    chunk: u32,
    /// The largest side of a part, in scene units [default: any].
    #[arg(long, value_name = "M", value_parser = size)]
    cell: Option<f32>,
    /// The highest degree of spherical harmonics that is kept: 0 is the base color. They take disk, 360 of 472
    /// bytes per Gaussian at degree 3 while scenes are sorted, and memory.
    #[arg(long, value_name = "0..3", default_value_t = TileOptions::default().sh_degree,
        value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: u8,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Written<'a> {
    #[serde(serialize_with = "lossy")]
    output: &'a Path,
    /// Gaussians of each level, the finest first.
    n_gaussians: Vec<u64>,
    n_nodes: usize,
    n_chunks: usize,
    /// Of this call.
    seconds: f64,
    warnings: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// If a scene cannot be read, the folder cannot be written or holds anything else, or the user interrupts.
pub fn run(arguments: &TileArgs, interrupt: &Interrupt) -> Result<()> {
    let began = Instant::now();
    let TileArgs { scenes, output, .. } = arguments;
    expect_folder(output)?;
    let reading = arguments.reading.options();
    let options = TileOptions {
        n_levels: arguments.levels as usize,
        chunk: arguments.chunk as usize,
        cell: arguments.cell,
        sh_degree: arguments.sh_degree,
    };
    let key = key(scenes, reading)?;
    let slices = scenes.iter().flat_map(|path| slices(path, reading));
    let tiled = with_bar_until("{bar:40} {percent}%, {eta} left", interrupt.watch(), |work| {
        tile(slices, &key, output, &options, work)
    });
    let tiled = match tiled {
        Ok(tiled) => tiled,
        Err(TileError::File(error)) => return Err(error.into()),
        Err(TileError::Canceled(_)) => bail!("interrupted; the same command goes on where it stopped"),
    };
    warn(&tiled.warnings);
    let world = tiled.world;
    let written = Written {
        output,
        n_gaussians: (0..world.n_levels).map(|level| world.count(level)).collect(),
        n_nodes: world.nodes.len(),
        n_chunks: world.files.len(),
        seconds: began.elapsed().as_secs_f64(),
        warnings: tiled.warnings,
    };
    print(arguments.json, &written, || {
        let counts: Vec<String> = written.n_gaussians.iter().map(u64::to_string).collect();
        format!(
            "{}: {} Gaussians at {} levels, {} parts in {} chunks, {:.0} s",
            output.display(),
            counts.join(", "),
            counts.len(),
            written.n_nodes,
            written.n_chunks,
            written.seconds
        )
    })
}

/// The slices of a scene, or the error of opening it as the only one.
fn slices(path: &Path, options: ReadOptions) -> Box<dyn Iterator<Item = Result<Loaded, FileError>>> {
    match Slices::open(path, options) {
        Ok(slices) => Box::new(slices),
        Err(error) => Box::new(iter::once(Err(error))),
    }
}

/// Tells calls with other scenes apart: by their places, sizes and times of change, and how they are read.
fn key(scenes: &[PathBuf], reading: ReadOptions) -> Result<String> {
    let mut key = format!("{reading:?}");
    for path in scenes {
        let at = |source| FileError::Io { path: path.clone(), source };
        let (place, found) = (fs::canonicalize(path).map_err(at)?, fs::metadata(path).map_err(at)?);
        // Some file systems keep no times.
        let changed = found.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        key += &format!(" {place:?} {} {:?}", found.len(), changed);
    }
    Ok(key)
}

/// A finite size above 0.
fn size(text: &str) -> Result<f32, String> {
    let size = text.parse().ok().filter(|size: &f32| size.is_finite() && *size > 0.0);
    size.ok_or_else(|| "expected a number above 0".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_above_0() {
        assert_eq!(size("16"), Ok(16.0));
        for text in ["0", "-1", "inf", "nan", ""] {
            assert!(size(text).is_err(), "{text}");
        }
    }

    #[test]
    fn keys_differ_by_scene_and_reading() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = ["a.ply", "b.ply"].map(|name| dir.path().join(name));
        fs::write(&a, "1").unwrap();
        fs::write(&b, "1").unwrap();
        let of = |paths: &[&PathBuf], budget| {
            let paths: Vec<PathBuf> = paths.iter().map(|&path| path.clone()).collect();
            key(&paths, ReadOptions { budget, ..ReadOptions::default() }).unwrap()
        };
        let before = of(&[&a], None);
        assert_eq!(before, of(&[&a], None));
        for other in [of(&[&b], None), of(&[&a, &b], None), of(&[&a], Some(1))] {
            assert_ne!(before, other);
        }
        fs::write(&a, "12").unwrap();
        assert_ne!(before, of(&[&a], None));
        fs::remove_file(&a).unwrap();
        assert!(key(&[a], ReadOptions::default()).unwrap_err().to_string().contains("a.ply"));
    }
}
