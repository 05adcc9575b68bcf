//! A chain of convolutions with its gradient with respect to the input.
//!
//! Pictures are rows of pixels with channels last, `[h * w, C]`.

use rayon::prelude::*;

use super::convolution::{Convolution, Size};

/// Values that a thread takes at a time, where each is one addition: 128 KiB.
const CHUNK: usize = 1 << 15;

/// One operation. Value 0 is the picture, value i + 1 the result of operation i.
#[derive(Clone, Debug)]
pub enum Operation {
    /// A convolution of the value before.
    Convolution(Convolution),
    /// The sum of the value before and an earlier one.
    Add(usize),
    /// relu(x) and relu(-x) of the value before, in twice as many channels (CReLU: Shang et al. 2016).
    BothSigns,
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

/// The values of a chain on one picture: rows `[h * w, C]` of the picture and of each operation's result.
pub struct Values(pub(super) Vec<Vec<f32>>);

impl Chain {
    pub(super) fn new(operations: Vec<Operation>) -> Self {
        Self { operations }
    }

    /// Channels of a value.
    pub(super) fn channels(&self, value: usize) -> usize {
        self.operations[..value].iter().fold(3, |channels, operation| match operation {
            Operation::Convolution(convolution) => convolution.d_out(),
            Operation::BothSigns => 2 * channels,
            Operation::Add(_) | Operation::MaxPool { .. } => channels,
        })
    }

    /// The size of each value for a picture of `size`.
    pub(super) fn sizes(&self, size: Size) -> Vec<Size> {
        let mut sizes = vec![size];
        for operation in &self.operations {
            let size = sizes[sizes.len() - 1];
            sizes.push(match operation {
                Operation::Convolution(convolution) => convolution.size_after(size),
                Operation::Add(_) | Operation::BothSigns => size,
                Operation::MaxPool { ceil } => size.halved(*ceil),
            });
        }
        sizes
    }

    /// All values on a picture RGB 0..1 `[h * w, 3]`.
    pub(super) fn forward(&self, sizes: &[Size], rgb: &[f32]) -> Values {
        let mut values = vec![rgb.to_vec()];
        for (i, operation) in self.operations.iter().enumerate() {
            let x = &values[i];
            values.push(match operation {
                Operation::Convolution(convolution) => convolution.forward(x, sizes[i]),
                Operation::Add(from) => {
                    let mut sum = x.clone();
                    add(&mut sum, &values[*from]);
                    sum
                }
                Operation::BothSigns => both_signs(x, self.channels(i)),
                Operation::MaxPool { .. } => max_pool(x, self.channels(i), sizes[i], sizes[i + 1]),
            });
        }
        Values(values)
    }

    /// The gradient with respect to the picture `[h * w, 3]`, from the gradients with respect to some values;
    /// none if there are none.
    pub(super) fn backward(
        &self,
        sizes: &[Size],
        values: &Values,
        mut grads: Vec<Option<Vec<f32>>>,
    ) -> Option<Vec<f32>> {
        for (i, operation) in self.operations.iter().enumerate().rev() {
            let Some(mut grad) = grads[i + 1].take() else { continue };
            match operation {
                Operation::Convolution(convolution) => {
                    if convolution.relu {
                        gate(&mut grad, &values.0[i + 1]);
                    }
                    accumulate(&mut grads[i], convolution.backward(&grad, sizes[i]));
                }
                Operation::Add(from) => {
                    match &mut grads[*from] {
                        Some(sum) => add(sum, &grad),
                        none => *none = Some(grad.clone()),
                    }
                    accumulate(&mut grads[i], grad);
                }
                Operation::BothSigns => {
                    accumulate(&mut grads[i], both_signs_backward(&values.0[i], &grad, self.channels(i)));
                }
                Operation::MaxPool { .. } => {
                    let (x, y) = (&values.0[i], &values.0[i + 1]);
                    let sizes = [sizes[i], sizes[i + 1]];
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

/// Pixels that a thread takes at a time, where each has some dozens of values.
const PIXELS: usize = 1 << 10;

fn both_signs(x: &[f32], c: usize) -> Vec<f32> {
    let mut y = vec![0.0; 2 * x.len()];
    y.par_chunks_mut(PIXELS * 2 * c).zip(x.par_chunks(PIXELS * c)).for_each(|(y, x)| {
        for (y, x) in y.chunks_exact_mut(2 * c).zip(x.chunks_exact(c)) {
            let (above, below) = y.split_at_mut(c);
            above.iter_mut().zip(x).for_each(|(y, x)| *y = x.max(0.0));
            below.iter_mut().zip(x).for_each(|(y, x)| *y = (-x).max(0.0));
        }
    });
    y
}

fn both_signs_backward(x: &[f32], grad_y: &[f32], c: usize) -> Vec<f32> {
    let mut grad_x = vec![0.0; x.len()];
    let given = x.par_chunks(PIXELS * c).zip(grad_y.par_chunks(PIXELS * 2 * c));
    grad_x.par_chunks_mut(PIXELS * c).zip(given).for_each(|(grad_x, (x, grad_y))| {
        let given = x.chunks_exact(c).zip(grad_y.chunks_exact(2 * c));
        for (grad_x, (x, grad_y)) in grad_x.chunks_exact_mut(c).zip(given) {
            let (above, below) = grad_y.split_at(c);
            for ((grad_x, x), (above, below)) in grad_x.iter_mut().zip(x).zip(above.iter().zip(below)) {
                // Choices and no branch, so that it runs in vectors.
                let of_above = if *x > 0.0 { *above } else { 0.0 };
                let of_below = if *x < 0.0 { *below } else { 0.0 };
                *grad_x = of_above - of_below;
            }
        }
    });
    grad_x
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
