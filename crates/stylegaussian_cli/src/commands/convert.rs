//! `stylegaussian convert`: converts between scene formats.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use clap::Args;
use serde::Serialize;
use stylegaussian::{Scene, scene::ScreenFilter};
use stylegaussian_files::{
    Precision, ReadOptions, WriteOptions, read_scene_with, write_decoder, write_scene_with,
};

use crate::{
    arguments::is_named,
    scenes::{ReadArgs, WriteArgs, extension, is_writable, unexpected_extension},
    terminal::{lossy, print, warn},
};

mod pictures;

/// Convert a scene between formats.
///
/// The output is read back. Parts that the format cannot hold are listed, and pictures of both scenes are
/// compared if it rounds.
#[derive(Args, Debug)]
pub struct ConvertArgs {
    /// A scene in any format: `stylegaussian --help` lists them.
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write. Its extension chooses the format: .sgs keeps everything, all others geometry and
    /// colors; .compressed.ply is PlayCanvas' compressed .ply; .decoder.safetensors is the scene's decoder
    /// alone.
    #[arg(value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    #[command(flatten)]
    writing: WriteArgs,
    /// The degree of spherical harmonics to write. Higher ones are left out, which gives smaller files with
    /// less change of color with the direction of view. A .ply of a scene with fewer, unless it is a compressed
    /// one, is filled up with zeros: some programs read no .ply without degree 3. Default: those of the scene.
    #[arg(long, value_name = "0..3", value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: Option<u8>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Converted<'a> {
    #[serde(serialize_with = "lossy")]
    input: &'a Path,
    #[serde(serialize_with = "lossy")]
    output: &'a Path,
    n_gaussians: usize,
    /// Sizes of the files. A scene of several files counts with the one that was named, a folder with its own.
    input_bytes: u64,
    output_bytes: u64,
    bytes_per_gaussian: f64,
    /// The ratio of the pictures' noise to white, in dB. Nothing if the format does not round, or no pixel
    /// differs.
    psnr_db: Option<f64>,
    warnings: Vec<String>,
}

/// Formats that keep 32 bits of every number that is drawn. The others are compared.
const EXACT: [&str; 3] = ["ply", "sgs", "glb"];

/// The end of the names of compressed files of an exact format's extension.
const COMPRESSED_PLY: &str = ".compressed.ply";

/// Runs the command.
pub fn run(arguments: &ConvertArgs) -> Result<()> {
    let ConvertArgs { input, output, json, .. } = arguments;
    let is_decoder = is_named(output, "decoder");
    // Before anything is read, because it is a usage error.
    if !is_decoder && !is_writable(output) {
        return Err(unexpected_extension(output, &["decoder.safetensors"]));
    }
    let loaded = arguments.reading.read(input)?;
    let (scene, mut warnings) = (loaded.scene, loaded.warnings);
    let mut psnr_db = None;
    if is_decoder {
        let decoder = scene.decoder.as_ref();
        let decoder =
            decoder.with_context(|| format!("{}: the scene has no decoder to write", input.display()))?;
        write_decoder(output, decoder, Precision::F32)?;
    } else {
        let mut options = arguments.writing.options();
        if let Some(sh_degree) = arguments.sh_degree {
            options = WriteOptions { sh_degree, fills_sh: true, ..options };
        }
        let clamped = write_scene_with(output, &scene, options)?;
        warn(&clamped);
        warnings.extend(clamped);
        // A pipe cannot be read back.
        if fs::metadata(output).is_ok_and(|written| written.is_file()) {
            let written = read_scene_with(output, ReadOptions::default())?.scene;
            let lost = lost(&scene, &written, options.sh_degree);
            let mut lost: Vec<_> =
                lost.iter().map(|what| format!("a .{} keeps no {what}", extension(output))).collect();
            let captured = degree(&scene);
            if arguments.sh_degree.is_some_and(|asked| captured < asked && degree(&written) < asked) {
                lost.push(format!(
                    "spherical harmonics have degree {captured}, as in the scene: only a 3DGS .ply is filled up"
                ));
            }
            warn(&lost);
            warnings.extend(lost);
            let is_compressed = output.to_string_lossy().to_lowercase().ends_with(COMPRESSED_PLY);
            let is_exact = EXACT.contains(&&*extension(output)) && !is_compressed;
            let rounds = !is_exact || degree(&written) < degree(&scene);
            psnr_db = if rounds { pictures::psnr(&scene, &written) } else { None };
        }
    }
    let size = |path: &Path| fs::metadata(path).map_or(0, |file| file.len());
    let converted = Converted {
        input,
        output,
        n_gaussians: scene.len(),
        input_bytes: size(input),
        output_bytes: size(output),
        bytes_per_gaussian: size(output) as f64 / scene.len() as f64,
        psnr_db,
        warnings,
    };
    print(*json, &converted, || text(&converted))
}

/// The parts of a scene that its file does not have, in words. Spherical harmonics above `degree` were not
/// wanted.
fn lost(scene: &Scene, written: &Scene, kept: u8) -> Vec<String> {
    let mut lost = Vec::new();
    if scene.features.is_some() && written.features.is_none() {
        lost.push("features, neighbors or decoder: they are left out".into());
    } else if scene.decoder.is_some() && written.decoder.is_none() {
        lost.push("decoder: it is left out".into());
    }
    if scene.mask.is_some() && written.mask.is_none() {
        lost.push("mask: it is left out".into());
    }
    if degree(written) < degree(scene).min(kept) {
        lost.push(format!("spherical harmonics beyond degree {}: they are left out", degree(written)));
    }
    if scene.filter == ScreenFilter::Antialiased && written.filter == ScreenFilter::Classic {
        lost.push("tag of the anti-aliasing filter: small splats will look too bright".into());
    }
    if scene.up.is_some() && written.up.is_none() {
        lost.push("up direction: it is left out".into());
    }
    lost
}

fn degree(scene: &Scene) -> u8 {
    scene.sh.as_ref().map_or(0, |sh| sh.degree)
}

fn text(converted: &Converted) -> String {
    let Converted { input, output, n_gaussians, input_bytes, output_bytes, bytes_per_gaussian, .. } =
        converted;
    // A .json or a folder names the files of its scene, and its own size says nothing.
    let share = match extension(input).as_str() {
        "json" => String::new(),
        _ if input.is_dir() => String::new(),
        _ => {
            let percent = 100.0 * *output_bytes as f64 / (*input_bytes).max(1) as f64;
            format!(", {percent:.0} % of {}", input.display())
        }
    };
    let psnr = converted.psnr_db.map_or(String::new(), |db| format!(", pictures at {db:.1} dB"));
    format!(
        "{}: {n_gaussians} Gaussians, {output_bytes} bytes ({bytes_per_gaussian:.1} each{share}){psnr}",
        output.display()
    )
}
