//! `stylegaussian stylize`: a scene in a style, as a file.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::{Args, CommandFactory, error::ErrorKind};
use serde::Serialize;
use stylegaussian::{Scene, file};

use super::{
    Cli,
    output::{print, warn},
    stylization::{Stylization, StylizationArgs},
};

/// Stylize an embedded scene with one painting or a mix of several.
#[derive(Args, Debug)]
#[command(mut_arg("styles", |styles| styles.required(true)))]
pub struct StylizeArgs {
    /// An embedded scene: .sgs, or a StyleGaussian checkpoint (.pth).
    scene: PathBuf,
    #[command(flatten)]
    stylization: StylizationArgs,
    /// .ply or .sgs: the scene with the stylized colors as SH 0. .safetensors: a tensor `rgb` f32 [N, 3], not clamped,
    /// one row for each Gaussian of the source, NaN where it was dropped.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Stylized<'a> {
    scene: &'a Path,
    output: &'a Path,
    n_gaussians: usize,
    #[serde(flatten)]
    stylization: &'a Stylization,
}

/// The formats that stylized scenes are written in.
#[derive(Clone, Copy)]
enum Format {
    Scene,
    Colors,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "ply" | "sgs" => Ok(Self::Scene),
            "safetensors" => Ok(Self::Colors),
            _ => {
                let message = format!("{}: expected extension .ply, .sgs or .safetensors", path.display());
                bail!(Cli::command().error(ErrorKind::ValueValidation, message))
            }
        }
    }
}

/// Runs the command.
pub fn run(arguments: &StylizeArgs) -> Result<()> {
    let StylizeArgs { scene: path, stylization, output, json } = arguments;
    let format = Format::of(output)?;
    let mut compute = stylization.open()?;
    let loaded = file::read_scene(path)?;
    warn(&loaded.warnings);
    let mut scene = loaded.scene;
    let mut result = stylization.stylize(&scene, path, &mut compute)?;
    result.warnings.splice(0..0, loaded.warnings);
    write(format, output, &mut scene, &result.colors)?;
    let stylized = Stylized { scene: path, output, n_gaussians: scene.len(), stylization: &result };
    print(*json, &stylized, || format!("{}: {} Gaussians stylized", output.display(), scene.len()))
}

fn write(format: Format, path: &Path, scene: &mut Scene, rgb: &[[f32; 3]]) -> Result<()> {
    match format {
        Format::Scene => {
            scene.set_colors(rgb);
            file::write_scene(path, scene)?;
        }
        Format::Colors => file::write_colors(path, rgb, scene)?,
    }
    Ok(())
}
