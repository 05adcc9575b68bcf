//! Settings of a decoder training.

use stylegaussian::{Activation, Decoder};

/// Settings of a decoder training. The defaults are those of the command line.
#[derive(Clone, Debug)]
pub struct TrainConfig {
    /// The decoder to start from.
    pub start: Start,
    /// Steps of the warm start. Decoders that are trained further take none.
    pub warm_iterations: u32,
    /// Steps with the paper's loss. The learning rate falls over this many.
    pub iterations: u32,
    /// Adam's learning rate at the first step with the paper's loss. It falls to a tenth along a cosine.
    pub learning_rate: f32,
    /// The share of the steps, the last ones, over which parameters are averaged. If 0, the final parameters
    /// are used.
    pub average: f64,
    /// Factors of the losses.
    pub weights: LossWeights,
    /// Names of the layers that the content loss compares. If empty, the deepest layer that the loss network
    /// has.
    pub content_layers: Vec<String>,
    /// Longest side of a training picture, in pixels. Larger views are cut into overlapping crops.
    pub crop: u32,
    /// Random seed.
    pub seed: u64,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            start: Start::default(),
            warm_iterations: 2000,
            iterations: 3000,
            learning_rate: 1e-3,
            average: 0.4,
            weights: LossWeights::default(),
            content_layers: Vec::new(),
            crop: 256,
            seed: 0,
        }
    }
}

impl TrainConfig {
    /// The paper's recipe: its decoder from random weights, no warm start and no averaging of parameters.
    pub fn paper() -> Self {
        Self { start: Start::New(NewDecoder::paper()), warm_iterations: 0, average: 0.0, ..Self::default() }
    }

    /// Steps of the warm start that this training takes.
    pub(crate) fn warm_steps(&self) -> u32 {
        match self.start {
            Start::New(_) => self.warm_iterations,
            Start::From(_) => 0,
        }
    }
}

/// The decoder that a training starts from.
#[derive(Clone, Debug)]
pub enum Start {
    /// A new decoder with random weights.
    New(NewDecoder),
    /// A trained decoder, without a warm start.
    From(Box<Decoder>),
}

impl Default for Start {
    fn default() -> Self {
        Self::New(NewDecoder::default())
    }
}

/// The kind of a new decoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewDecoder {
    /// K, the size of a neighborhood.
    pub k: usize,
    /// The activation between layers.
    pub activation: Activation,
    /// Number of noise inputs.
    pub n_noise: usize,
    /// Smoothing passes over the decoded colors. They make views agree; the paper's decoder has none.
    pub smoothing_passes: usize,
    /// The share of the base color in the final color, at least 0 and less than 1.
    pub residual: f32,
    /// Whether the base color is an input, which keeps fine detail.
    pub base_color: bool,
    /// Whether the mean and deviation of all transferred features are inputs.
    pub statistics: bool,
}

impl Default for NewDecoder {
    fn default() -> Self {
        Self {
            k: Decoder::K,
            activation: Activation::LeakyRelu { slope: 0.2 },
            n_noise: 0,
            smoothing_passes: 1,
            residual: 0.0,
            base_color: true,
            statistics: true,
        }
    }
}

impl NewDecoder {
    /// The paper's decoder: sigmoids; no noise, base color, statistics or smoothing.
    pub fn paper() -> Self {
        Self {
            activation: Activation::Sigmoid,
            smoothing_passes: 0,
            base_color: false,
            statistics: false,
            ..Self::default()
        }
    }
}

/// Factors of the losses. The paper has content and style alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Factor of the style loss.
    pub style: f32,
    /// Factor of the range loss: colors outside 0..1, which no display shows.
    pub range: f32,
    /// Factor of the color-transfer loss: the distance from the recolored scene's colors, averaged over squares
    /// of 16 pixels.
    pub color_transfer: f32,
    /// Factor of the roughness loss: the mean squared distance of a Gaussian's decoded color from the mean of
    /// its neighborhood.
    pub roughness: f32,
    /// Factor of the contrastive loss: the cross-entropy of matching the picture to its own painting among
    /// others.
    pub contrastive: f32,
}

impl Default for LossWeights {
    /// The paper's factors: 10 for the style, and 0 for losses that the paper does not have.
    fn default() -> Self {
        Self { style: 10.0, range: 0.0, color_transfer: 0.0, roughness: 0.0, contrastive: 0.0 }
    }
}
