//! `stylegaussian embed`: a scene file in, the scene with features out.

use std::{
    path::{Path, PathBuf},
    process,
    sync::atomic::{AtomicBool, Ordering},
};

use anyhow::{Result, ensure};
use glam::UVec2;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use stylegaussian::{Decoder, Neighbors, Scene, file};

use super::{EmbedOptions, EmbedReport, Progress, Stage, TrainingView, Watch, embed};
use crate::{
    cameras::{CameraSet, PosedCamera, read_cameras},
    cli::{
        Backend,
        output::{print, warn},
    },
    encoder::open_encoder,
    views::choose_views,
};

/// Views rendered where nothing else is asked for.
const DEFAULT_VIEWS: u32 = 60;

/// Set by the first Ctrl-C.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Give a scene features, once, so that any style can be applied to it at once.
///
/// Learns from photos with known poses, or else from pictures of the scene itself. Ctrl-C finishes early with what there
/// is.
#[derive(Debug, clap::Args)]
pub struct EmbedArgs {
    /// A scene: 3DGS .ply or .sgs.
    scene: PathBuf,
    /// The scene with features: *.sgs.
    #[arg(short, long, value_name = "OUT.sgs")]
    output: PathBuf,
    /// Learn from photos: a folder with transforms.json, a COLMAP model or 3DGS cameras.json, and the photos it names.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["cameras", "views"])]
    photos: Option<PathBuf>,
    /// Learn from pictures of the scene itself, from these cameras: transforms.json, a COLMAP model or 3DGS cameras.json.
    #[arg(long, value_name = "FILE", conflicts_with = "views")]
    cameras: Option<PathBuf>,
    /// Learn from this many pictures of the scene itself, from cameras chosen for it; 60 where nothing is said.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    views: Option<u32>,
    /// Longer side of the pictures, in pixels; photos are never enlarged. Larger pictures give finer features, in time
    /// that grows with their area.
    #[arg(long, value_name = "PX", default_value_t = 512, value_parser = clap::value_parser!(u32).range(32..=4096))]
    size: u32,
    #[command(flatten)]
    options: EmbedOptions,
    /// Leave the neighbor lists out of the file, which every later load then finds anew: 32 bytes fewer per Gaussian.
    #[arg(long)]
    no_neighbors: bool,
    /// The encoder: an ONNX file, or VGG-19 weights as safetensors or torchvision's .pth. Otherwise the one that
    /// STYLEGAUSSIAN_ENCODER names, otherwise the default one.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// What computes; `gpu` never falls back silently.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Written<'a> {
    scene: &'a Path,
    output: &'a Path,
    n_gaussians: usize,
    encoder: String,
    #[serde(flatten)]
    report: &'a EmbedReport,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be read or written, the scene cannot be embedded, or the GPU is asked for.
pub fn run(arguments: &EmbedArgs) -> Result<()> {
    let EmbedArgs { scene: path, output, options, .. } = arguments;
    arguments.backend.expect_cpu("embedding")?;
    let is_sgs = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("sgs"));
    ensure!(
        is_sgs,
        "{}: only .sgs files keep features, expected a name that ends with .sgs",
        output.display()
    );

    let loaded = file::read_scene(path)?;
    let mut scene = loaded.scene;
    warn(&loaded.warnings);
    let encoder = open_encoder(arguments.encoder.as_deref())?;
    let mut views = arguments.training_views(&scene)?;
    if let Some((width, height)) = encoder.input_size() {
        views.iter_mut().for_each(|view| view.camera = view.camera.resized(UVec2::new(width, height)));
    }

    finish_on_interrupt()?;
    let bar = ProgressBar::no_length();
    let progress = |progress| show(&bar, progress);
    let watch = Watch { progress: &progress, interrupted: &INTERRUPTED };
    let report = embed(&mut scene, &views, &encoder, options, watch)?;
    bar.finish_and_clear();
    let find = || Neighbors::find(&scene.means, &scene.order, Decoder::K);
    scene.neighbors = (!arguments.no_neighbors).then(find);
    file::write_scene(output, &scene)?;

    let n_gaussians = scene.len();
    let written =
        Written { scene: path, output, n_gaussians, encoder: encoder.id().to_string(), report: &report };
    print(arguments.json, &written, || summary(&written))
}

impl EmbedArgs {
    fn training_views(&self, scene: &Scene) -> Result<Vec<TrainingView>> {
        if let Some(folder) = &self.photos {
            let view = |posed: PosedCamera| {
                Ok(TrainingView::photo(posed.require_photo()?.into(), &posed.camera, self.size))
            };
            return read(folder)?.cameras.into_iter().map(view).collect();
        }
        ensure!(
            scene.sh.is_some(),
            "{}: the scene has no colors of its own to learn from; name its photos with --photos",
            self.scene.display()
        );
        if let Some(cameras) = &self.cameras {
            let view =
                |posed: PosedCamera| TrainingView::rendered(posed.name.clone(), &posed.camera, self.size);
            return Ok(read(cameras)?.cameras.into_iter().map(view).collect());
        }
        let chosen =
            choose_views(scene, self.views.unwrap_or(DEFAULT_VIEWS) as usize, UVec2::splat(self.size));
        let view = |(i, camera)| TrainingView::rendered(format!("{i:06}"), &camera, self.size);
        Ok(chosen.into_iter().enumerate().map(view).collect())
    }
}

fn read(path: &Path) -> Result<CameraSet> {
    let set = read_cameras(path)?;
    warn(&set.warnings);
    Ok(set)
}

/// The first Ctrl-C finishes with what there is, the second ends at once.
fn finish_on_interrupt() -> Result<()> {
    /// What a shell reports for a program ended by Ctrl-C.
    const EXIT_CODE: i32 = 130;
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            process::exit(EXIT_CODE);
        }
        eprintln!("finishing with what there is; Ctrl-C again ends at once");
    })?;
    Ok(())
}

/// Draws the progress on a terminal.
fn show(bar: &ProgressBar, progress: Progress) {
    let template = match progress.stage {
        Stage::Views => "{bar:40} {pos}/{len} views encoded, {eta} left",
        Stage::Refine => "{bar:40} {pos}/{len} steps, {eta} left",
    };
    if bar.length() != Some(u64::from(progress.total)) || progress.done == 0 {
        bar.reset();
        bar.set_length(u64::from(progress.total));
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
    }
    bar.set_position(u64::from(progress.done));
}

fn summary(Written { output, n_gaussians, report, .. }: &Written) -> String {
    let error = |name: &str, error: Option<f64>| {
        error.map_or(String::new(), |error| format!(", {name} error {error:.4}"))
    };
    format!(
        "{}: {n_gaussians} Gaussians from {} views, {} steps{}{}, {:.1} s for views, {:.1} s for features, {} badly \
         seen{}",
        output.display(),
        report.n_training_views,
        report.iterations,
        error("training", report.training_error),
        error("held-out", report.held_out_error),
        report.view_seconds,
        report.fit_seconds,
        report.n_badly_seen,
        if report.interrupted { ", interrupted" } else { "" },
    )
}
