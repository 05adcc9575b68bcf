//! The decoder as it is trained: parameters as tensors, and the fold inside the differentiable graph.

use std::sync::Arc;

use burn::tensor::{
    Device, Tensor, TensorData,
    activation::{leaky_relu, sigmoid},
};
use stylegaussian::{Activation, Decoder, Features, Layer, fold::ChannelMap, statistics::ContentStatistics};

use crate::{
    error::{TrainError, ensure},
    nn::{
        ops::{Windows, windows_conv},
        parameter::{Parameter, to_vec},
    },
};

/// The Gaussians' neighborhoods at each stage of the decoder.
pub struct Neighborhoods {
    /// One for each layer, from the rows that it takes to the rows that the next one needs.
    pub layers: Vec<Arc<Windows>>,
    /// One for each smoothing pass.
    pub smoothing: Vec<Arc<Windows>>,
}

impl Neighborhoods {
    /// From the neighborhoods of `n_layers` layers, followed by those of the smoothing passes.
    pub fn new(mut layers: Vec<Arc<Windows>>, n_layers: usize) -> Self {
        let smoothing = layers.split_off(n_layers);
        Self { layers, smoothing }
    }
}

/// A decoder whose parameters record gradients.
pub struct Network {
    /// Weight `[D_out, K * D_in]` and bias `[1, D_out]` of each layer; last, if the decoder sees the style's
    /// statistics, the weight on them `[D_out, 2 D]`.
    pub parameters: Vec<Parameter>,
    /// The decoder without its parameters.
    kind: Decoder,
}

/// A channel map and a scene's basis, folded for the first layer.
pub struct FoldedInputs {
    /// diag(g) A `[D, L]`.
    basis: Tensor<2>,
    /// g (A m' + b) + s `[D, 1]`: the mapped features of a Gaussian at the mean.
    center: Tensor<2>,
    /// Mean and deviation of the transferred features `[2 D, 1]`.
    statistics: Tensor<2>,
}

impl FoldedInputs {
    /// Folds a scene's features, the mean of its f' `[L]`, its content statistics and a channel map.
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
            // Products in f64, because gains of nearly constant channels are huge, and f32 only at the end.
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
    /// Takes over a decoder's parameters.
    ///
    /// # Errors
    /// If the decoder adds the base color without leaving a share to its layers, because it then has nothing to
    /// learn.
    pub fn new(decoder: &Decoder, device: &Device) -> Result<Self, TrainError> {
        let residual = decoder.residual;
        ensure!(
            (0.0..1.0).contains(&residual),
            "a decoder with residual = {residual} cannot be trained further: expected 0 or more, \
             and less than 1"
        );
        let parameter = |values: &[f32], shape| Parameter::new(values.to_vec(), shape, device);
        let layers = decoder.layers.iter().flat_map(|layer| {
            [
                parameter(&layer.weight, [layer.d_out, decoder.k * layer.d_in]),
                parameter(&layer.bias, [1, layer.d_out]),
            ]
        });
        let mut parameters: Vec<Parameter> = layers.collect();
        let statistics = &decoder.statistics_weight;
        if !statistics.is_empty() {
            let d_out = decoder.layers[0].d_out;
            parameters.push(parameter(statistics, [d_out, statistics.len() / d_out]));
        }
        let kind = Decoder { layers: Vec::new(), statistics_weight: Vec::new(), ..decoder.clone() };
        Ok(Self { parameters, kind })
    }

    /// The weight on the style's statistics, if the decoder has one: layers have two parameters each, so it is
    /// the odd one.
    fn statistics_weight(&self) -> Option<&Parameter> {
        self.parameters.last().filter(|_| self.parameters.len() % 2 == 1)
    }

    /// Number of layers.
    pub fn n_layers(&self) -> usize {
        self.parameters.len() / 2
    }

    /// Smoothing passes after the layers.
    pub fn smoothing_passes(&self) -> usize {
        self.kind.smoothing_passes
    }

    /// The decoder with other values of its parameters, in the order of `parameters`.
    ///
    /// # Errors
    /// If a tensor cannot be read.
    pub fn decoder(&self, values: &[Tensor<2>]) -> Result<Decoder, TrainError> {
        let layer = |pair: &[Tensor<2>]| {
            let [d_out, columns] = pair[0].dims();
            let (weight, bias) = (to_vec(&pair[0])?, to_vec(&pair[1])?);
            Ok(Layer { weight, bias, d_in: columns / self.kind.k, d_out })
        };
        let statistics_weight = values.last().filter(|_| values.len() % 2 == 1);
        Ok(Decoder {
            layers: values.chunks_exact(2).map(layer).collect::<Result<_, TrainError>>()?,
            statistics_weight: statistics_weight.map(to_vec).transpose()?.unwrap_or_default(),
            ..self.kind.clone()
        })
    }

