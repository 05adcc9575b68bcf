//! The student network: its shape, its parameters and its file.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData, activation::relu};
use stylegaussian::random::Random;
use stylegaussian_encoder::chain::{self, Chain, Convolution, Operation, Padding};

use crate::{
    error::TrainError,
    nn::{
        ops::{Windows, max_pool, windows_conv},
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
    /// The largest of 2x2.
    MaxPool,
}

use Step::{Convolution as Conv, MaxPool, Residual};

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
    steps: Vec<Step>,
}

/// The windows of each step over a batch of pictures, stacked vertically.
pub struct Grids {
    /// Windows of the first step, over the pictures.
    first: Windows,
    /// Windows of each step and of the last convolution, and the size of the step's input `[W, n * H]`. The
    /// first step's pixels are gathered beforehand, so its windows are 1x1.
    steps: Vec<(Arc<Windows>, [usize; 2])>,
}

/// The shape of a convolution.
#[derive(Clone, Copy)]
struct Kernel {
    /// Pixels on a side.
    side: usize,
    stride: usize,
    d_in: usize,
    d_out: usize,
}

fn kernels(steps: &[Step], n_channels: usize) -> Vec<Kernel> {
    let mut d_in = 3;
    let mut kernels = Vec::new();
    for step in steps {
        match *step {
            Conv { kernel, stride, channels } => {
                kernels.push(Kernel { side: kernel, stride, d_in, d_out: channels });
                d_in = channels;
            }
            Residual => kernels.push(Kernel { side: 3, stride: 1, d_in, d_out: d_in }),
            MaxPool => (),
        }
    }
    kernels.push(Kernel { side: 1, stride: 1, d_in, d_out: n_channels });
    kernels
}

/// Multiply-adds of the network on a picture of `size` = [W, H].
pub fn multiply_adds(steps: &[Step], n_channels: usize, mut size: [usize; 2]) -> usize {
    let mut kernels = kernels(steps, n_channels).into_iter();
    let mut sum = 0;
    for step in steps.iter().map(Some).chain([None]) {
        let stride = match step {
            Some(MaxPool) => 2,
            Some(Conv { stride, .. }) => *stride,
            Some(Residual) | None => 1,
        };
        size = size.map(|side| side.div_ceil(stride));
        if step != Some(&MaxPool) {
            let operations = |Kernel { side, d_in, d_out, .. }: Kernel| side * side * d_in * d_out;
            sum += size[0] * size[1] * kernels.next().map_or(0, operations);
        }
    }
    sum
}

impl Grids {
    /// For `n` pictures of `size` = [W, H].
    pub fn new(steps: &[Step], mut size: [usize; 2], n: usize) -> Self {
        let mut first = None;
        let mut grid = |step: Option<&Step>| {
            let (kernel, stride) = match step {
                Some(Conv { kernel, stride, .. }) => (*kernel, *stride),
                Some(Residual) => (3, 1),
                Some(MaxPool) => (2, 2),
                None => (1, 1),
            };
            // Max-pooling takes the batch as one tall picture. That is right if heights are even, as they are
            // for crops.
            let stacked = [size[0], size[1] * n];
            let windows = Windows::of_pictures(size, n, kernel, stride);
            size = size.map(|side| side.div_ceil(stride));
            if first.is_some() {
                return (Arc::new(windows), stacked);
            }
            first = Some(windows);
            (Arc::new(Windows::of_pictures(size, n, 1, 1)), stacked)
        };
        let steps = steps.iter().map(Some).chain([None]).map(&mut grid).collect();
        Self { first: first.unwrap_or_else(|| Windows::of_pictures(size, n, 1, 1)), steps }
    }
}

