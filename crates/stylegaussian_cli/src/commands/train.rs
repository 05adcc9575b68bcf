//! `stylegaussian train`: trains a decoder.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use glam::UVec2;
use stylegaussian::{Activation, Camera, Scene, views::choose_views};
use stylegaussian_files::{Precision, write_decoder};
use stylegaussian_train::{
    Watch,
    cameras::{CameraOptions, CameraSet, read_cameras_with},
    decoder::{
        DecoderChanges, LossWeights, NewDecoder, Paintings, Start, TrainConfig, Trainer, TrainingScene,
        mean_decoder, write_contact_sheet, write_losses,
    },
    images::{hold_out, list_images},
    nn::LossNetwork,
};

use crate::{
    arguments::{Backend, FRACTIONS, WeightedPath, beside, less_than_1, within},
    choose::{expect_seen, loss_weights, open_encoder},
    compute::processor,
    outputs::expect_files,
    scenes::ReadArgs,
    terminal::{Interrupt, ProgressLine, note, warn, warn_of_unnamed},
};

/// Train one decoder from embedded scenes and a folder of paintings.
///
/// A new decoder starts with a warm start: it learns to recolor the scene to each painting's mean color and
/// covariance. Then it learns with the paper's loss: content at relu4_1, channel means and deviations at
/// relu1_1 to relu4_1. The state is kept in OUT.checkpoint.safetensors. Ctrl-C saves it and stops.
#[derive(Args, Debug)]
pub struct TrainArgs {
    /// Embedded scenes (.sgs).
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    reading: ReadArgs,
    /// A folder of paintings (.jpg, .png and the like).
    #[arg(long, value_name = "DIR")]
    styles: PathBuf,
    /// The decoder to write, *.decoder.safetensors.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Folders of photos with poses, one for each scene. Training uses their cameras.
    #[arg(long, value_name = "DIR", conflicts_with = "cameras")]
    photos: Vec<PathBuf>,
    /// Camera files, one for each scene.
    #[arg(long, value_name = "FILE")]
    cameras: Vec<PathBuf>,
    /// Number of views of each scene. If neither photos nor cameras are given, they are chosen to suit the
    /// scene.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 24,
        value_parser = clap::value_parser!(u32).range(1..=10_000),
    )]
    views: u32,
    /// Longer side of a training view, in pixels. With several sizes, separated by commas, the decoder learns
    /// how a style looks from near and from far.
    #[arg(
        long,
        value_name = "PX",
        value_delimiter = ',',
        default_value = "256",
        value_parser = clap::value_parser!(u32).range(32..=4096),
    )]
    size: Vec<u32>,
    /// Cut larger views into overlapping crops of at most this many pixels on a side. A step then sees fewer
    /// Gaussians from nearer.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = TrainConfig::default().crop,
        value_parser = clap::value_parser!(u32).range(32..=2048),
    )]
    crop: u32,
    /// A decoder to start from, with its neighborhood, activation and widths. Several give the weighted mean of
    /// their parameters: a decoder between two states of one training can be better than both.
    #[arg(long, value_name = "DECODER[:WEIGHT]")]
    init: Vec<WeightedPath>,
    /// The paper's decoder and recipe: sigmoids; no noise, base color, statistics or smoothing; no warm start
    /// and no average over steps. Use it with scenes from `embed --method optimize`.
    #[arg(long, conflicts_with_all = [
        "init", "activation", "noise", "base_color", "statistics", "smoothing", "residual",
        "warm_iterations", "average",
    ])]
    paper: bool,
    /// Steps with the paper's loss.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().iterations)]
    iterations: u32,
    /// Factor of the style loss.
    #[arg(long, value_name = "W", default_value_t = LossWeights::default().style)]
    style_weight: f32,
    /// Factor of a penalty on colors outside 0..1. Not in the paper.
    #[arg(long, value_name = "W", default_value_t = LossWeights::default().range)]
    range_weight: f32,
    /// Factor of the color-transfer loss: the mean distance of colors, over squares of 16 pixels, from the
    /// recolored scene's. It keeps the palette that the warm start has learned. Not in the paper.
    #[arg(long, value_name = "W", default_value_t = LossWeights::default().color_transfer)]
    color_transfer_weight: f32,
    /// Factor of a penalty on the mean squared distance of a Gaussian's decoded color from its neighbors', for
    /// decoders with smoothing. It favors strokes over grain. Not in the paper.
    #[arg(long, value_name = "W", default_value_t = LossWeights::default().roughness)]
    roughness_weight: f32,
    /// Factor of the contrastive loss: the cross-entropy of matching the picture to its own painting among
    /// others. It makes styles more distinct. Not in the paper.
    #[arg(long, value_name = "W", default_value_t = LossWeights::default().contrastive)]
    contrastive_weight: f32,
    /// Layers that the content loss compares: relu4_1 as in the original implementation, or
    /// relu1_1,relu2_1,relu3_1,relu4_1 as in the paper's text. Default: relu4_1, or relu3_1 if no weights reach
    /// relu4_1.
    #[arg(long, value_name = "LAYERS", value_delimiter = ',')]
    content_layers: Vec<String>,
    /// Weights that replace VGG-19 at relu4_1 if the loss network ends at relu3_1.
    #[arg(long, value_name = "FILE")]
    relu4: Option<PathBuf>,
    /// Steps of the warm start. None are taken if `--init` names a decoder.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().warm_iterations)]
    warm_iterations: u32,
    /// Adam's learning rate at the first step with the paper's loss. It falls to a tenth along a cosine.
    #[arg(long, value_name = "RATE", default_value_t = TrainConfig::default().learning_rate)]
    learning_rate: f32,
    /// Average the weights over the last SHARE of the steps, sampled every 100 steps. 0 uses the final weights
    /// (as in the paper).
    #[arg(
        long,
        value_name = "SHARE",
        default_value_t = TrainConfig::default().average,
        value_parser = within(FRACTIONS),
    )]
    average: f64,
    /// Activation of a new decoder: `sigmoid` (as in the paper) or `leaky_relu:SLOPE`.
    #[arg(long, value_name = "A", default_value_t = NewDecoder::default().activation)]
    activation: Activation,
    /// Number of noise inputs. Default: as in `--init`, else 0. Fewer than `--init` has drops the last ones.
    #[arg(long, value_name = "N", value_parser = within(0..=64_usize))]
    noise: Option<usize>,
    /// Smoothing passes over the decoded colors, which make views agree. Default: as in `--init`, else 1. The
    /// paper has none.
    #[arg(long, value_name = "N", value_parser = within(0..=64_usize))]
    smoothing: Option<usize>,
    /// Share of the base color in the final color, at least 0 and less than 1. The decoder gives the rest.
    /// Default: as in `--init`, else 0 (as in the paper).
    #[arg(long, value_name = "SHARE", value_parser = less_than_1)]
    residual: Option<f32>,
    /// Whether a new decoder sees each Gaussian's base color, which keeps fine detail. Not in the paper.
    #[arg(
        long,
        value_name = "BOOL",
        default_value_t = NewDecoder::default().base_color,
        action = clap::ArgAction::Set,
    )]
    base_color: bool,
    /// Whether a new decoder sees the mean and deviation of all transferred features. The paper's sees only
    /// those of its neighborhood.
    #[arg(
        long,
        value_name = "BOOL",
        default_value_t = NewDecoder::default().statistics,
        action = clap::ArgAction::Set,
    )]
    statistics: bool,
    /// K, the size of a new decoder's neighborhoods.
    #[arg(
        short,
        long,
        value_name = "K",
        default_value_t = NewDecoder::default().k,
        value_parser = within(1..=64_usize),
    )]
    k: usize,
    /// Number of paintings held out of training, spread over the folder, and shown on the contact sheet at the
    /// end.
    #[arg(long, value_name = "N", default_value_t = 4)]
    holdout_styles: usize,
    /// Random seed.
    #[arg(long, value_name = "S", default_value_t = TrainConfig::default().seed)]
    seed: u64,
    /// Resume from OUT.checkpoint.safetensors.
    #[arg(long)]
    resume: bool,
    /// The encoder that the scenes were embedded with: a file of `distill`, VGG-19 weights or an ONNX file.
    /// Default: the file in STYLEGAUSSIAN_ENCODER, else the built-in encoder.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// VGG-19 weights (safetensors) for the loss, if the encoder is not VGG-19.
    #[arg(long, value_name = "FILE")]
    vgg: Option<PathBuf>,
    /// Where to train. `gpu` needs a build with the `gpu` feature; if there is no GPU, the command fails.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
}

