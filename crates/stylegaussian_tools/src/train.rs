//! Training one decoder from embedded scenes and paintings.

pub(crate) mod adam;
mod args;
pub(crate) mod average;
pub(crate) mod checkpoint;
mod data;
pub(crate) mod loss_network;
pub(crate) mod network;
pub mod ops;
pub(crate) mod paintings;
mod report;
mod start;
pub(crate) mod step;
mod warm_start;

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::Device;
use glam::UVec2;
use indicatif::{ProgressBar, ProgressStyle};
use stylegaussian::{
    Camera, Decoder, Scene,
    file::{self, Precision},
};
use stylegaussian_encoder::Encoder;

use adam::Adam;
pub use args::TrainArgs;
use average::Average;
use checkpoint::Progress;
use data::TrainingScene;
use loss_network::LossNetwork;
use network::Network;
use paintings::{Paintings, list_images};
use step::{Content, LossWeights, content_layer};

#[cfg(feature = "gpu")]
use crate::cli::compute::Compute;
use crate::{
    cameras::read_cameras,
    cli::Backend,
    encoder::{loss_weights, open_encoder},
    random::Random,
    views::choose_views,
};

/// Steps between two checkpoints.
const CHECKPOINT_STEPS: u32 = 100;

/// Metadata value that tells a decoder's checkpoint from other safetensors files.
const FORMAT: &str = "stylegaussian-training";

/// Adam's learning rate at the warm start, which compares colors and tolerates larger steps than the paper's loss.
const WARM_RATE: f32 = 1e-3;

/// How many other paintings a picture is told from in a step: their statistics are known, so they cost next to nothing.
const N_OTHERS: usize = 24;

/// Set by Ctrl-C; checked between steps.
pub(crate) static INTERRUPTED: AtomicBool = AtomicBool::new(false);

struct Trainer {
    arguments: TrainArgs,
    device: Device,
    encoder: Encoder,
    loss_network: LossNetwork,
    weights: LossWeights,
    scenes: Vec<TrainingScene>,
    paintings: Paintings,
    network: Network,
    adam: Adam,
    average: Average,
    progress: Progress,
}

/// Runs `stylegaussian train`.
///
/// # Errors
/// The message names the file or the option at fault.
pub fn run(arguments: &TrainArgs) -> Result<()> {
    let arguments = &arguments.spelled_out();
    let device = device(arguments.backend)?.autodiff();
    let encoder = open_encoder(arguments.encoder.as_deref())?;
    eprintln!("encoder {} on {}", encoder.id(), encoder.runtime());
    let (training, held_out) = split_paintings(&arguments.styles, arguments.holdout_styles)?;
    let scenes = load_scenes(arguments)?;
    for (path, scene, _) in &scenes {
        if let Some(found) = scene.features.as_ref().and_then(|features| features.encoder.as_ref()) {
            ensure!(
                found == encoder.id(),
                "{}: embedded with {found}, expected {}",
                path.display(),
                encoder.id()
            );
        }
    }
    let mut trainer = Trainer::new(arguments, device, encoder, training, &scenes)?;
    // A second handler in one process (tests) is refused; the first one serves.
    let _ = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed));
    trainer.warm_start()?;
    trainer.refine()?;
    trainer.save()?;
    let decoder = trainer.decoder();
    file::write_decoder(&arguments.output, &decoder, Precision::F16)?;
    report::write_losses(&beside(&arguments.output, "losses.png"), &trainer.progress.losses)?;
    let shown: Vec<(&Scene, &[Camera])> =
        scenes.iter().map(|(_, scene, cameras)| (scene, &cameras[0][..cameras[0].len().min(2)])).collect();
    let sheet = beside(&arguments.output, "sheet.png");
    report::write_contact_sheet(&sheet, &shown, &decoder, &held_out, &trainer.encoder)?;
    eprintln!("wrote {}; contact sheet {}", arguments.output.display(), sheet.display());
    Ok(())
}

/// OUT.decoder.safetensors -> OUT.`suffix`.
pub(crate) fn beside(output: &Path, suffix: &str) -> PathBuf {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.trim_end_matches(".safetensors").trim_end_matches(".decoder");
    output.with_file_name(format!("{stem}.{suffix}"))
}

