//! The decoder as it is trained: parameters as tensors, the fold inside the differentiable graph.

use std::sync::Arc;

use anyhow::{Result, ensure};
use burn::tensor::{
    Device, Tensor, TensorData,
    activation::{leaky_relu, sigmoid},
};
use stylegaussian::{
    Activation, Decoder, EncoderId, Features, Layer, fold::ChannelMap, statistics::ContentStatistics,
};

use super::args::TrainArgs;
use super::ops::{Windows, windows_conv};
use crate::random::Random;

/// Parameters of a decoder, all tracked: for each layer the weight `[D_out, K * D_in]`, then the bias `[D_out]`;
/// last, where there is one, the weight on the style's statistics `[D_out, 2 D]`.
pub struct Network {
    /// Weight, bias, weight, bias, ..., and perhaps the weight on statistics.
    pub parameters: Vec<Parameter>,
    k: usize,
    activation: Activation,
    residual: f32,
    base_color: bool,
    n_noise: usize,
    smoothing_passes: usize,
    encoder: Option<EncoderId>,
}

/// One tensor of the decoder, flattened to two dimensions.
#[derive(Clone)]
pub struct Parameter {
    /// Values; a bias is `[1, D_out]`.
    pub values: Tensor<2>,
}

/// What a channel map and a scene's basis make of the first layer's inputs.
pub struct FoldedInputs {
    /// diag(g) A `[D, L]`.
    basis: Tensor<2>,
    /// g (A m' + b) + s `[D, 1]`: the mapped features of a Gaussian at the mean.
    center: Tensor<2>,
    /// Mean and deviation of the transferred features `[2 D, 1]`.
    statistics: Tensor<2>,
}

impl FoldedInputs {
    /// From a scene's features, the mean of its f' `[L]`, its content statistics and a channel map.
    pub fn new(
        features: &Features,
        mean_latent: &[f64],
        content: &ContentStatistics,
        map: &ChannelMap,
        device: &Device,
    ) -> Self {
        let (n_channels, n_latent) = (features.n_channels(), features.n_latent);
        let basis: Vec<f32> = features
            .basis
            .iter()
            .enumerate()
            .map(|(i, a)| (map.gain[i / n_latent] * f64::from(*a)) as f32)
            .collect();
        let center = |d: usize| {
            let row = features.basis[d * n_latent..][..n_latent].iter().zip(mean_latent);
            let mean = f64::from(features.offset[d]) + row.map(|(a, m)| f64::from(*a) * m).sum::<f64>();
            (map.gain[d] * mean + map.shift[d]) as f32
        };
        let center: Vec<f32> = (0..n_channels).map(center).collect();
        let statistics: Vec<f32> = map.statistics(content).into_iter().map(|value| value as f32).collect();
        Self {
            statistics: Tensor::from_data(TensorData::new(statistics, [2 * n_channels, 1]), device),
            basis: Tensor::from_data(TensorData::new(basis, [n_channels, n_latent]), device),
            center: Tensor::from_data(TensorData::new(center, [n_channels, 1]), device),
        }
    }
}

impl Network {
    /// A decoder to start from: He-normal weights for the activation, zero biases but for the last, which is mid-gray.
    pub fn random(
        arguments: &TrainArgs,
        n_channels: usize,
        n_extra: usize,
        encoder: Option<EncoderId>,
    ) -> Decoder {
        let TrainArgs { k, activation, base_color, statistics, seed, .. } = *arguments;
        let n_noise = arguments.noise.unwrap_or(0);
        let smoothing_passes = arguments.smooth.unwrap_or(1);
        let residual = arguments.residual.unwrap_or(0.0);
        let n_statistics = if statistics { 2 * n_channels } else { 0 };
        let n_inputs = n_channels + n_extra + n_noise + if base_color { 3 } else { 0 };
        let mut random = Random::new(seed);
        let gain = match activation {
            // A unit-normal input leaves the sigmoid with deviation 0.21.
            Activation::Sigmoid => 1.0 / 0.21,
            Activation::LeakyRelu { slope } => (2.0 / (1.0 + slope * slope)).sqrt(),
        };
        let mut d_in = n_inputs;
        let mut layers = Vec::new();
        for (i, d_out) in Decoder::WIDTHS.into_iter().enumerate() {
            let is_last = i + 1 == Decoder::WIDTHS.len();
            let gain = if is_last {
                0.1
            } else if i == 0 {
                1.0
            } else {
                gain
            };
            let deviation = gain / ((k * d_in) as f32).sqrt();
            let weight: Vec<f32> = (0..d_out * k * d_in).map(|_| deviation * random.normal()).collect();
            let center = |row: &[f32]| match activation {
                Activation::Sigmoid if i > 0 => -0.5 * row.iter().sum::<f32>(),
                _ => 0.0,
            };
            let mut bias: Vec<f32> = weight.chunks_exact(k * d_in).map(center).collect();
            if is_last {
                bias.iter_mut().for_each(|b| *b += 0.5 * (1.0 - residual));
            }
            layers.push(Layer { weight, bias, d_in, d_out });
            d_in = d_out;
        }
        // Nothing is known of statistics at first.
        let statistics_weight = vec![0.0; Decoder::WIDTHS[0] * n_statistics];
        Decoder {
            layers,
            k,
            activation,
            residual,
            base_color,
            n_noise,
            smoothing_passes,
            statistics_weight,
            encoder,
        }
    }