    /// Colors `[N_out, 3]` that the layers give to centered inputs `[N_0, L + E]`, before smoothing. Smoothing
    /// needs more rows than the picture shows.
    pub fn decode(
        &self,
        inputs: Tensor<2>,
        folded: &FoldedInputs,
        neighborhoods: &Neighborhoods,
    ) -> Tensor<2> {
        let windows = &neighborhoods.layers;
        let (weight, bias) = self.folded_layer(folded, inputs.dims()[1]);
        let mut x = windows_conv(inputs, weight, bias, &windows[0]);
        for (pair, windows) in self.parameters.chunks_exact(2).skip(1).zip(&windows[1..]) {
            x = match self.kind.activation {
                Activation::Sigmoid => sigmoid(x),
                Activation::LeakyRelu { slope } => leaky_relu(x, f64::from(slope)),
            };
            let d_out = pair[0].values.dims()[0];
            x = windows_conv(x, pair[0].values.clone(), pair[1].values.clone().reshape([d_out]), windows);
        }
        x
    }

    /// Final colors `[M, 3]` of decoded colors and base colors `[M, 3]`.
    pub fn finished(
        &self,
        decoded: Tensor<2>,
        base_colors: Tensor<2>,
        neighborhoods: &Neighborhoods,
    ) -> Tensor<2> {
        // The base color is added after smoothing, so its detail stays.
        let passes = neighborhoods.smoothing.iter();
        let smoothed = passes.fold(decoded, |colors, windows| smoothing_pass(colors, windows, 0.0));
        smoothed + base_colors * self.kind.residual
    }

    /// The layers' share of a final color; the base color has the rest.
    pub fn share(&self) -> f32 {
        1.0 - self.kind.residual
    }

    /// Mean squared distance of decoded colors from the mean of their neighborhoods: the part that the first
    /// smoothing pass removes. `None` if there is no smoothing.
    pub fn roughness(&self, decoded: Tensor<2>, neighborhoods: &Neighborhoods) -> Option<Tensor<1>> {
        let windows = neighborhoods.smoothing.first()?;
        Some(smoothing_pass(decoded, windows, 1.0).powi_scalar(2).mean())
    }

    /// The first layer on `n_inputs` = L + E inputs: W_k diag(g) A beside the extra columns, and the bias with
    /// the center's part.
    fn folded_layer(&self, folded: &FoldedInputs, n_inputs: usize) -> (Tensor<2>, Tensor<1>) {
        let [n_channels, n_latent] = folded.basis.dims();
        let n_extra = n_inputs - n_latent;
        let [d_out, _] = self.parameters[0].values.dims();
        let rows = self.parameters[0].values.clone().reshape([d_out * self.kind.k, n_channels + n_extra]);
        let on_features = rows.clone().narrow(1, 0, n_channels);
        let weight = on_features.clone().matmul(folded.basis.clone());
        let weight = match n_extra {
            0 => weight,
            _ => Tensor::cat(vec![weight, rows.narrow(1, n_channels, n_extra)], 1),
        };
        // The center is one number per channel for all K neighbors, so their parts add up to a bias.
        let shift = on_features.matmul(folded.center.clone()).reshape([d_out, self.kind.k]).sum_dim(1);
        let shift = match self.statistics_weight() {
            None => shift,
            Some(weight) => shift + weight.values.clone().matmul(folded.statistics.clone()),
        };
        let bias = shift.reshape([d_out]) + self.parameters[1].values.clone().reshape([d_out]);
        (weight.reshape([d_out, self.kind.k * n_inputs]), bias)
    }
}

/// The mean of colors `[N_in, 3]` over each neighborhood `[N_out, 3]`; or, with `own` = 1, the difference
/// between the color of the Gaussian itself, the first of its neighborhood, and that mean.
fn smoothing_pass(colors: Tensor<2>, windows: &Arc<Windows>, own: f32) -> Tensor<2> {
    let device = colors.device();
    // A convolution with fixed weights: the custom operation and its gradient serve smoothing too, on any
    // backend.
    let mean = if own > 0.0 { -1.0 } else { 1.0 } / windows.k as f32;
    let weight = |i: usize| {
        // The inverse of ((output K) + neighbor) 3 + input, the order of a convolution's weight.
        let (output, neighbor, input) = (i / (3 * windows.k), i / 3 % windows.k, i % 3);
        // Channels do not mix.
        if output == input { mean + if neighbor == 0 { own } else { 0.0 } } else { 0.0 }
    };
    let weight: Vec<f32> = (0..9 * windows.k).map(weight).collect();
    let weight = Tensor::from_data(TensorData::new(weight, [3, 3 * windows.k]), &device);
    windows_conv(colors, weight, Tensor::zeros([3], &device), windows)
}