/// What trains: with the `gpu` feature any adapter where a GPU is asked for, and by itself a real one.
pub(crate) fn device(backend: Backend) -> Result<Device> {
    #[cfg(feature = "gpu")]
    if let Some(adapter) = Compute::open(backend)?.adapter() {
        eprintln!("training on {adapter}");
        return Ok(Device::wgpu(burn::tensor::DeviceKind::DefaultDevice));
    }
    ensure!(
        cfg!(feature = "gpu") || backend != Backend::Gpu,
        "this build cannot train on a GPU: build with `--features gpu`, or use --backend cpu"
    );
    Ok(Device::flex())
}

/// Paintings to train with, and every so many-th kept out.
fn split_paintings(folder: &Path, n_held_out: usize) -> Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let paths = list_images(folder)?;
    ensure!(
        n_held_out < paths.len(),
        "{}: found {} paintings, expected more than the {n_held_out} to hold out",
        folder.display(),
        paths.len()
    );
    let stride = paths.len().checked_div(n_held_out).unwrap_or(usize::MAX);
    let is_held_out = |i: usize| i % stride == stride / 2 && i / stride < n_held_out;
    let (held_out, training): (Vec<_>, Vec<_>) =
        paths.into_iter().enumerate().partition(|(i, _)| is_held_out(*i));
    let without_index = |list: Vec<(usize, PathBuf)>| list.into_iter().map(|(_, path)| path).collect();
    Ok((without_index(training), without_index(held_out)))
}

/// A scene and its cameras, at each size.
type LoadedScene = (PathBuf, Scene, Vec<Vec<Camera>>);

fn load_scenes(arguments: &TrainArgs) -> Result<Vec<LoadedScene>> {
    let sources: Vec<&PathBuf> = arguments.photos.iter().chain(&arguments.cameras).collect();
    ensure!(
        sources.is_empty() || sources.len() == arguments.scenes.len(),
        "found {} sources of cameras for {} scenes, expected one for each",
        sources.len(),
        arguments.scenes.len()
    );
    let load = |(i, path): (usize, &PathBuf)| {
        let loaded = file::read_scene(path)?;
        loaded.warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
        let cameras: Vec<Camera> = match sources.get(i) {
            Some(source) => {
                let all = read_cameras(source)?.cameras;
                let stride = all.len().div_ceil(arguments.views.max(1)).max(1);
                all.into_iter().step_by(stride).map(|posed| posed.camera).collect()
            }
            None => choose_views(&loaded.scene, arguments.views, UVec2::splat(256)),
        };
        let at = |size: &u32| cameras.iter().map(|camera| scaled(camera, *size)).collect();
        let cameras: Vec<Vec<Camera>> = arguments.size.iter().map(at).collect();
        Ok((path.clone(), loaded.scene, cameras))
    };
    arguments.scenes.iter().enumerate().map(load).collect()
}

/// The same view with its longer side `longer_side` pixels long, and no side shorter than 16.
pub(crate) fn scaled(camera: &Camera, longer_side: u32) -> Camera {
    let factor = longer_side as f32 / camera.size.max_element().max(1) as f32;
    camera.resized((camera.size.as_vec2() * factor).round().as_uvec2().max(UVec2::splat(16)))
}

