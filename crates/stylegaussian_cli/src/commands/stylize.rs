//! `stylegaussian stylize`: writes a scene in a style to a file.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde::Serialize;
use stylegaussian::{Look, Scene, file};

use crate::{
    arguments::is_look,
    outputs::expect_files,
    stylization::{Stylization, StylizationArgs},
    terminal::{print, usage_error, warn},
};

/// Stylize a scene with one painting or look, or a mix of several.
#[derive(Args, Debug)]
#[command(mut_group("restyling", |restyling| restyling.required(true)))]
pub struct StylizeArgs {
    /// A scene. Styles need an embedded one: .sgs, or a StyleGaussian checkpoint (.pth). Looks need none.
    scene: PathBuf,
    #[command(flatten)]
    stylization: StylizationArgs,
    /// The file to write. As .ply or .sgs: the scene with the stylized colors as SH of degree 0. As .look.safetensors:
    /// a look. As .safetensors: a tensor `rgb` f32 [N, 3], not clamped, with one row for each Gaussian of the source,
    /// NaN if the Gaussian was dropped.
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

/// The format of the output.
#[derive(Clone, Copy)]
enum Format {
    Scene,
    Look,
    Colors,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "ply" | "sgs" => Ok(Self::Scene),
            "safetensors" if is_look(path) => Ok(Self::Look),
            "safetensors" => Ok(Self::Colors),
            _ => {
                let path = path.display();
                Err(usage_error(format!("{path}: expected extension .ply, .sgs or .safetensors")))
            }
        }
    }
}

/// Runs the command.
pub fn run(arguments: &StylizeArgs) -> Result<()> {
    let StylizeArgs { scene: path, stylization, output, json } = arguments;
    // Before anything is read, because it is a usage error.
    let format = Format::of(output)?;
    let mut compute = stylization.open()?;
    expect_files([&**output])?;
    let loaded = file::read_scene(path)?;
    warn(&loaded.warnings);
    let mut scene = loaded.scene;
    let mut result = stylization.stylize(&scene, path, &mut compute)?;
    // Both kinds are printed already. In JSON they come in the order of printing.
    result.warnings.splice(0..0, loaded.warnings);
    write(format, output, &mut scene, &result)?;
    let stylized = Stylized { scene: path, output, n_gaussians: scene.len(), stylization: &result };
    print(*json, &stylized, || format!("{}: {} Gaussians stylized", output.display(), scene.len()))
}

fn write(format: Format, path: &Path, scene: &mut Scene, result: &Stylization) -> Result<()> {
    match format {
        Format::Scene => {
            scene.set_colors(&result.colors);
            file::write_scene(path, scene)?;
        }
        Format::Look => file::write_look(path, &Look::new(scene, &result.colors, result.made_from()))?,
        Format::Colors => file::write_colors(path, &result.colors, scene)?,
    }
    Ok(())
}
