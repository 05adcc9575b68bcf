//! VGG-19 in burn, for the loss: relu1_1, relu2_1, relu3_1 and, where weights for it are at hand, relu4_1.

use anyhow::{Context, Result, ensure};
use burn::tensor::{
    Device, Tensor, TensorData,
    activation::relu,
    module::{conv2d, max_pool2d},
    ops::{ConvOptions, MaxPoolOptions, PadMode},
};
use std::path::Path;
use stylegaussian_encoder::{
    onnx::Convolution,
    weights::{Weights, WeightsError},
};

/// Names of the layers whose features the loss sees, in order.
pub const LAYERS: [&str; 4] = ["relu1_1", "relu2_1", "relu3_1", "relu4_1"];

/// Where relu3_1, the encoder's layer, stands in [`LAYERS`].
pub const RELU3_1: usize = 2;

/// VGG-19's first 3x3 convolutions: name, output channels, and whether a 2x2 max-pool comes before.
const CONVOLUTIONS: [(&str, usize, bool); 9] = [
    ("conv1_1", 64, false),
    ("conv1_2", 64, false),
    ("conv2_1", 128, true),
    ("conv2_2", 128, false),
    ("conv3_1", 256, true),
    ("conv3_2", 256, false),
    ("conv3_3", 256, false),
    ("conv3_4", 256, false),
    ("conv4_1", 512, true),
];

struct Step {
    weight: Tensor<4>,
    bias: Tensor<1>,
    pools_before: bool,
    /// A 1x1 convolution that leads a narrow network's channels to VGG's, where the loss looks.
    tap: Option<Tap>,
}

enum Tap {
    Plain,
    Widened(Box<(Tensor<4>, Tensor<1>)>),
}

struct Chain {
    input: Option<(Tensor<4>, Tensor<1>)>,
    steps: Vec<Step>,
}

/// The networks behind the loss.
pub struct LossNetwork {
    main: Chain,
    /// A network that gives relu4_1 alone, where the main one ends at relu3_1.
    deep: Option<Chain>,
}

impl LossNetwork {
    /// VGG-19 weights from `main` (safetensors with tensors `conv1_1.weight` ...), up to conv4_1 where the file has it.
    /// `deep` names a narrow stand-in (quarter-width VGG-19 with 1x1 `aux` convolutions) for relu4_1.
    ///
    /// # Errors
    /// When a file cannot be read or a tensor is missing or has another shape.
    pub fn open(main: &Path, deep: Option<&Path>, device: &Device) -> Result<Self> {
        let weights = Weights::open(main)?;
        ensure!(
            weights.contains("conv1_1.weight"),
            "{}: the loss needs VGG-19 weights as safetensors with tensors `conv1_1.weight` and so on; there is none",
            main.display()
        );
        let n_steps = if weights.contains("conv4_1.weight") { CONVOLUTIONS.len() } else { 5 };
        let chain = Chain::load(&weights, n_steps, 1, &[0, 2, 4, 8], device)?;
        let deep = match deep.filter(|_| n_steps == 5) {
            None => None,
            Some(path) => {
                let weights = Weights::open(path)?;
                let chain = Chain::load(&weights, CONVOLUTIONS.len(), 4, &[8], device);
                Some(chain.with_context(|| format!("{}: cannot stand in for relu4_1", path.display()))?)
            }
        };
        Ok(Self { main: chain, deep })
    }

    /// How many of [`LAYERS`] it gives.
    pub fn n_layers(&self) -> usize {
        if self.deep.is_some() || self.main.steps.len() == CONVOLUTIONS.len() { 4 } else { 3 }
    }

    /// Features of pictures `[B, 3, H, W]`, RGB 0..1, at each layer `[B, D, h, w]`.
    pub fn features(&self, picture: Tensor<4>) -> Vec<Tensor<4>> {
        let mut features = self.main.features(picture.clone());
        if let Some(deep) = &self.deep {
            features.extend(deep.features(picture));
        }
        features
    }
}

fn tensors(convolution: Convolution, device: &Device) -> (Tensor<4>, Tensor<1>) {
    let n_bias = convolution.bias.len();
    (
        Tensor::from_data(TensorData::new(convolution.weight, convolution.shape), device),
        Tensor::from_data(TensorData::new(convolution.bias, [n_bias]), device),
    )
}

impl Chain {
    fn load(
        weights: &Weights,
        n_steps: usize,
        narrowing: usize,
        taps: &[usize],
        device: &Device,
    ) -> Result<Self, WeightsError> {
        let input = match weights.contains("conv0.weight") {
            true => Some(tensors(weights.convolution("conv0", [3, 3, 1, 1])?, device)),
            false => None,
        };
        let mut steps = Vec::new();
        let mut d_in = 3;
        for (i, &(name, width, pools_before)) in CONVOLUTIONS[..n_steps].iter().enumerate() {
            let d_out = width / narrowing;
            let (weight, bias) = tensors(weights.convolution(name, [d_out, d_in, 3, 3])?, device);
            let tap = match (taps.contains(&i), narrowing) {
                (false, _) => None,
                (true, 1) => Some(Tap::Plain),
                (true, _) => {
                    let aux = weights.convolution(&format!("{name}_aux"), [width, d_out, 1, 1])?;
                    Some(Tap::Widened(Box::new(tensors(aux, device))))
                }
            };
            steps.push(Step { weight, bias, pools_before, tap });
            d_in = d_out;
        }
        Ok(Self { input, steps })
    }

    fn features(&self, picture: Tensor<4>) -> Vec<Tensor<4>> {
        let conv = |x: Tensor<4>, weight: &Tensor<4>, bias: &Tensor<1>| {
            conv2d(x, weight.clone(), Some(bias.clone()), ConvOptions::new([1, 1], [0, 0], [1, 1], 1))
        };
        let mut x = match &self.input {
            Some((weight, bias)) => conv(picture, weight, bias),
            None => picture,
        };
        let mut features = Vec::new();
        for step in &self.steps {
            if step.pools_before {
                x = max_pool2d(x, MaxPoolOptions::new([2, 2]).with_stride([2, 2]).with_ceil_mode(true));
            }
            let padded = x.pad([(1, 1), (1, 1)], PadMode::Reflect);
            x = relu(conv(padded, &step.weight, &step.bias));
            match &step.tap {
                None => {}
                Some(Tap::Plain) => features.push(x.clone()),
                Some(Tap::Widened(aux)) => features.push(relu(conv(x.clone(), &aux.0, &aux.1))),
            }
        }
        features
    }
}

/// Channel mean and standard deviation `[1, D]` of features `[1, D, h, w]` where `coverage` `[1, h * w]`, which sums to 1,
/// says that there is something to see. A variance of 1e-8 is added under the root, whose gradient has no bound at 0.
pub fn channel_statistics(features: Tensor<4>, coverage: Option<&Tensor<2>>) -> (Tensor<2>, Tensor<2>) {
    let [_, n_channels, height, width] = features.dims();
    let n = height * width;
    let rows = features.reshape([n_channels, n]);
    let (mean, variance) = match coverage {
        None => {
            let mean = rows.clone().mean_dim(1);
            let squares = (rows - mean.clone()).powi_scalar(2);
            (mean, squares.sum_dim(1) / (n.max(2) - 1) as f32)
        }
        Some(coverage) => {
            let mean = (rows.clone() * coverage.clone()).sum_dim(1);
            let squares = (rows - mean.clone()).powi_scalar(2);
            (mean, (squares * coverage.clone()).sum_dim(1))
        }
    };
    (mean.reshape([1, n_channels]), (variance + 1e-8).sqrt().reshape([1, n_channels]))
}