impl Trainer {
    fn new(
        arguments: &TrainArgs,
        device: Device,
        encoder: Encoder,
        paintings: Vec<PathBuf>,
        scenes: &[LoadedScene],
    ) -> Result<Self> {
        let weights_path = loss_weights(arguments.vgg.as_deref(), arguments.encoder.as_deref())?;
        let loss_network = LossNetwork::open(&weights_path, arguments.relu4.as_deref(), &device)?;
        let default_layer = if loss_network.n_layers() == 4 { "relu4_1" } else { "relu3_1" };
        let names = match arguments.content_layers.as_slice() {
            [] => vec![default_layer.to_owned()],
            names => names.to_vec(),
        };
        let content_layers =
            names.iter().map(|name| content_layer(name, &loss_network)).collect::<Result<Vec<_>>>()?;
        eprintln!("content loss at {names:?}, style loss at {} layers", loss_network.n_layers());
        let n_extra = scenes[0].1.features.as_ref().map_or(0, |features| features.n_extra);
        let decoder = start::decoder(arguments, &encoder, n_extra)?;
        let mut training = Vec::new();
        for (path, scene, cameras) in scenes {
            let prepared = TrainingScene::new(scene, cameras, arguments.crop, &decoder);
            let prepared =
                prepared.with_context(|| format!("{}: no features: embed it first", path.display()))?;
            ensure!(
                prepared.views.iter().all(|views| !views.is_empty()),
                "{}: no view shows any of its Gaussians",
                path.display()
            );
            let expected = prepared.features.n_channels() + prepared.features.n_extra;
            ensure!(
                decoder.n_inputs() == expected,
                "{}: has {expected} channels, the decoder takes {}",
                path.display(),
                decoder.n_inputs()
            );
            for (size, views) in arguments.size.iter().zip(&prepared.views) {
                eprintln!(
                    "{}: {} pictures of views of {size} pixels, {} of {} Gaussians in one on average",
                    path.display(),
                    views.len(),
                    views.iter().map(|view| view.output_rows.len()).sum::<usize>() / views.len(),
                    scene.len()
                );
            }
            training.push(prepared);
        }
        let mut network = Network::new(&decoder, &device)?;
        let (mut adam, mut average) = (Adam::new(&network.parameters), Average::new(&network.parameters));
        let progress = match arguments.resume {
            true => {
                let path = checkpoint_path(&arguments.output);
                checkpoint::load(&path, FORMAT, &mut network.parameters, &mut adam, &mut average, &device)?
            }
            false => Progress::default(),
        };
        let weights = LossWeights {
            style: arguments.style_weight,
            range: arguments.range_weight,
            palette: arguments.palette_weight,
            roughness: arguments.roughness_weight,
            recognition: arguments.recognition_weight,
            content_layers,
        };
        Ok(Self {
            arguments: arguments.clone(),
            paintings: Paintings::new(paintings, arguments.seed, arguments.vgg.is_none()),
            scenes: training,
            device,
            encoder,
            loss_network,
            weights,
            network,
            adam,
            average,
            progress,
        })
    }

    fn save(&self) -> Result<()> {
        let path = checkpoint_path(&self.arguments.output);
        checkpoint::save(&path, FORMAT, &self.network.parameters, &self.adam, &self.average, &self.progress)
    }

    /// What there is to show so far.
    fn decoder(&self) -> Decoder {
        self.average.decoder(&self.network)
    }

    /// What Ctrl-C leads to: everything is kept, and the message says how to go on.
    fn stop_if_interrupted(&self) -> Result<()> {
        if INTERRUPTED.load(Ordering::Relaxed) {
            self.save()?;
            file::write_decoder(&self.arguments.output, &self.decoder(), Precision::F16)?;
            bail!(
                "interrupted after {} steps; the decoder so far is written, --resume goes on",
                self.progress.steps
            );
        }
        Ok(())
    }

    fn warm_start(&mut self) -> Result<()> {
        let total = if !self.arguments.init.is_empty() { 0 } else { self.arguments.warm_iterations };
        if self.progress.warm_steps >= total {
            return Ok(());
        }
        let bar = bar(total, "warm start");
        let mut mean_error = f32::NAN;
        while self.progress.warm_steps < total {
            self.stop_if_interrupted()?;
            let done = self.progress.warm_steps;
            let mut random = Random::new(self.arguments.seed ^ (u64::from(done) << 20) ^ 0x5741_524D);
            let scene = &self.scenes[random.below(self.scenes.len())];
            let key = self.paintings.pick(&mut random, &self.encoder, &self.loss_network, &self.device)?;
            let style = self.paintings.style(key);
            let rate = cosine(WARM_RATE, done, total);
            let (network, adam) = (&mut self.network, &mut self.adam);
            let error = warm_start::step(network, adam, scene, style, &mut random, rate, &self.device)?;
            mean_error = if mean_error.is_nan() { error } else { 0.98 * mean_error + 0.02 * error };
            self.progress.warm_steps += 1;
            report_step(&bar, self.progress.warm_steps, &format!("color error {mean_error:.4}"));
            if self.progress.warm_steps.is_multiple_of(CHECKPOINT_STEPS) {
                self.save()?;
            }
        }
        bar.finish();
        // The two losses' gradients differ in scale: Adam's moments start anew.
        self.adam = Adam::new(&self.network.parameters);
        self.save()
    }

