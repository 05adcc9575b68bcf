//! `stylegaussian embed`: reads a scene and writes it with features.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use glam::UVec2;
use serde::Serialize;
use stylegaussian::{
    Decoder, Neighbors, Scene,
    split::{SplitOptions, split},
    views::choose_views,
};
use stylegaussian_files::write_scene;
use stylegaussian_train::{
    Watch,
    cameras::{CameraOptions, CameraSet, PosedCamera, read_cameras_with},
    embed::{EmbedMethod, EmbedOptions, EmbedReport, TrainingView, embed},
};

use crate::{
    arguments::{Backend, SPLITS, within},
    choose::{FrameArgs, expect_seen, open_encoder},
    outputs::expect_files,
    scenes::{ReadArgs, extension},
    terminal::{Interrupt, ProgressLine, lossy, print, usage_error, warn},
};

/// Most cameras of a capture that its scene keeps, spread over the list: they tell from where it is seen.
const MOST_CAMERAS: usize = 64;

/// Views rendered if neither photos, cameras nor a number is given.
const DEFAULT_VIEWS: u32 = 60;

/// Give a scene features, once, so that any style can be applied to it instantly.
///
/// Learns from photos with known poses, or from pictures of the scene itself. Ctrl-C finishes early with the
/// views and steps done so far.
#[derive(Args, Debug)]
pub struct EmbedArgs {
    /// A scene in any format: `stylegaussian --help` lists them.
    scene: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    /// The scene with features: *.sgs.
    #[arg(short, long, value_name = "OUT.sgs")]
    output: PathBuf,
    /// Learn from photos: a folder with transforms.json, a COLMAP model or 3DGS cameras.json, and the photos it
    /// names. Photos that are missing are left out, if they are at most half. The distortion of lenses is taken
    /// out of them.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["cameras", "views", "frame"])]
    photos: Option<PathBuf>,
    /// Learn from pictures of the scene itself, from these cameras: transforms.json, a COLMAP model or 3DGS
    /// cameras.json.
    #[arg(long, value_name = "FILE", conflicts_with = "views")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    framing: FrameArgs,
    /// Learn from this many pictures of the scene itself, from cameras chosen for it [default: 60].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    views: Option<u32>,
    /// Longer side of the pictures, in pixels. Photos are never enlarged. Larger pictures give finer features;
    /// the time grows with their area.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 512,
        value_parser = clap::value_parser!(u32).range(32..=4096),
    )]
    size: u32,
    /// The method of embedding.
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// Steps of the descent [default: 20 per view with the default method, 2000 with optimize].
    #[arg(long, value_name = "N")]
    iterations: Option<u32>,
    /// Hold every K-th view, including the first, out of training and report the error on those. 0 trains on
    /// all.
    #[arg(long, value_name = "K", default_value_t = EmbedOptions::default().holdout)]
    holdout: u32,
    /// Seed of the starting noise and of the order of views. Equal seeds give equal results.
    #[arg(long, default_value_t = EmbedOptions::default().seed)]
    seed: u64,
    /// Leave the neighbor lists out of the file. It is 32 bytes per Gaussian smaller, and every load computes
    /// them anew.
    #[arg(long)]
    no_neighbors: bool,
    /// Split Gaussians that are larger than a brush stroke first, which makes room for finer strokes: to at
    /// most FACTOR times their number [default: 2 if no FACTOR is given].
    #[arg(long, value_name = "FACTOR", num_args = 0..=1, require_equals = true, default_missing_value = "2",
        value_parser = within(SPLITS))]
    split: Option<f64>,
    /// The encoder: a file of `distill`, VGG-19 weights (safetensors, .pth) or an ONNX file. Default: the file
    /// in STYLEGAUSSIAN_ENCODER, else the built-in encoder.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// Where to compute. Embedding has no GPU backend: `gpu` is an error.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// `--method`.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum Method {
    /// Closed form, then a short descent of the L1 error with falling learning rates.
    #[default]
    Default,
    /// PCA basis and weighted means only: immediate, less exact.
    ClosedForm,
    /// The paper's method: descent from noise, with its learning rates.
    Optimize,
}

/// The JSON output.
#[derive(Serialize)]
struct Written<'a> {
    #[serde(serialize_with = "lossy")]
    scene: &'a Path,
    #[serde(serialize_with = "lossy")]
    output: &'a Path,
    n_gaussians: usize,
    /// Number of Gaussians that splitting added, or `None` if it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    n_split: Option<usize>,
    encoder: String,
    #[serde(flatten)]
    report: &'a EmbedReport,
}