    /// Takes over a decoder's parameters.
    ///
    /// # Errors
    /// A decoder of a kind that is not trained here: one whose output is an offset from the original color.
    pub fn new(decoder: &Decoder, device: &Device) -> Result<Self> {
        let residual = decoder.residual;
        ensure!(
            (0.0..1.0).contains(&residual),
            "a decoder with residual = {residual} cannot be trained further: expected 0 or more, and less than 1"
        );
        let parameter = |values: &[f32], shape: [usize; 2]| Parameter {
            values: Tensor::from_data(TensorData::new(values.to_vec(), shape), device).require_grad(),
        };
        let parameters = decoder.layers.iter().flat_map(|layer| {
            [
                parameter(&layer.weight, [layer.d_out, decoder.k * layer.d_in]),
                parameter(&layer.bias, [1, layer.d_out]),
            ]
        });
        let mut parameters: Vec<Parameter> = parameters.collect();
        if !decoder.statistics_weight.is_empty() {
            let d_out = decoder.layers[0].d_out;
            parameters.push(parameter(
                &decoder.statistics_weight,
                [d_out, decoder.statistics_weight.len() / d_out],
            ));
        }
        Ok(Self {
            parameters,
            k: decoder.k,
            activation: decoder.activation,
            residual,
            base_color: decoder.base_color,
            n_noise: decoder.n_noise,
            smoothing_passes: decoder.smoothing_passes,
            encoder: decoder.encoder.clone(),
        })
    }

    /// The odd one out: layers have a weight and a bias.
    fn statistics_weight(&self) -> Option<&Parameter> {
        self.parameters.last().filter(|_| self.parameters.len() % 2 == 1)
    }

    /// How many sets of windows [`forward`](Self::forward) takes.
    pub fn n_neighborhoods(&self) -> usize {
        self.parameters.len() / 2 + self.smoothing_passes
    }

    /// The decoder as it stands.
    pub fn decoder(&self) -> Decoder {
        let values: Vec<Tensor<2>> =
            self.parameters.iter().map(|parameter| parameter.values.clone()).collect();
        self.decoder_of(&values)
    }

    /// The decoder of this shape with other parameters, in the order of `parameters`.
    pub fn decoder_of(&self, values: &[Tensor<2>]) -> Decoder {
        let layers = values.chunks_exact(2).map(|pair| {
            let [d_out, columns] = pair[0].dims();
            Layer { weight: to_vec(&pair[0]), bias: to_vec(&pair[1]), d_in: columns / self.k, d_out }
        });
        Decoder {
            layers: layers.collect(),
            k: self.k,
            activation: self.activation,
            residual: self.residual,
            base_color: self.base_color,
            n_noise: self.n_noise,
            smoothing_passes: self.smoothing_passes,
            statistics_weight: values.last().filter(|_| values.len() % 2 == 1).map_or(Vec::new(), to_vec),
            encoder: self.encoder.clone(),
        }
    }

    /// Colors `[M, 3]` of centered inputs `[N_0, L + E]` through one set of windows for each layer and each average;
    /// `own_colors` `[M, 3]` are the unstyled ones.
    pub fn forward(
        &self,
        inputs: Tensor<2>,
        own_colors: Tensor<2>,
        folded: &FoldedInputs,
        windows: &[Arc<Windows>],
    ) -> Tensor<2> {
        self.finished(self.decode(inputs, folded, windows), own_colors, windows)
    }

