//! The student network: its shape, its parameters and its file.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData, activation::relu};
use stylegaussian::random::Random;
use stylegaussian_encoder::chain::{self, Chain, Convolution, Operation, Padding};

use crate::{
    error::TrainError,
    nn::{
        ops::{Windows, windows_conv},
        parameter::{Parameter, to_vec},
    },
};

/// Pictures enter as GAIN (x - CENTER), with about zero mean and unit deviation. In the file this is folded
/// into the first kernel.
const GAIN: f32 = 4.0;
const CENTER: f32 = 0.5;

/// One step of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// relu(W x + b) with a square kernel, at every `stride`-th line and column.
    Convolution {
        /// Side of the kernel.
        kernel: usize,
        /// 1 or 2.
        stride: usize,
        /// Channels that come out.
        channels: usize,
    },
    /// x + relu(W x + b), 3x3.
    Residual,
}

use Step::{Convolution as Conv, Residual};

/// The network. Width and height are halved twice, as in VGG up to relu3_1, but immediately and first by a
/// large kernel: VGG spends most of its operations at full and half size, the student few. A cell sees 28
/// pixels, VGG's 24. The 80 principal directions of VGG's 256 channels before their ReLU give a median
/// correlation of 0.984 after it.
pub const STEPS: &[Step] = &[
    Conv { kernel: 6, stride: 2, channels: 32 },
    Residual,
    Conv { kernel: 2, stride: 2, channels: 80 },
    Residual,
    Residual,
];

/// The network: weight `[D_out, k * k * D_in]` and bias `[1, D_out]` of each convolution, the last of which is
/// 1x1 to the teacher's channels, and the teacher's deviation of each channel `[1, D]`, which is measured and
/// not trained.
pub struct Student {
    /// Weight, bias, ..., weight, bias, deviations.
    pub parameters: Vec<Parameter>,
    kernels: Vec<Kernel>,
}

/// The windows of each convolution over a batch of pictures, stacked vertically.
pub struct Grids {
    /// Windows of the first convolution, over the pictures.
    first: Windows,
    /// Windows of each convolution. The first one's pixels are gathered beforehand, so its windows are 1x1.
    convolutions: Vec<Arc<Windows>>,
}

/// The shape of a convolution.
#[derive(Clone, Copy)]
struct Kernel {
    /// Pixels on a side.
    side: usize,
    stride: usize,
    d_in: usize,
    d_out: usize,
    /// Whether the result is added to the input.
    adds: bool,
}

fn kernels(steps: &[Step], n_channels: usize) -> Vec<Kernel> {
    let mut d_in = 3;
    let kernel = |step: &Step| match *step {
        Conv { kernel: side, stride, channels } => {
            let d_in = std::mem::replace(&mut d_in, channels);
            Kernel { side, stride, d_in, d_out: channels, adds: false }
        }
        Residual => Kernel { side: 3, stride: 1, d_in, d_out: d_in, adds: true },
    };
    let last = Conv { kernel: 1, stride: 1, channels: n_channels };
    steps.iter().chain([&last]).map(kernel).collect()
}

/// Multiply-adds of the network on a picture of `size` = [W, H].
pub fn multiply_adds(steps: &[Step], n_channels: usize, mut size: [usize; 2]) -> usize {
    let operations = |Kernel { side, stride, d_in, d_out, .. }: Kernel| {
        size = size.map(|pixels| pixels.div_ceil(stride));
        size[0] * size[1] * side * side * d_in * d_out
    };
    kernels(steps, n_channels).into_iter().map(operations).sum()
}

impl Grids {
    /// For `n` pictures of `size` = [W, H].
    pub fn new(steps: &[Step], mut size: [usize; 2], n: usize) -> Self {
        let mut windows = |Kernel { side, stride, .. }: Kernel| {
            let windows = Windows::of_pictures(size, n, side, stride);
            size = size.map(|pixels| pixels.div_ceil(stride));
            windows
        };
        // Windows do not depend on the number of channels.
        let kernels = kernels(steps, 0);
        let first = windows(kernels[0]);
        let gathered = windows(Kernel { side: 1, stride: 1, ..kernels[0] });
        let others = kernels[1..].iter().map(|kernel| windows(*kernel));
        Self { convolutions: std::iter::once(gathered).chain(others).map(Arc::new).collect(), first }
    }
}