/// A scene and the cameras that it is seen from.
struct Loaded {
    name: String,
    scene: Scene,
    cameras: Vec<Camera>,
}

/// Runs the command.
///
/// # Errors
/// The message names the file or the option at fault.
pub fn run(arguments: &TrainArgs, interrupt: &Interrupt) -> Result<()> {
    let TrainArgs { output, styles, encoder, vgg, .. } = arguments;
    let [checkpoint, losses, sheet] =
        ["checkpoint.safetensors", "losses.png", "sheet.png"].map(|suffix| beside(output, suffix));
    expect_files([&**output, &*checkpoint, &*losses, &*sheet])?;
    let processor = processor(arguments.backend)?;
    let config = arguments.config()?;
    let encoder_file = encoder.as_deref();
    let encoder = open_encoder(encoder_file)?;
    note(format!("encoder {} on {}", encoder.id(), encoder.runtime()));
    let (training, held_out) = hold_out(list_images(styles)?, arguments.holdout_styles)
        .with_context(|| styles.display().to_string())?;
    let loaded = arguments.load_scenes()?;
    let scenes: Vec<TrainingScene> = loaded
        .iter()
        .map(|Loaded { name, scene, cameras }| TrainingScene::new(name, scene, cameras, &arguments.size))
        .collect();
    let loss_network = LossNetwork::open(
        &loss_weights(vgg.as_deref(), encoder_file)?,
        arguments.relu4.as_deref(),
        processor,
    )?;
    note(format!("style loss at {} layers", loss_network.n_layers()));
    let mut paintings = Paintings::new(training, &encoder, loss_network);
    // Then the loss network's weights are the encoder's.
    if vgg.is_none() {
        paintings = paintings.with_encoder_in_loss();
    }
    let mut trainer = Trainer::new(config, &scenes, paintings)?;
    for count in trainer.view_counts() {
        note(format!(
            "{}: {} pictures of views of {} pixels, {} of {} Gaussians in one on average",
            count.scene, count.n_pictures, count.size, count.n_gaussians_in_picture, count.n_gaussians
        ));
    }
    if arguments.resume {
        warn_of_unnamed(&checkpoint, &trainer.resume(&checkpoint)?);
    }

    let progress = ProgressLine::new();
    let watch = Watch { progress: &|now| progress.show(now), interrupted: interrupt.watch() };
    // The decoder is written with every checkpoint, so it can be tried while training goes on.
    let is_complete = trainer.run(watch, |trainer| -> Result<()> {
        trainer.save(&checkpoint)?;
        Ok(write_decoder(output, &trainer.decoder()?, Precision::F16)?)
    })?;
    progress.finish();
    if !is_complete {
        bail!(
            "interrupted after {} steps; the decoder so far is written, --resume continues",
            trainer.steps()
        );
    }
    write_losses(&losses, trainer.losses())?;
    let shown: Vec<(&Scene, &[Camera])> =
        scenes.iter().map(|scene| (scene.scene, shown_views(scene))).collect();
    write_contact_sheet(&sheet, &shown, &trainer.decoder()?, &held_out, &encoder)?;
    note(format!("wrote {}; contact sheet {}", output.display(), sheet.display()));
    Ok(())
}