    fn refine(&mut self) -> Result<()> {
        let total = self.arguments.iterations;
        let bar = bar(total, "training");
        bar.set_position(u64::from(self.progress.steps));
        let mut contents: HashMap<(usize, usize, usize), Content> = HashMap::new();
        let mut mean = [f32::NAN; 2];
        while self.progress.steps < total {
            self.stop_if_interrupted()?;
            let done = self.progress.steps;
            let mut random = Random::new(self.arguments.seed ^ (u64::from(done) << 20) ^ 0x5354_4550);
            let scene_index = random.below(self.scenes.len());
            // One size takes no choice: the views are drawn as they would be without any other.
            let n_sizes = self.scenes[scene_index].views.len();
            let size_index = if n_sizes > 1 { random.below(n_sizes) } else { 0 };
            let view_index = random.below(self.scenes[scene_index].views[size_index].len());
            let key = self.paintings.pick(&mut random, &self.encoder, &self.loss_network, &self.device)?;
            let style = self.paintings.style(key);
            let n_others = if self.weights.recognition > 0.0 { N_OTHERS } else { 0 };
            let others = self.paintings.others(key, n_others, &mut random);
            let scene = &self.scenes[scene_index];
            let view = &scene.views[size_index][view_index];
            let content = contents
                .entry((scene_index, size_index, view_index))
                .or_insert_with(|| Content::new(view, &self.loss_network, &self.weights, &self.device));
            let rate = cosine(self.arguments.learning_rate, done, total);
            let losses = step::step(
                &mut self.network,
                &mut self.adam,
                scene,
                view,
                content,
                style,
                &others,
                &self.loss_network,
                &self.weights,
                rate,
                &self.device,
            )?;
            self.progress.losses.push(losses);
            self.progress.steps += 1;
            for (mean, loss) in mean.iter_mut().zip(losses) {
                *mean = if mean.is_nan() { loss } else { 0.98 * *mean + 0.02 * loss };
            }
            report_step(&bar, self.progress.steps, &format!("content {:.3} style {:.3}", mean[0], mean[1]));
            if self.progress.steps.is_multiple_of(CHECKPOINT_STEPS) {
                if f64::from(self.progress.steps) > f64::from(total) * (1.0 - self.arguments.average) {
                    self.average.add(&self.network.parameters);
                } else {
                    // What a shorter training that is gone on with has averaged is not the end any more.
                    self.average = Average::new(&self.network.parameters);
                }
                self.save()?;
                file::write_decoder(&self.arguments.output, &self.decoder(), Precision::F16)?;
            }
        }
        bar.finish();
        Ok(())
    }
}

fn checkpoint_path(output: &Path) -> PathBuf {
    beside(output, "checkpoint.safetensors")
}

/// From `rate` to a tenth of it along half a cosine.
fn cosine(rate: f32, done: u32, total: u32) -> f32 {
    let course = 0.5 * (1.0 + (std::f32::consts::PI * done as f32 / total.max(1) as f32).cos());
    rate * (0.1 + 0.9 * course)
}

pub(crate) fn bar(total: u32, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix} {pos}/{len} [{elapsed} < {eta}] {msg} {wide_bar}");
    let bar = ProgressBar::new(u64::from(total)).with_prefix(what);
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

/// Moves the bar; where there is no terminal, a line now and then.
pub(crate) fn report_step(bar: &ProgressBar, done: u32, message: &str) {
    bar.set_position(u64::from(done));
    bar.set_message(message.to_owned());
    if bar.is_hidden() && done.is_multiple_of(CHECKPOINT_STEPS) {
        eprintln!("{} {done}/{} {message}", bar.prefix(), bar.length().unwrap_or(0));
    }
}