impl Student {
    /// He-normal weights and zero biases; `deviations` `[D]` are the teacher's.
    pub fn new(steps: &[Step], deviations: &[f32], random: &mut Random, device: &Device) -> Self {
        let parameter = |values, shape| Parameter::new(values, shape, device);
        let mut parameters = Vec::new();
        let kernels = kernels(steps, deviations.len());
        for (i, Kernel { side, d_in, d_out, adds, .. }) in kernels.iter().copied().enumerate() {
            let columns = side * side * d_in;
            // Residual branches and the features start small. Otherwise the first hundreds of steps would only
            // learn the scale.
            let factor = if adds || i + 1 == kernels.len() { 0.3 } else { 1.0 };
            let deviation = factor * (2.0 / columns as f32).sqrt();
            let weight = (0..d_out * columns).map(|_| deviation * random.normal()).collect();
            parameters.push(parameter(weight, [d_out, columns]));
            parameters.push(parameter(vec![0.0; d_out], [1, d_out]));
        }
        parameters.push(parameter(deviations.to_vec(), [1, deviations.len()]));
        Self { parameters, kernels }
    }

    /// The teacher's deviations `[1, D]`.
    pub fn deviations(&self) -> Tensor<2> {
        self.parameters[self.parameters.len() - 1].values.clone().detach()
    }

    /// Features of pictures in units of the teacher's deviations `[n * h * w, D]`, from [`Student::patches`].
    pub fn forward(&self, patches: Tensor<2>, grids: &Grids) -> Tensor<2> {
        // The deviations are the odd one at the end, which `chunks_exact` leaves out.
        let layers = self.parameters.chunks_exact(2).zip(&self.kernels).zip(&grids.convolutions);
        layers.fold(patches, |x, ((pair, kernel), windows)| {
            let (weight, bias) = (pair[0].values.clone(), pair[1].values.clone().reshape([kernel.d_out]));
            let y = relu(windows_conv(x.clone(), weight, bias, windows));
            if kernel.adds { x + y } else { y }
        })
    }

    /// The first convolution's windows of pictures RGB 0..1 `[n * H * W, 3]`, normalized:
    /// `[n * h * w, k * k * 3]`. They have no gradient, so it is enough to gather them once.
    pub fn patches(rgb: &[f32], grids: &Grids, device: &Device) -> Tensor<2> {
        let windows = &grids.first;
        let cells = windows.neighbors.iter().flat_map(|&cell| &rgb[cell as usize * 3..][..3]);
        let values: Vec<f32> = cells.map(|value| GAIN * (value - CENTER)).collect();
        Tensor::from_data(TensorData::new(values, [windows.n_out(), windows.k * 3]), device)
    }

    /// The network from RGB 0..1 to features, with `values` in the order of `parameters`.
    ///
    /// # Errors
    /// If a tensor cannot be read.
    pub fn chain(&self, values: &[Tensor<2>]) -> Result<Chain, TrainError> {
        let values = values.iter().map(to_vec).collect::<Result<Vec<_>, _>>()?;
        let deviations = values.last().map(Vec::as_slice).unwrap_or_default();
        let mut operations = Vec::new();
        for (i, Kernel { side, stride, d_in, d_out, adds }) in self.kernels.iter().copied().enumerate() {
            let (mut weight, mut bias) = (values[2 * i].clone(), values[2 * i + 1].clone());
            // W (GAIN (x - CENTER)) + b = (GAIN W) x + (b - GAIN CENTER sum W). Exact at the border too, where
            // padding reflects pixels and adds no zeros.
            if i == 0 {
                for (row, bias) in weight.chunks_exact_mut(side * side * d_in).zip(&mut bias) {
                    *bias -= GAIN * CENTER * row.iter().sum::<f32>();
                    row.iter_mut().for_each(|value| *value *= GAIN);
                }
            }
            // Deviations are positive, so they can be multiplied before the ReLU instead of after it.
            if i + 1 == self.kernels.len() {
                let rows = weight.chunks_exact_mut(d_in).zip(&mut bias);
                for ((row, bias), deviation) in rows.zip(deviations) {
                    row.iter_mut().for_each(|value| *value *= deviation);
                    *bias *= deviation;
                }
            }
            // An even kernel has no middle: it reaches one pixel further after than before.
            let border = Padding::Reflect([(side - 1) / 2, side / 2]);
            let kernel = oihw(&weight, bias, side, d_in, d_out);
            let convolution = Convolution::strided(&kernel, border, stride)
                .map_err(|found| TrainError::Invalid(format!("the student has {found}")))?;
            let before = operations.len();
            operations.push(Operation::Convolution(convolution.rectified()));
            if adds {
                operations.push(Operation::Add(before));
            }
        }
        Ok(Chain::new(3, operations)?)
    }
}

