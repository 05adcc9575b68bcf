//! A chain of convolutions with its gradient with respect to the input.
//!
//! Pictures are rows of pixels with channels last, `[h * w, C]`. A convolution is then the model's KNN convolution,
//! where the neighborhood of a pixel is its window.

use rayon::prelude::*;
use stylegaussian::decoder::{KnnConvShape, knn_conv, knn_conv_backward_input};

use super::windows::{Size, Windows};

/// Values that a thread takes at a time, where each is one addition: 128 KiB.
const CHUNK: usize = 1 << 15;

/// How a convolution sees beyond the picture's border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Padding {
    /// As in a mirror, so many pixels above and left, and below and right. The border itself is not repeated.
    Reflect([usize; 2]),
    /// As zeros, so many on each side.
    Zeros(usize),
}

/// A convolution, with a ReLU behind it if `relu` is set.
#[derive(Clone, Debug)]
pub struct Convolution {
    /// K = side^2, and the channels.
    pub(super) shape: KnnConvShape,
    /// Side of the kernel, in pixels.
    pub(super) side: usize,
    /// Distance between neighboring outputs, in pixels.
    pub(super) stride: usize,
    pub(super) padding: Padding,
    /// `[D_out, K, D_in]`.
    weight: Vec<f32>,
    /// `[D_out]`.
    bias: Vec<f32>,
    pub(super) relu: bool,
}

impl Convolution {
    /// A convolution without ReLU from a kernel `[D_out, D_in, side, side]`, flattened, of the shape `[D_out, D_in,
    /// side]`.
    pub(super) fn from_oihw(
        [d_out, d_in, side]: [usize; 3],
        oihw: &[f32],
        bias: Vec<f32>,
        padding: Padding,
        stride: usize,
    ) -> Self {
        let k = side * side;
        // From [D_out, D_in, K] to [D_out, K, D_in].
        let source = |i: usize| i / (k * d_in) * k * d_in + i % d_in * k + i / d_in % k;
        let weight = (0..oihw.len()).map(|i| oihw[source(i)]).collect();
        Self { shape: KnnConvShape { k, d_in, d_out }, side, stride, padding, weight, bias, relu: false }
    }

    pub(super) fn d_out(&self) -> usize {
        self.shape.d_out
    }
}

/// One operation. Value 0 is the picture, value i + 1 the result of operation i.
#[derive(Clone, Debug)]
pub enum Operation {
    /// A convolution of the value before.
    Convolution(Convolution),
    /// The sum of the value before and an earlier one.
    Add(usize),
    /// The largest of 2x2 pixels. An odd last line is kept if `ceil`, otherwise dropped.
    MaxPool {
        /// Whether an odd last line is kept.
        ceil: bool,
    },
}

/// A chain of operations.
#[derive(Clone, Debug)]
pub struct Chain {
    pub(super) operations: Vec<Operation>,
}

/// The windows of a chain's operations on pictures of one size.
pub struct Grid {
    /// Size of each value.
    pub(super) sizes: Vec<Size>,
    /// Windows of each convolution; none for other operations.
    windows: Vec<Option<Windows>>,
}

/// The values of a chain on one picture: rows `[h * w, C]` of the picture and of each operation's result.
pub struct Values(pub(super) Vec<Vec<f32>>);

impl Chain {
    pub(super) fn new(operations: Vec<Operation>) -> Self {
        Self { operations }
    }

    /// Channels of a value.
    pub(super) fn channels(&self, value: usize) -> usize {
        let before = self.operations[..value].iter().rev();
        let found = before.filter_map(|operation| match operation {
            Operation::Convolution(convolution) => Some(convolution.d_out()),
            Operation::Add(_) | Operation::MaxPool { .. } => None,
        });
        found.take(1).next().unwrap_or(3)
    }

    /// The windows for pictures of `size`. Gradients need `backward`.
    pub(super) fn grid(&self, size: Size, backward: bool) -> Grid {
        let (mut sizes, mut windows) = (vec![size], Vec::new());
        for operation in &self.operations {
            let size = sizes[sizes.len() - 1];
            let (next, made) = match operation {
                Operation::Convolution(convolution) => {
                    let (next, made) = Windows::new(size, convolution, backward);
                    (next, Some(made))
                }
                Operation::Add(_) => (size, None),
                Operation::MaxPool { ceil } => (size.halved(*ceil), None),
            };
            sizes.push(next);
            windows.push(made);
        }
        Grid { sizes, windows }
    }

    /// All values on a picture RGB 0..1 `[h * w, 3]`.
    pub(super) fn forward(&self, grid: &Grid, rgb: &[f32]) -> Values {
        let mut values = vec![rgb.to_vec()];
        for (i, operation) in self.operations.iter().enumerate() {
            let x = &values[i];
            let y = match (operation, &grid.windows[i]) {
                (Operation::Convolution(convolution), Some(windows)) => convolve(convolution, windows, x),
                (Operation::Add(from), _) => {
                    let mut sum = x.clone();
                    add(&mut sum, &values[*from]);
                    sum
                }
                _ => max_pool(x, self.channels(i), grid.sizes[i], grid.sizes[i + 1]),
            };
            values.push(y);
        }
        Values(values)
    }