/// The views of a scene on the contact sheet: two of the first size.
fn shown_views<'a>(scene: &'a TrainingScene) -> &'a [Camera] {
    let cameras = scene.views.first().map_or(&[][..], |(_, cameras)| cameras);
    &cameras[..cameras.len().min(2)]
}

impl TrainArgs {
    fn config(&self) -> Result<TrainConfig> {
        let recipe = if self.paper {
            let start = Start::New(NewDecoder { k: self.k, ..NewDecoder::paper() });
            TrainConfig { start, ..TrainConfig::paper() }
        } else {
            let (warm_iterations, average) = (self.warm_iterations, self.average);
            TrainConfig { start: self.start()?, warm_iterations, average, ..TrainConfig::default() }
        };
        Ok(TrainConfig {
            iterations: self.iterations,
            learning_rate: self.learning_rate,
            weights: LossWeights {
                style: self.style_weight,
                range: self.range_weight,
                color_transfer: self.color_transfer_weight,
                roughness: self.roughness_weight,
                contrastive: self.contrastive_weight,
            },
            content_layers: self.content_layers.clone(),
            crop: self.crop,
            seed: self.seed,
            ..recipe
        })
    }

    /// A new decoder, or the mean of those that `--init` names, with the changes that other flags ask for.
    fn start(&self) -> Result<Start> {
        let new = NewDecoder::default();
        let Some(first) = self.init.first() else {
            return Ok(Start::New(NewDecoder {
                k: self.k,
                activation: self.activation,
                n_noise: self.noise.unwrap_or(new.n_noise),
                smoothing_passes: self.smoothing.unwrap_or(new.smoothing_passes),
                residual: self.residual.unwrap_or(new.residual),
                base_color: self.base_color,
                statistics: self.statistics,
            }));
        };
        let files: Vec<_> = self.init.iter().map(|file| (file.path.clone(), file.weight)).collect();
        let mut decoder = mean_decoder(&files)?;
        let changes =
            DecoderChanges { smoothing_passes: self.smoothing, residual: self.residual, n_noise: self.noise };
        changes.apply(&mut decoder, &first.path.display().to_string())?;
        Ok(Start::From(Box::new(decoder)))
    }

