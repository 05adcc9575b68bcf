//! `stylegaussian stylize`: writes a scene in a style to a file.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde::Serialize;
use stylegaussian::{Look, Scene, paint::Painted, split::split_paint};
use stylegaussian_files::{WriteOptions, write_colors, write_look, write_scene_with};

use crate::{
    arguments::{SPLITS, is_named, within},
    outputs::expect_files,
    scenes::{ReadArgs, WriteArgs, extension, is_writable, unexpected_extension},
    stylization::{Stylization, StylizationArgs},
    terminal::{lossy, print, usage_error, warn, with_bar},
};

/// Stylize a scene with one painting or look, or a mix of several.
#[derive(Args, Debug)]
#[command(mut_group("restyling", |restyling| restyling.required(true)))]
pub struct StylizeArgs {
    /// A scene in any format: `stylegaussian --help` lists them. A decoder needs an embedded one: .sgs, or a
    /// StyleGaussian checkpoint (.pth).
    scene: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    #[command(flatten)]
    stylization: StylizationArgs,
    /// The file to write. As .look.safetensors: a look, with its strokes. As a scene in any format that
    /// `stylegaussian --help` lists for writing: with the stylized colors as SH of degree 0. As .safetensors: a
    /// tensor `rgb` f32 [N, 3], not clamped, with one row for each Gaussian of the source, NaN if the Gaussian
    /// was dropped. Both have the mean of the strokes in each color.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// For a scene that programs without strokes show: split Gaussians that are larger than the strokes' detail
    /// and seen, to at most N times as many in all, and fit their colors to pictures with strokes [default: 4
    /// if no N is given].
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "4", value_parser = within(SPLITS))]
    split_paint: Option<f64>,
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
    /// Number of Gaussians that splitting added, or `None` if it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    n_split: Option<usize>,
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
            "safetensors" if is_named(path, "look") => Ok(Self::Look),
            "safetensors" => Ok(Self::Colors),
            _ => Err(unexpected_extension(path, &["look.safetensors", "safetensors"])),
        }
    }
}

/// Runs the command.
pub fn run(arguments: &StylizeArgs) -> Result<()> {
    let StylizeArgs { scene: path, reading, stylization, output, writing, json, .. } = arguments;
    // Before anything is read, because these are usage errors.
    let format = Format::of(output)?;
    if arguments.split_paint.is_some() && !matches!(format, Format::Scene) {
        let found = output.display();
        return Err(usage_error(format!(
            "{found}: --split-paint splits Gaussians, expected a scene's extension"
        )));
    }
    let mut compute = stylization.open()?;
    expect_files([&**output])?;
    let loaded = reading.read(path)?;
    let mut scene = loaded.scene;
    let mut result = stylization.stylize(&scene, path, &mut compute)?;
    // Both kinds are printed already. In JSON they come in the order of printing.
    result.warnings.splice(0..0, loaded.warnings);
    let split = |factor| {
        with_bar("{bar:40} {percent}% of the split, {eta} left", |work| {
            split_paint(&mut scene, &result.shown, factor, work)
        })
    };
    let n_split = arguments.split_paint.map(split).transpose()?;
    let lost = if n_split.is_some() {
        write_scene_with(output, &scene, writing.options())?
    } else {
        write(format, output, writing.options(), &mut scene, &result)?
    };
    warn(&lost);
    result.warnings.extend(lost);
    let n_gaussians = scene.len();
    let stylized = Stylized { scene: path, output, n_gaussians, n_split, stylization: &result };
    print(*json, &stylized, || {
        let added = n_split.map_or(String::new(), |n| format!(" ({n} of them by splitting)"));
        format!("{}: {n_gaussians} Gaussians stylized{added}", output.display())
    })
}

/// Says what a file without strokes holds of them.
const FLATTENED: &str = "strokes are drawn by the pixel: this file holds their mean per Gaussian; \
                         --split-paint splits it, `render` shows them, and a .look.safetensors keeps them";

/// Writes the result. Returns warnings of what was lost.
fn write(
    format: Format,
    path: &Path,
    options: WriteOptions,
    scene: &mut Scene,
    result: &Stylization,
) -> Result<Vec<String>> {
    let Painted { colors, strokes, .. } = &result.shown;
    if let Format::Look = format {
        let look = Look::new(scene, colors, result.made_from()).with_strokes(scene, strokes);
        write_look(path, &look)?;
        return Ok(Vec::new());
    }
    let colors = result.shown.flattened(scene);
    let mut lost = if strokes.seeds.is_empty() { Vec::new() } else { vec![FLATTENED.into()] };
    if let Format::Scene = format {
        scene.set_colors(&colors);
        lost.extend(write_scene_with(path, scene, options)?);
    } else {
        write_colors(path, &colors, scene)?;
    }
    Ok(lost)
}