    /// The gradient with respect to the picture `[h * w, 3]`, from the gradients with respect to some values; none if
    /// there are none.
    pub(super) fn backward(
        &self,
        grid: &Grid,
        values: &Values,
        mut grads: Vec<Option<Vec<f32>>>,
    ) -> Option<Vec<f32>> {
        for (i, operation) in self.operations.iter().enumerate().rev() {
            let Some(mut grad) = grads[i + 1].take() else { continue };
            match (operation, &grid.windows[i]) {
                (Operation::Convolution(convolution), Some(windows)) => {
                    if convolution.relu {
                        gate(&mut grad, &values.0[i + 1]);
                    }
                    let reverse = windows.reverse.as_ref();
                    let Some(reverse) = reverse else { continue };
                    let mut grad =
                        knn_conv_backward_input(convolution.shape, reverse, &convolution.weight, &grad);
                    // Without the row of zeros, if there is one.
                    grad.truncate(values.0[i].len());
                    accumulate(&mut grads[i], grad);
                }
                (Operation::Add(from), _) => {
                    match &mut grads[*from] {
                        Some(sum) => add(sum, &grad),
                        none => *none = Some(grad.clone()),
                    }
                    accumulate(&mut grads[i], grad);
                }
                _ => {
                    let (x, y) = (&values.0[i], &values.0[i + 1]);
                    let sizes = [grid.sizes[i], grid.sizes[i + 1]];
                    accumulate(&mut grads[i], max_pool_backward(x, y, &grad, self.channels(i), sizes));
                }
            }
        }
        grads.swap_remove(0)
    }
}

fn accumulate(sum: &mut Option<Vec<f32>>, grad: Vec<f32>) {
    match sum {
        None => *sum = Some(grad),
        Some(sum) => add(sum, &grad),
    }
}

/// Adds `values` to `sum`.
pub(super) fn add(sum: &mut [f32], values: &[f32]) {
    let pairs = sum.par_chunks_mut(CHUNK).zip(values.par_chunks(CHUNK));
    pairs.for_each(|(sum, values)| sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value));
}

/// The gradient before a ReLU with the result `y`: 0 wherever y is.
fn gate(grad: &mut [f32], y: &[f32]) {
    let pairs = grad.par_chunks_mut(CHUNK).zip(y.par_chunks(CHUNK));
    pairs.for_each(|(grad, y)| {
        // A choice and no branch, so that it runs in vectors.
        grad.iter_mut().zip(y).for_each(|(grad, y)| *grad = if *y > 0.0 { *grad } else { 0.0 });
    });
}

fn convolve(convolution: &Convolution, windows: &Windows, x: &[f32]) -> Vec<f32> {
    let relu = convolution.relu;
    let finish = |block: &mut [f32]| {
        if relu {
            block.iter_mut().for_each(|value| *value = value.max(0.0));
        }
    };
    let run = |x: &[f32]| {
        knn_conv(convolution.shape, x, &windows.neighbors, &convolution.weight, &convolution.bias, finish)
    };
    match convolution.padding {
        Padding::Zeros(1..) => {
            let mut padded = x.to_vec();
            padded.resize(x.len() + convolution.shape.d_in, 0.0);
            run(&padded)
        }
        _ => run(x),
    }
}

/// The pixels of `from` under pixel (x, y) of a picture of half its size.
fn quad(from: Size, x: usize, y: usize) -> impl Iterator<Item = usize> {
    let columns = move || (2 * x..2 * x + 2).filter(move |&x| x < from.width);
    (2 * y..2 * y + 2)
        .filter(move |&y| y < from.height)
        .flat_map(move |y| columns().map(move |x| y * from.width + x))
}

fn max_pool(x: &[f32], c: usize, from: Size, to: Size) -> Vec<f32> {
    let mut y = vec![f32::NEG_INFINITY; to.n_pixels() * c];
    y.par_chunks_exact_mut((to.width * c).max(1)).enumerate().for_each(|(row, y)| {
        for (column, target) in y.chunks_exact_mut(c).enumerate() {
            for source in quad(from, column, row) {
                for (max, value) in target.iter_mut().zip(&x[source * c..]) {
                    *max = max.max(*value);
                }
            }
        }
    });
    y
}

/// The first of the largest gets the gradient.
fn max_pool_backward(x: &[f32], y: &[f32], grad_y: &[f32], c: usize, [from, to]: [Size; 2]) -> Vec<f32> {
    let mut grad_x = vec![0.0; x.len()];
    // Two rows of x belong to each row of y. An odd last row that was dropped has none.
    let rows = grad_x.par_chunks_mut((2 * from.width * c).max(1)).enumerate();
    rows.filter(|(row, _)| *row < to.height).for_each(|(row, grad_x)| {
        let mut taken = vec![false; c];
        for column in 0..to.width {
            let cell = (row * to.width + column) * c;
            taken.fill(false);
            for source in quad(from, column, row) {
                let grad_x = &mut grad_x[source * c - 2 * row * from.width * c..][..c];
                let values = x[source * c..].iter().zip(&y[cell..]).zip(&grad_y[cell..]);
                for ((grad_x, taken), ((x, y), grad_y)) in grad_x.iter_mut().zip(&mut taken).zip(values) {
                    if x == y && !*taken {
                        (*grad_x, *taken) = (*grad_y, true);
                    }
                }
            }
        }
    });
    grad_x
}
