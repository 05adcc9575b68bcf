//! The decoder: a CNN whose window is each Gaussian's K nearest neighbors.

mod activation;
mod knn_conv;
pub mod product;

pub use activation::{Activation, ActivationError};
pub use knn_conv::{
    KnnConvShape, ReverseNeighbors, knn_conv, knn_conv_backward_bias, knn_conv_backward_input,
    knn_conv_backward_weight,
};

use rayon::prelude::*;

use crate::{encoder_id::EncoderId, neighbors::Neighbors};

/// One KNN convolution: y_p = sum_k W_k x_{n(p,k)} + B.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// W `[D_out, K, D_in]`, row-major.
    pub weight: Vec<f32>,
    /// B `[D_out]`.
    pub bias: Vec<f32>,
    /// D_in.
    pub d_in: usize,
    /// D_out.
    pub d_out: usize,
}

/// KNN convolutions with an activation between them, from D + E input channels to RGB.
///
/// The default has no layers, the paper's K and activation, and none of the options that the paper's decoder lacks.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoder {
    /// The layers, first to last.
    pub layers: Vec<Layer>,
    /// K, the window of every layer.
    pub k: usize,
    /// The activation between layers.
    pub activation: Activation,
    /// What the Gaussian's unstyled color (SH 0) is multiplied with before it is added to the output: 0 for the color itself,
    /// 1 for an offset, between them for a share of the unstyled scene.
    pub residual: f32,
    /// How many channels of noise the first layer takes after the scene's features, one number for each Gaussian that is
    /// always the same (see [`noise`](crate::noise)). Features are smooth, paintings are not: strokes are made of it.
    pub n_noise: usize,
    /// Whether the first layer also takes the Gaussian's own, unstyled color (SH 0): three more inputs, the last ones,
    /// [`BASE_COLOR_SCALE`](Self::BASE_COLOR_SCALE) (c - 0.5). Features are blurred over the cells of a feature map; colors
    /// keep the detail.
    pub base_color: bool,
    /// S `[D_out of the first layer, 2 D]`, or empty: S (mean, std) of the transferred features is added to the first
    /// layer's bias, so that every Gaussian knows what the whole picture should look like. It folds: a change of style
    /// costs one more product of a matrix and a vector, and a Gaussian nothing.
    pub statistics_weight: Vec<f32>,
    /// How many times the decoded colors are averaged over each Gaussian's window in the end ([`smoothing_pass`]). What
    /// neighbors do not agree on, views do not agree on either: each blends them with weights of its own.
    pub smoothing_passes: usize,
    /// The encoder its input belongs to; `None` when the file did not say.
    pub encoder: Option<EncoderId>,
}

impl Default for Decoder {
    fn default() -> Self {
        Self {
            layers: Vec::new(),
            k: Self::K,
            activation: Activation::Sigmoid,
            residual: 0.0,
            n_noise: 0,
            base_color: false,
            statistics_weight: Vec::new(),
            smoothing_passes: 0,
            encoder: None,
        }
    }
}

impl Decoder {
    /// K of the paper's decoder and of the default one: each Gaussian and its 7 nearest neighbors.
    pub const K: usize = 8;

    /// The paper's layer widths from D = 256 input channels (plus E extra ones) to RGB.
    pub const WIDTHS: [usize; 5] = [256, 128, 64, 32, 3];

    /// What the own color's distance from mid-gray is multiplied with: colors of a scene deviate by about a quarter, and
    /// the other inputs by about 1.
    pub const BASE_COLOR_SCALE: f32 = 4.0;

    /// How many inputs the first layer takes that no scene file holds: noise and the own color.
    pub fn n_procedural(&self) -> usize {
        self.n_noise.saturating_add(if self.base_color { 3 } else { 0 })
    }

    /// How many neighborhoods a color depends on: the layers', and one more for each average.
    pub fn n_neighborhoods(&self) -> usize {
        self.layers.len() + self.smoothing_passes
    }

    /// D + E, the noise, and 3 more with the own color: the channels the first layer takes; 0 without layers.
    pub fn n_inputs(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.d_in)
    }
}

impl Layer {
    /// The convolution's shape at K neighbors.
    pub fn shape(&self, k: usize) -> KnnConvShape {
        KnnConvShape { k, d_in: self.d_in, d_out: self.d_out }
    }
}

/// Runs layers over x `[N, D_in of the first]`, the activation between them and none after the last; gives
/// `[N, D_out of the last]`. Memory: the two widest consecutive activations, nothing of width K.
///
/// # Panics
/// When the layers do not chain or the neighbors are not N lists.
pub fn run_layers(
    layers: &[&Layer],
    activation: Activation,
    neighbors: &Neighbors,
    mut x: Vec<f32>,
) -> Vec<f32> {
    for (i, layer) in layers.iter().enumerate() {
        let shape = layer.shape(neighbors.k);
        let is_last = i + 1 == layers.len();
        x = knn_conv(shape, &x, &neighbors.indices, &layer.weight, &layer.bias, |y| {
            if !is_last {
                activation.apply(y);
            }
        });
    }
    x
}

/// The mean color of each Gaussian's window `[N]`: the end of a decoder that averages colors, once.
pub fn smoothing_pass(colors: &[[f32; 3]], neighbors: &Neighbors) -> Vec<[f32; 3]> {
    let share = 1.0 / neighbors.k.max(1) as f32;
    let mean = |window: &[u32]| {
        let mut sum = [0.0; 3];
        for &neighbor in window {
            sum.iter_mut().zip(colors[neighbor as usize]).for_each(|(sum, channel)| *sum += channel);
        }
        sum.map(|channel| channel * share)
    };
    neighbors.indices.par_chunks_exact(neighbors.k.max(1)).map(mean).collect()
}
