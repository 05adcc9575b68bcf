//! `stylegaussian convert`: converts between scene formats.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use serde::Serialize;
use stylegaussian::file::{self, Precision};

use crate::terminal::{print, warn};

/// Convert a scene between formats, chosen by extension.
#[derive(Args, Debug)]
pub struct ConvertArgs {
    /// A scene: 3DGS .ply, .sgs, or a StyleGaussian checkpoint (.pth).
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write: .sgs (everything), .ply (geometry and colors) or .decoder.safetensors (only the scene's
    /// decoder).
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Converted<'a> {
    input: &'a Path,
    output: &'a Path,
    n_gaussians: usize,
    warnings: Vec<String>,
}

/// Runs the command.
pub fn run(arguments: &ConvertArgs) -> Result<()> {
    let ConvertArgs { input, output, json } = arguments;
    let loaded = file::read_scene(input)?;
    let (scene, mut warnings) = (loaded.scene, loaded.warnings);
    if output.to_string_lossy().to_lowercase().ends_with(".decoder.safetensors") {
        let decoder = scene.decoder.as_ref();
        let decoder =
            decoder.with_context(|| format!("{}: the scene has no decoder to write", input.display()))?;
        file::write_decoder(output, decoder, Precision::F32)?;
    } else {
        let is_ply = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ply"));
        if is_ply && scene.features.is_some() {
            warnings.push("a .ply keeps no features, neighbors or decoder: they are left out".into());
        }
        file::write_scene(output, &scene)?;
    }
    warn(&warnings);
    let converted = Converted { input, output, n_gaussians: scene.len(), warnings };
    print(*json, &converted, || format!("{}: {} Gaussians", output.display(), scene.len()))
}