/// Runs the command.
///
/// # Errors
/// If a file cannot be read or written, the scene cannot be embedded, or the GPU is asked for.
pub fn run(arguments: &EmbedArgs, interrupt: &Interrupt) -> Result<()> {
    let EmbedArgs { scene: path, output, .. } = arguments;
    arguments.backend.expect_cpu("embedding")?;
    // Checked before the minutes of work whose result could not be written.
    if extension(output) != "sgs" {
        let message = "only .sgs files keep features, expected extension .sgs";
        return Err(usage_error(format!("{}: {message}", output.display())));
    }
    expect_files([&**output])?;

    let mut scene = arguments.reading.read(path)?.scene;
    let encoder = open_encoder(arguments.encoder.as_deref())?;
    // Before the features, so that parts get features of their own.
    let options = |factor| SplitOptions { factor, ..SplitOptions::default() };
    let n_split = arguments.split.map(|factor| split(&mut scene, options(factor)));
    arguments.framing.tell(&mut scene);
    let mut views = arguments.training_views(&scene)?;
    if arguments.photos.is_some() || arguments.cameras.is_some() {
        let stride = views.len().div_ceil(MOST_CAMERAS).max(1);
        scene.cameras = views.iter().step_by(stride).map(|view| view.camera.clone()).collect();
        views.iter_mut().for_each(|view| view.camera = view.camera.near_among(&scene.means));
    }
    // A graph can accept one size only. The cameras then take its proportions too.
    if let Some((width, height)) = encoder.input_size() {
        views.iter_mut().for_each(|view| view.camera = view.camera.resized(UVec2::new(width, height)));
    }

    let progress = ProgressLine::new();
    let watch = Watch { progress: &|now| progress.show(now), interrupted: interrupt.watch() };
    let report = embed(&mut scene, &views, &encoder, &arguments.options(), watch)?;
    progress.finish();
    warn(&report.warnings);
    // For the decoder. Embedding itself uses longer lists, which are not kept.
    let find = || Neighbors::find(&scene.means, &scene.order, Decoder::K);
    scene.neighbors = (!arguments.no_neighbors).then(find);
    write_scene(output, &scene)?;

    let n_gaussians = scene.len();
    let written = Written {
        scene: path,
        output,
        n_gaussians,
        n_split,
        encoder: encoder.id().to_string(),
        report: &report,
    };
    print(arguments.json, &written, || summary(&written))
}

impl EmbedArgs {
    fn options(&self) -> EmbedOptions {
        let method = match self.method {
            Method::Default => EmbedMethod::Default,
            Method::ClosedForm => EmbedMethod::ClosedForm,
            Method::Optimize => EmbedMethod::Optimize,
        };
        EmbedOptions { method, iterations: self.iterations, holdout: self.holdout, seed: self.seed }
    }

    fn training_views(&self, scene: &Scene) -> Result<Vec<TrainingView>> {
        let options = CameraOptions {
            size: Some(UVec2::splat(self.size)),
            offset: scene.offset,
            undistorts: self.photos.is_some(),
        };
        if let Some(folder) = &self.photos {
            let view = |posed: PosedCamera| {
                let photo = posed.require_photo()?.into();
                Ok(TrainingView::photo(photo, &posed.camera, posed.distortion, self.size))
            };
            // A photo that is missing gives no size, and its camera is left out.
            let set = read_cameras_with(folder, options)?;
            let set = told(set.with_photos()?);
            return set.cameras.into_iter().map(view).collect();
        }
        ensure!(
            scene.sh.is_some(),
            "{}: the scene has no colors of its own to learn from; name its photos with --photos",
            self.scene.display()
        );
        if let Some(cameras) = &self.cameras {
            let view =
                |posed: PosedCamera| TrainingView::rendered(posed.name.clone(), &posed.camera, self.size);
            // Cameras with an angle of view alone see a square.
            let set = told(read_cameras_with(cameras, options)?);
            return Ok(set.cameras.into_iter().map(view).collect());
        }
        let chosen =
            choose_views(scene, self.views.unwrap_or(DEFAULT_VIEWS) as usize, UVec2::splat(self.size));
        let chosen = expect_seen(chosen, scene, &self.scene)?;
        self.framing.warn(scene, &self.scene);
        let view = |(i, camera)| TrainingView::rendered(format!("{i:06}"), &camera, self.size);
        Ok(chosen.into_iter().enumerate().map(view).collect())
    }
}

/// The cameras, after their warnings are printed.
fn told(set: CameraSet) -> CameraSet {
    warn(&set.warnings);
    set
}

fn summary(Written { output, n_gaussians, n_split, report, .. }: &Written) -> String {
    let error = |name: &str, error: Option<f64>| {
        error.map_or(String::new(), |error| format!(", {name} error {error:.4}"))
    };
    format!(
        "{}: {n_gaussians} Gaussians{} from {} views, {} steps{}{}, {:.1} s for views, {:.1} s for features, \
         {} under-observed{}",
        output.display(),
        n_split.map_or(String::new(), |n| format!(" ({n} of them by splitting)")),
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
