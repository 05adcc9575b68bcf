//! VGG-19 in burn, for the loss: relu1_1, relu2_1, relu3_1 and, if weights for it are given, relu4_1.
//!
//! It is not a [chain](stylegaussian_encoder::chain), because training differentiates through it on GPUs too.

use std::{
    collections::HashMap,
    path::Path,
    sync::{Arc, Mutex, PoisonError},
};

use burn::tensor::{Device, Tensor, TensorData};
use stylegaussian_encoder::{
    chain::Kernel,
    vgg::{CONVOLUTIONS, VggConvolution},
    weights::{Weights, WeightsError},
};

use super::{
    ops::{Windows, max_pool, row_statistics, windows_conv_relu},
    processor::Processor,
};
use crate::error::{Context, TrainError, ensure};

/// Layers that the loss compares, in order.
pub const LAYERS: [&str; 4] = ["relu1_1", "relu2_1", "relu3_1", "relu4_1"];

/// Index of relu3_1, the encoder's layer, in [`LAYERS`].
pub(crate) const RELU3_1: usize = 2;

/// A convolution as [`windows_conv_relu`] takes it: weight `[D_out, k * D_in]` and bias `[D_out]`.
pub(crate) type KernelTensors = (Tensor<2>, Tensor<1>);

struct Step {
    kernel: KernelTensors,
    pools_before: bool,
    /// The loss's view of this layer, if it compares it.
    tap: Option<Tap>,
}

enum Tap {
    Plain,
    /// Through a 1x1 convolution from a narrow network's channels to VGG's.
    Widened(Box<KernelTensors>),
}

struct Chain {
    steps: Vec<Step>,
}

/// Features of a picture at one layer.
pub(crate) struct FeatureRows {
    /// One row for each cell `[h * w, D]`.
    pub rows: Tensor<2>,
    /// Width and height, in cells.
    pub size: [usize; 2],
}

/// The windows of a picture's convolutions.
struct Grid {
    /// 3x3, reflected at the border.
    neighborhoods: Arc<Windows>,
    /// 1x1.
    cells: Arc<Windows>,
}

impl Grid {
    fn new(size: [usize; 2]) -> Self {
        let windows = |kernel| Arc::new(Windows::of_pictures(size, 1, kernel, 1));
        Self { neighborhoods: windows(3), cells: windows(1) }
    }
}

/// VGG-19 as the loss network: features of pictures at [`LAYERS`].
pub struct LossNetwork {
    main: Chain,
    /// A network for relu4_1 alone, if the main one ends at relu3_1.
    deep: Option<Chain>,
    /// Grids by picture size. A training uses few sizes many times.
    grids: Mutex<HashMap<[usize; 2], Arc<Grid>>>,
    device: Device,
}

impl LossNetwork {
    /// Reads VGG-19 weights from `main` (safetensors with tensors `conv1_1.weight` ...), up to conv4_1 if the
    /// file has it. `deep` names a narrow substitute for relu4_1: VGG-19 with a quarter of the channels and 1x1
    /// `aux` convolutions. Training runs on the same processor.
    ///
    /// # Errors
    /// If a file cannot be read or a tensor is missing or has another shape.
    pub fn open(main: &Path, deep: Option<&Path>, processor: Processor) -> Result<Self, TrainError> {
        Self::open_on(main, deep, &processor.device())
    }

    /// [`open`](Self::open) on any device, such as one that records no gradients.
    ///
    /// # Errors
    /// If a file cannot be read or a tensor is missing or has another shape.
    pub(crate) fn open_on(main: &Path, deep: Option<&Path>, device: &Device) -> Result<Self, TrainError> {
        let weights = Weights::open(main)?;
        ensure!(
            weights.contains("conv1_1.weight"),
            "{}: the loss needs VGG-19 weights as safetensors with tensors `conv1_1.weight` and so on; \
             there is none",
            main.display()
        );
        // Five convolutions reach relu3_1.
        let n_steps = if weights.contains("conv4_1.weight") { CONVOLUTIONS.len() } else { 5 };
        // The taps are the positions of conv1_1, conv2_1, conv3_1 and conv4_1. Those beyond `n_steps` are never
        // reached.
        let chain = Chain::load(&weights, n_steps, 1, &[0, 2, 4, 8], device)?;
        let deep = match deep.filter(|_| n_steps == 5) {
            None => None,
            Some(path) => {
                let weights = Weights::open(path)?;
                let chain = Chain::load(&weights, CONVOLUTIONS.len(), 4, &[8], device);
                Some(chain.context(|| format!("{}: cannot stand in for relu4_1", path.display()))?)
            }
        };
        Ok(Self { main: chain, deep, grids: Mutex::default(), device: device.clone() })
    }

    /// The device that it computes on.
    pub(crate) fn device(&self) -> &Device {
        &self.device
    }

    /// Number of [`LAYERS`] that it computes: 4 with weights for relu4_1, otherwise 3.
    pub fn n_layers(&self) -> usize {
        if self.deep.is_some() || self.main.steps.len() == CONVOLUTIONS.len() { 4 } else { 3 }
    }

    /// Features of a picture `[H * W, 3]`, RGB 0..1, `size` = [W, H], at each layer.
    pub(crate) fn features(&self, picture: Tensor<2>, size: [usize; 2]) -> Vec<FeatureRows> {
        let mut features = self.features_to_relu3_1(picture.clone(), size);
        if let Some(deep) = &self.deep {
            features.extend(deep.features(picture, size, &self.grids));
        }
        features
    }

