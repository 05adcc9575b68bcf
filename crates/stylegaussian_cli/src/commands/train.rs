//! What `stylegaussian train` is told.

use std::path::PathBuf;

use clap::Args;
use stylegaussian::Activation;

use crate::cli::{Backend, WeightedPath};

/// Train one decoder from embedded scenes and a folder of paintings.
///
/// First a warm start (regression on the scene recolored to each painting's mean color and covariance), then the paper's
/// loss: content at relu4_1, channel means and deviations at relu1_1 to relu4_1. Progress is kept in
/// OUT.checkpoint.safetensors; Ctrl-C saves and ends.
#[derive(Args, Clone, Debug)]
pub struct TrainArgs {
    /// Embedded scenes (.sgs).
    #[arg(required = true, value_name = "SCENE")]
    pub scenes: Vec<PathBuf>,
    /// A folder of paintings (.jpg, .png).
    #[arg(long, value_name = "DIR")]
    pub styles: PathBuf,
    /// The decoder to write, *.decoder.safetensors.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Photos with poses, one folder for each scene: their cameras are trained on.
    #[arg(long, value_name = "DIR", conflicts_with = "cameras")]
    pub photos: Vec<PathBuf>,
    /// Cameras, one file for each scene.
    #[arg(long, value_name = "FILE")]
    pub cameras: Vec<PathBuf>,
    /// Views of each scene, chosen to suit it, where neither photos nor cameras are named.
    #[arg(long, value_name = "N", default_value_t = 24)]
    pub views: usize,
    /// Longer side of a training view, in pixels; several, separated by commas, are trained on in turn, so that the decoder
    /// learns how a style looks from near and from far.
    #[arg(long, value_name = "PX", value_delimiter = ',', default_value = "256", value_parser = clap::value_parser!(u32).range(32..=4096))]
    pub size: Vec<u32>,
    /// Larger views are cut into overlapping crops of at most this many pixels on a side: a step then sees fewer
    /// Gaussians from nearer.
    #[arg(long, value_name = "PX", default_value_t = 256, value_parser = clap::value_parser!(u32).range(32..=2048))]
    pub crop: u32,
    /// A decoder to start from; it gives window, activation and widths. Named several times, the weighted mean of their
    /// parameters: what lies between two states of one training may be better than either.
    #[arg(long, value_name = "DECODER[:WEIGHT]")]
    pub init: Vec<WeightedPath>,
    /// The paper's decoder and recipe: sigmoids; no noise, own color, statistics or average over windows; no warm start, no
    /// average over steps. A scene embedded by `embed --method optimize` goes with it.
    #[arg(long, conflicts_with_all = [
        "init", "activation", "noise", "base_color", "statistics", "smooth", "residual",
        "warm_iterations", "average",
    ])]
    pub paper: bool,
    /// Steps with the paper's loss.
    #[arg(long, value_name = "N", default_value_t = 3000)]
    pub iterations: u32,
    /// Factor of the style loss.
    #[arg(long, value_name = "W", default_value_t = 10.0)]
    pub style_weight: f32,
    /// Factor of a penalty on colors outside 0..1; the paper has none.
    #[arg(long, value_name = "W", default_value_t = 0.0)]
    pub range_weight: f32,
    /// Factor of the mean distance of colors, over squares of 16 pixels, from the recolored scene's: keeps the palette
    /// that the warm start has learned; the paper has none.
    #[arg(long, value_name = "W", default_value_t = 0.0)]
    pub palette_weight: f32,
    /// Factor of the mean squared distance of a Gaussian's decoded color from its neighbors', for decoders that average
    /// colors: strokes and not grain; the paper has none.
    #[arg(long, value_name = "W", default_value_t = 0.0)]
    pub roughness_weight: f32,
    /// Factor of the cross-entropy of telling the picture's own painting among others by their style errors: what is like
    /// several paintings should become like its own; the paper has none.
    #[arg(long, value_name = "W", default_value_t = 0.0)]
    pub recognition_weight: f32,
    /// Layers the content loss compares: relu4_1 as the original implementation, or
    /// relu1_1,relu2_1,relu3_1,relu4_1 as the paper's text. relu3_1 where no weights reach relu4_1.
    #[arg(long, value_name = "LAYERS", value_delimiter = ',')]
    pub content_layers: Vec<String>,
    /// Weights that stand in for VGG-19 at relu4_1, where the loss's end at relu3_1.
    #[arg(long, value_name = "FILE")]
    pub relu4: Option<PathBuf>,
    /// Steps of the warm start, which teaches the decoder to recolor; none where `--init` names a decoder.
    #[arg(long, value_name = "N", default_value_t = 2000)]
    pub warm_iterations: u32,
    /// Adam's learning rate at the first step with the paper's loss; it falls to a tenth along a cosine.
    #[arg(long, value_name = "RATE", default_value_t = 1e-3)]
    pub learning_rate: f32,
    /// The decoder written is the mean over this share of the steps, the last ones, a look every 100 steps; 0 takes the
    /// last step alone, as the paper.
    #[arg(long, value_name = "SHARE", default_value_t = 0.4, value_parser = share)]
    pub average: f64,
    /// `sigmoid` (the paper's) or `leaky_relu:SLOPE`, for a decoder that starts from random weights.
    #[arg(long, value_name = "A", default_value = "leaky_relu:0.2")]
    pub activation: Activation,
    /// Channels of noise that the decoder sees: grain is made of it, for decoders that do not average colors. Otherwise as
    /// many as `--init`'s sees, or none; of more than N, the last are forgotten.
    #[arg(long, value_name = "N", value_parser = at_most_64::<0>)]
    pub noise: Option<usize>,
    /// How many times decoded colors are averaged over each Gaussian's window in the end, so that views agree. Otherwise as
    /// `--init`'s decoder, or once; the paper's decoder does not.
    #[arg(long, value_name = "N", value_parser = at_most_64::<0>)]
    pub smooth: Option<usize>,
    /// The unstyled scene's share of the colors, at least 0 and less than 1: the decoder's is what is left. Otherwise as
    /// `--init`'s decoder, or 0, as the paper's.
    #[arg(long, value_name = "SHARE", value_parser = less_than_1)]
    pub residual: Option<f32>,
    /// Whether a decoder that starts from random weights also sees each Gaussian's own color, which keeps fine detail;
    /// the paper's does not.
    #[arg(long, alias = "own-color", value_name = "BOOL", default_value_t = true, action = clap::ArgAction::Set)]
    pub base_color: bool,
    /// Whether a decoder that starts from random weights also sees the mean and deviation of all transferred features;
    /// the paper's sees those of its window alone.
    #[arg(long, value_name = "BOOL", default_value_t = true, action = clap::ArgAction::Set)]
    pub statistics: bool,
    /// K, the window of a decoder that starts from random weights.
    #[arg(short, long, value_name = "K", default_value = "8", value_parser = at_most_64::<1>)]
    pub k: usize,
    /// Paintings kept out of training, spread over the folder, and shown on the contact sheet at the end.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub holdout_styles: usize,
    /// Random seed.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub seed: u64,
    /// Goes on from OUT.checkpoint.safetensors.
    #[arg(long)]
    pub resume: bool,
    /// The encoder that the scenes were embedded with: an ONNX file, or VGG-19 weights. Otherwise the one that
    /// STYLEGAUSSIAN_ENCODER names, otherwise the default one.
    #[arg(long, value_name = "FILE")]
    pub encoder: Option<PathBuf>,
    /// VGG-19 weights (safetensors) for the loss, where the encoder is something else.
    #[arg(long, value_name = "FILE")]
    pub vgg: Option<PathBuf>,
    /// What computes: `gpu` needs a build with the `gpu` feature and never falls back silently.
    #[arg(long, value_enum, default_value = "auto")]
    pub backend: Backend,
}

impl TrainArgs {
    /// With what [`paper`](Self::paper) stands for spelled out.
    pub fn spelled_out(&self) -> Self {
        if !self.paper {
            return self.clone();
        }
        Self {
            activation: Activation::Sigmoid,
            noise: Some(0),
            base_color: false,
            statistics: false,
            smooth: Some(0),
            residual: Some(0.0),
            warm_iterations: 0,
            average: 0.0,
            ..self.clone()
        }
    }
}

/// A number from `MIN` to 64: no decoder of this shape needs more.
fn at_most_64<const MIN: usize>(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| (MIN..=64).contains(number));
    number.ok_or_else(|| format!("expected a number from {MIN} to 64"))
}

/// A number from 0 to 1, without 1.
fn less_than_1(text: &str) -> Result<f32, String> {
    let number = text.parse().ok().filter(|number| (0.0..1.0).contains(number));
    number.ok_or_else(|| "expected a number of at least 0 and less than 1".into())
}

/// A number from 0 to 1.
fn share(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| (0.0..=1.0).contains(number));
    number.ok_or_else(|| "expected a number from 0 to 1".into())
}