/// A weight `[D_out, k * k, D_in]` as a kernel `[D_out, D_in, k, k]`.
fn oihw(weight: &[f32], bias: Vec<f32>, side: usize, d_in: usize, d_out: usize) -> chain::Kernel {
    let k = side * side;
    // From [D_out, tap, D_in] to [D_out, D_in, tap].
    let source = |i: usize| weight[i / (d_in * k) * d_in * k + i % k * d_in + i / k % d_in];
    chain::Kernel { shape: [d_out, d_in, side, side], weight: (0..weight.len()).map(source).collect(), bias }
}

#[cfg(test)]
mod tests {
    use stylegaussian_encoder::{Encoder, Image};

    use super::*;

    #[test]
    fn the_file_gives_what_the_network_gives() {
        let (device, mut random) = (Device::flex().autodiff(), Random::new(3));
        let steps = [
            Conv { kernel: 6, stride: 2, channels: 4 },
            Residual,
            Conv { kernel: 2, stride: 2, channels: 5 },
        ];
        let mut student = Student::new(&steps, &[0.5, 2.0, 1.0], &mut random, &device);
        for parameter in &mut student.parameters {
            // Biases are zero at first, which would hide a wrong one.
            let [rows, columns] = parameter.values.dims();
            let noise = (0..rows * columns).map(|_| 0.1 * random.normal()).collect::<Vec<f32>>();
            let noise = Tensor::<2>::from_data(TensorData::new(noise, [rows, columns]), &device);
            parameter.values = (parameter.values.clone() + noise).detach().require_grad();
        }
        let (width, height) = (21, 14);
        let rgb: Vec<f32> = (0..width * height * 3).map(|_| random.uniform()).collect();
        let grids = Grids::new(&steps, [width, height], 1);
        let rows = student.forward(Student::patches(&rgb, &grids, &device), &grids) * student.deviations();

        let values: Vec<_> = student.parameters.iter().map(|parameter| parameter.values.clone()).collect();
        let bytes = student.chain(&values).unwrap().to_bytes(None, &[("teacher", "none".into())]);
        let encoder = Encoder::from_bytes("student", bytes).unwrap();
        let found =
            encoder.encode(&Image { width: width as u32, height: height as u32, rgb, alpha: None }).unwrap();
        assert_eq!((found.width, found.height, found.n_channels), (6, 4, 3));
        for (i, (a, b)) in to_vec(&rows).unwrap().iter().zip(&found.values).enumerate() {
            assert!((a - b).abs() < 1e-4, "[{i}]: the network gives {a}, the file {b}");
        }
    }

    #[test]
    fn multiply_adds_of_a_small_network() {
        let halving = Conv { kernel: 2, stride: 2, channels: 4 };
        // 4x3 cells of 12 x 4 and of 36 x 4, then 2x2 of 16 x 4 and of 4 x 5.
        let expected = 12 * 48 + 12 * 144 + 4 * 64 + 4 * 20;
        assert_eq!(multiply_adds(&[halving, Residual, halving], 5, [8, 6]), expected);
    }
}