    fn load_scenes(&self) -> Result<Vec<Loaded>> {
        let sources: Vec<&PathBuf> = self.photos.iter().chain(&self.cameras).collect();
        ensure!(
            sources.is_empty() || sources.len() == self.scenes.len(),
            "found {} sources of cameras for {} scenes, expected one for each",
            sources.len(),
            self.scenes.len()
        );
        let load = |(i, path): (usize, &PathBuf)| {
            let loaded = self.reading.read(path)?;
            let cameras: Vec<Camera> = match sources.get(i) {
                Some(source) => {
                    let options = CameraOptions { offset: loaded.scene.offset, ..CameraOptions::default() };
                    let CameraSet { cameras: all, warnings } = read_cameras_with(source, options)?;
                    warn(&warnings);
                    // Rounded up, so never more than `views`, and perhaps fewer.
                    let stride = all.len().div_ceil(self.views as usize).max(1);
                    all.into_iter()
                        .step_by(stride)
                        .map(|posed| posed.camera.near_among(&loaded.scene.means))
                        .collect()
                }
                // Any square does: each training size scales the cameras again.
                None => {
                    let chosen = choose_views(&loaded.scene, self.views as usize, UVec2::splat(256));
                    expect_seen(chosen, &loaded.scene, path)?
                }
            };
            Ok(Loaded { name: path.display().to_string(), scene: loaded.scene, cameras })
        };
        self.scenes.iter().enumerate().map(load).collect()
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        train: TrainArgs,
    }

    fn config(more: &[&str]) -> TrainConfig {
        let words = ["train", "a.sgs", "--styles", "d", "-o", "b"];
        Cli::try_parse_from(words.iter().chain(more)).unwrap().train.config().unwrap()
    }

    /// Flags that are not given leave the library's defaults as they are.
    #[test]
    fn the_defaults_are_the_library_s() {
        assert_eq!(format!("{:?}", config(&[])), format!("{:?}", TrainConfig::default()));
        assert_eq!(format!("{:?}", config(&["--paper"])), format!("{:?}", TrainConfig::paper()));
    }
}
