//! `stylegaussian stylize`: writes a scene in a style to a file.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde::Serialize;
use stylegaussian::{
    Look, Scene,
    file::{self, WriteOptions},
};

use crate::{
    arguments::is_look,
    outputs::expect_files,
    scenes::{ReadArgs, WriteArgs, extension, is_writable, unexpected_extension},
    stylization::{Stylization, StylizationArgs},
    terminal::{lossy, print, warn},
};

/// Stylize a scene with one painting or look, or a mix of several.
#[derive(Args, Debug)]
#[command(mut_group("restyling", |restyling| restyling.required(true)))]
pub struct StylizeArgs {
    /// A scene. Styles need an embedded one: .sgs, or a StyleGaussian checkpoint (.pth). Looks need none.
    scene: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    #[command(flatten)]
    stylization: StylizationArgs,
    /// The file to write. As a scene in any format that `stylegaussian --help` lists for writing: with the stylized
    /// colors as SH of degree 0. As .look.safetensors: a look. As .safetensors: a tensor `rgb` f32 [N, 3], not clamped, with one row for each Gaussian of the source,
    /// NaN if the Gaussian was dropped.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    writing: WriteArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Stylized<'a> {
    #[serde(serialize_with = "lossy")]
    scene: &'a Path,
    #[serde(serialize_with = "lossy")]
    output: &'a Path,
    n_gaussians: usize,
    #[serde(flatten)]
    stylization: &'a Stylization,
}

/// The format of the output.
#[derive(Clone, Copy)]
enum Format {
    Scene,
    Look,
    Colors,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        match &*extension(path) {
            _ if is_writable(path) => Ok(Self::Scene),
            "safetensors" if is_look(path) => Ok(Self::Look),
            "safetensors" => Ok(Self::Colors),
            _ => Err(unexpected_extension(path, &["look.safetensors", "safetensors"])),
        }
    }
}

/// Runs the command.
pub fn run(arguments: &StylizeArgs) -> Result<()> {
    let StylizeArgs { scene: path, reading, stylization, output, writing, json } = arguments;
    // Before anything is read, because it is a usage error.
    let format = Format::of(output)?;
    let mut compute = stylization.open()?;
    expect_files([&**output])?;
    let loaded = reading.read(path)?;
    let mut scene = loaded.scene;
    let mut result = stylization.stylize(&scene, path, &mut compute)?;
    // Both kinds are printed already. In JSON they come in the order of printing.
    result.warnings.splice(0..0, loaded.warnings);
    let clamped = write(format, output, writing.options(), &mut scene, &result)?;
    warn(&clamped);
    result.warnings.extend(clamped);
    let stylized = Stylized { scene: path, output, n_gaussians: scene.len(), stylization: &result };
    print(*json, &stylized, || format!("{}: {} Gaussians stylized", output.display(), scene.len()))
}

/// Writes the result. Returns warnings of what was clamped.
fn write(
    format: Format,
    path: &Path,
    options: WriteOptions,
    scene: &mut Scene,
    result: &Stylization,
) -> Result<Vec<String>> {
    match format {
        Format::Scene => {
            scene.set_colors(&result.colors);
            return Ok(file::write_scene_with(path, scene, options)?);
        }
        Format::Look => file::write_look(path, &Look::new(scene, &result.colors, result.made_from()))?,
        Format::Colors => file::write_colors(path, &result.colors, scene)?,
    }
    Ok(Vec::new())
}