impl Student {
    /// He-normal weights and zero biases; `deviations` `[D]` are the teacher's.
    pub fn new(steps: &[Step], deviations: &[f32], random: &mut Random, device: &Device) -> Self {
        let parameter = |values, shape| Parameter::new(values, shape, device);
        let mut parameters = Vec::new();
        // The last convolution starts small too, hence the `true` at the end.
        let adds = steps.iter().filter(|step| **step != MaxPool).map(|step| *step == Residual);
        for (Kernel { side, d_in, d_out, .. }, adds) in
            kernels(steps, deviations.len()).into_iter().zip(adds.chain([true]))
        {
            let columns = side * side * d_in;
            // Residual branches and the features start small. Otherwise the first hundreds of steps would only
            // learn the scale.
            let deviation = if adds { 0.3 } else { 1.0 } * (2.0 / columns as f32).sqrt();
            let weight = (0..d_out * columns).map(|_| deviation * random.normal()).collect();
            parameters.push(parameter(weight, [d_out, columns]));
            parameters.push(parameter(vec![0.0; d_out], [1, d_out]));
        }
        parameters.push(parameter(deviations.to_vec(), [1, deviations.len()]));
        Self { parameters, steps: steps.to_vec() }
    }

    /// The teacher's deviations `[1, D]`.
    pub fn deviations(&self) -> Tensor<2> {
        self.parameters[self.parameters.len() - 1].values.clone().detach()
    }

    /// Features of pictures in units of the teacher's deviations `[n * h * w, D]`, from [`Student::patches`].
    pub fn forward(&self, patches: Tensor<2>, grids: &Grids) -> Tensor<2> {
        // The deviations are the odd one at the end, which `chunks_exact` leaves out.
        let mut kernels = self.parameters.chunks_exact(2).map(|pair| {
            let d_out = pair[0].values.dims()[0];
            (pair[0].values.clone(), pair[1].values.clone().reshape([d_out]))
        });
        let mut convolved = |x: Tensor<2>, windows: &Arc<Windows>| match kernels.next() {
            Some((weight, bias)) => relu(windows_conv(x, weight, bias, windows)),
            None => x,
        };
        let mut x = patches;
        for (step, (windows, size)) in self.steps.iter().zip(&grids.steps) {
            x = match step {
                Conv { .. } => convolved(x, windows),
                Residual => x.clone() + convolved(x, windows),
                MaxPool => max_pool(x, *size),
            };
        }
        convolved(x, &grids.steps[self.steps.len()].0)
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
        let kernels = kernels(&self.steps, deviations.len());
        let last = kernels.len() - 1;
        let convolution = |i: usize| {
            let Kernel { side, d_in, d_out, .. } = kernels[i];
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
            if i == last {
                let rows = weight.chunks_exact_mut(d_in).zip(&mut bias);
                for ((row, bias), deviation) in rows.zip(deviations) {
                    row.iter_mut().for_each(|value| *value *= deviation);
                    *bias *= deviation;
                }
            }
            oihw(&weight, bias, side, d_in, d_out)
        };
        let (mut operations, mut next) = (Vec::new(), 0..);
        let mut convolved = |operations: &mut Vec<Operation>| -> Result<(), TrainError> {
            let i = next.next().unwrap_or_default();
            let Kernel { side, stride, .. } = kernels[i];
            // An even kernel has no middle: it reaches one pixel further after than before.
            let border = Padding::Reflect([(side - 1) / 2, side / 2]);
            let convolution = Convolution::strided(&convolution(i), border, stride);
            let convolution =
                convolution.map_err(|found| TrainError::Invalid(format!("the student has {found}")))?;
            operations.push(Operation::Convolution(convolution.rectified()));
            Ok(())
        };
        for step in &self.steps {
            match step {
                Conv { .. } => convolved(&mut operations)?,
                Residual => {
                    let before = operations.len();
                    convolved(&mut operations)?;
                    operations.push(Operation::Add(before));
                }
                MaxPool => operations.push(Operation::MaxPool { ceil: true }),
            }
        }
        convolved(&mut operations)?;
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
            MaxPool,
            Conv { kernel: 3, stride: 1, channels: 5 },
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
        let steps = [Conv { kernel: 2, stride: 2, channels: 4 }, Residual, MaxPool];
        // 4x3 cells of 12 x 4 and of 36 x 4, then 2x2 of 4 x 5.
        assert_eq!(multiply_adds(&steps, 5, [8, 6]), 12 * 48 + 12 * 144 + 4 * 20);
    }
}