    /// What the layers give, before it is averaged: more rows than there are colors in the end, for those to be means of.
    pub fn decode(&self, inputs: Tensor<2>, folded: &FoldedInputs, windows: &[Arc<Windows>]) -> Tensor<2> {
        let (weight, bias) = self.folded_layer(folded, inputs.dims()[1]);
        let mut x = windows_conv(inputs, weight, bias, &windows[0]);
        for (pair, windows) in self.parameters.chunks_exact(2).skip(1).zip(&windows[1..]) {
            x = match self.activation {
                Activation::Sigmoid => sigmoid(x),
                Activation::LeakyRelu { slope } => leaky_relu(x, f64::from(slope)),
            };
            let d_out = pair[0].values.dims()[0];
            x = windows_conv(x, pair[0].values.clone(), pair[1].values.clone().reshape([d_out]), windows);
        }
        x
    }

    /// Colors `[M, 3]` of what the layers gave and of the Gaussians' own `[M, 3]`.
    pub fn finished(&self, decoded: Tensor<2>, own_colors: Tensor<2>, windows: &[Arc<Windows>]) -> Tensor<2> {
        let averages = &windows[windows.len() - self.smoothing_passes..];
        let averaged = averages.iter().fold(decoded, |colors, windows| of_windows(colors, windows, 0.0));
        averaged + own_colors * self.residual
    }

    /// The share of a color that the layers give: colors of 0..1 are theirs times this, and the own ones' rest.
    pub fn share(&self) -> f32 {
        1.0 - self.residual
    }

    /// Mean squared distance of what the layers gave from the mean of its window: what averaging takes away. `None` where
    /// nothing is averaged.
    pub fn roughness(&self, decoded: Tensor<2>, windows: &[Arc<Windows>]) -> Option<Tensor<1>> {
        let windows = windows[windows.len() - self.smoothing_passes..].first()?;
        Some(of_windows(decoded, windows, 1.0).powi_scalar(2).mean())
    }

    /// The first layer on `n_inputs` = L + E inputs: W_k diag(g) A beside the extra columns, and the bias that the
    /// center makes.
    fn folded_layer(&self, folded: &FoldedInputs, n_inputs: usize) -> (Tensor<2>, Tensor<1>) {
        let [n_channels, n_latent] = folded.basis.dims();
        let n_extra = n_inputs - n_latent;
        let [d_out, _] = self.parameters[0].values.dims();
        let rows = self.parameters[0].values.clone().reshape([d_out * self.k, n_channels + n_extra]);
        let on_features = rows.clone().narrow(1, 0, n_channels);
        let weight = on_features.clone().matmul(folded.basis.clone());
        let weight = match n_extra {
            0 => weight,
            _ => Tensor::cat(vec![weight, rows.narrow(1, n_channels, n_extra)], 1),
        };
        let shift = on_features.matmul(folded.center.clone()).reshape([d_out, self.k]).sum_dim(1);
        let shift = match self.statistics_weight() {
            None => shift,
            Some(weight) => shift + weight.values.clone().matmul(folded.statistics.clone()),
        };
        let bias = shift.reshape([d_out]) + self.parameters[1].values.clone().reshape([d_out]);
        (weight.reshape([d_out, self.k * n_inputs]), bias)
    }
}

/// For each window over colors `[N_in, 3]` its mean, or, with `own` = 1, how far the first of it, the Gaussian itself, is
/// from that mean: own x_p - mean, up to the sign of the mean `[N_out, 3]`.
fn of_windows(colors: Tensor<2>, windows: &Arc<Windows>, own: f32) -> Tensor<2> {
    let device = colors.device();
    let mean = if own > 0.0 { -1.0 } else { 1.0 } / windows.k as f32;
    let weight = |i: usize| {
        let (output, slot, input) = (i / (3 * windows.k), i / 3 % windows.k, i % 3);
        if output == input { mean + if slot == 0 { own } else { 0.0 } } else { 0.0 }
    };
    let weight: Vec<f32> = (0..9 * windows.k).map(weight).collect();
    let weight = Tensor::from_data(TensorData::new(weight, [3, 3 * windows.k]), &device);
    windows_conv(colors, weight, Tensor::zeros([3], &device), windows)
}

/// The values of a tensor, row-major.
pub fn to_vec(tensor: &Tensor<2>) -> Vec<f32> {
    tensor.clone().into_data().try_to_vec().unwrap_or_default()
}