    /// [`features`](Self::features) without the substitute for relu4_1.
    pub(crate) fn features_to_relu3_1(&self, picture: Tensor<2>, size: [usize; 2]) -> Vec<FeatureRows> {
        self.main.features(picture, size, &self.grids)
    }
}

/// A convolution with a kernel `[D_out, D_in, height, width]` as weight `[D_out, k * D_in]` and bias.
pub(crate) fn kernel(convolution: &Kernel, device: &Device) -> KernelTensors {
    let [d_out, d_in, height, width] = convolution.shape;
    let k = height * width;
    // From channel-major to the order of windows, in which each pixel's channels are side by side.
    let source = |i: usize| {
        let (o, tap, d) = (i / (k * d_in), i / d_in % k, i % d_in);
        convolution.weight[(o * d_in + d) * k + tap]
    };
    let weight: Vec<f32> = (0..d_out * k * d_in).map(source).collect();
    (
        Tensor::from_data(TensorData::new(weight, [d_out, k * d_in]), device),
        Tensor::from_data(TensorData::new(convolution.bias.clone(), [d_out]), device),
    )
}

/// Joins a 1x1 convolution of the picture's channels and the convolution after it into one. Reflection padding
/// commutes with a 1x1 convolution, so this is exact also at the border.
pub(crate) fn behind(input: &Kernel, mut convolution: Kernel) -> Kernel {
    let [d_out, d_in, height, width] = convolution.shape;
    let k = height * width;
    let source = convolution.weight.clone();
    for o in 0..d_out {
        // Read from a copy: a tap's new weights depend on all its old ones.
        for tap in 0..k {
            let weights: Vec<f32> = (0..d_in).map(|d| source[(o * d_in + d) * k + tap]).collect();
            for d in 0..d_in {
                let sum = weights.iter().enumerate().map(|(j, w)| w * input.weight[j * d_in + d]).sum();
                convolution.weight[(o * d_in + d) * k + tap] = sum;
            }
            convolution.bias[o] += weights.iter().zip(&input.bias).map(|(w, b)| w * b).sum::<f32>();
        }
    }
    convolution
}

impl Chain {
    fn load(
        weights: &Weights,
        n_steps: usize,
        narrowing: usize,
        taps: &[usize],
        device: &Device,
    ) -> Result<Self, WeightsError> {
        // Weights without conv0 take RGB 0..1 as it is.
        let input = match weights.contains("conv0.weight") {
            true => Some(weights.kernel("conv0", [3, 3, 1, 1])?),
            false => None,
        };
        let mut steps = Vec::new();
        let mut d_in = 3;
        for (i, &VggConvolution { name, n_channels: width, pools_before, .. }) in
            CONVOLUTIONS[..n_steps].iter().enumerate()
        {
            let d_out = width / narrowing;
            let convolution = weights.kernel(name, [d_out, d_in, 3, 3])?;
            let convolution = match input.as_ref().filter(|_| i == 0) {
                Some(input) => behind(input, convolution),
                None => convolution,
            };
            let tap = match (taps.contains(&i), narrowing) {
                (false, _) => None,
                (true, 1) => Some(Tap::Plain),
                (true, _) => {
                    let aux = weights.kernel(&format!("{name}_aux"), [width, d_out, 1, 1])?;
                    Some(Tap::Widened(Box::new(kernel(&aux, device))))
                }
            };
            steps.push(Step { kernel: kernel(&convolution, device), pools_before, tap });
            d_in = d_out;
        }
        Ok(Self { steps })
    }

    fn features(
        &self,
        picture: Tensor<2>,
        mut size: [usize; 2],
        grids: &Mutex<HashMap<[usize; 2], Arc<Grid>>>,
    ) -> Vec<FeatureRows> {
        let grid = |size| {
            // A panic elsewhere cannot leave the map half written: insertion is the only change.
            let mut grids = grids.lock().unwrap_or_else(PoisonError::into_inner);
            grids.entry(size).or_insert_with(|| Arc::new(Grid::new(size))).clone()
        };
        let conv = |x: &Tensor<2>, kernel: &KernelTensors, windows: &Arc<Windows>| {
            windows_conv_relu(x.clone(), kernel.0.clone(), kernel.1.clone(), windows)
        };
        let mut x = picture;
        let mut features = Vec::new();
        for step in &self.steps {
            if step.pools_before {
                x = max_pool(x, size);
                // The pool keeps the last odd line.
                size = size.map(|side| side.div_ceil(2));
            }
            let grid = grid(size);
            x = conv(&x, &step.kernel, &grid.neighborhoods);
            let rows = match &step.tap {
                None => continue,
                Some(Tap::Plain) => x.clone(),
                Some(Tap::Widened(aux)) => conv(&x, aux, &grid.cells),
            };
            features.push(FeatureRows { rows, size });
        }
        features
    }
}

impl FeatureRows {
    /// Mean and unbiased standard deviation of each channel `[2, D]`.
    pub fn statistics(&self) -> Tensor<2> {
        let n = self.size[0] * self.size[1];
        let found = row_statistics(self.rows.clone(), &Arc::new(vec![1.0 / n as f32; n]));
        // The encoder's style statistics are unbiased, and training takes these in their place.
        let unbiased = (n as f32 / (n.max(2) - 1) as f32).sqrt();
        Tensor::cat(vec![found.clone().narrow(0, 0, 1), found.narrow(0, 1, 1) * unbiased], 0)
    }
}

/// Interleaved RGB `[H, W, 3]` as a tensor `[H * W, 3]`.
pub(crate) fn picture_tensor(rgb: &[f32], device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(rgb.to_vec(), [rgb.len() / 3, 3]), device)
}
