//! Operations pixel by pixel: rows `[h * w, C]` in, rows out.

use rayon::prelude::*;

use super::size::Size;

/// Values that a thread takes at a time, where each is one addition: 128 KiB.
const CHUNK: usize = 1 << 15;

/// Adds `values` to `sum`.
pub fn add(sum: &mut [f32], values: &[f32]) {
    let pairs = sum.par_chunks_mut(CHUNK).zip(values.par_chunks(CHUNK));
    pairs.for_each(|(sum, values)| sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value));
}

/// The gradient before a ReLU with the result `y`: 0 wherever y is.
pub(super) fn gate(grad: &mut [f32], y: &[f32]) {
    let pairs = grad.par_chunks_mut(CHUNK).zip(y.par_chunks(CHUNK));
    pairs.for_each(|(grad, y)| {
        // A choice and no branch, so that it runs in vectors.
        grad.iter_mut().zip(y).for_each(|(grad, y)| *grad = if *y > 0.0 { *grad } else { 0.0 });
    });
}

/// Pixels that a thread takes at a time, where each has some dozens of values.
const PIXELS: usize = 1 << 10;

pub(super) fn both_signs(x: &[f32], c: usize) -> Vec<f32> {
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

pub(super) fn both_signs_backward(x: &[f32], grad_y: &[f32], c: usize) -> Vec<f32> {
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

pub(super) fn max_pool(x: &[f32], c: usize, [from, to]: [Size; 2]) -> Vec<f32> {
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
pub(super) fn max_pool_backward(
    x: &[f32],
    y: &[f32],
    grad_y: &[f32],
    c: usize,
    [from, to]: [Size; 2],
) -> Vec<f32> {
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

/// Each pixel as 2x2 pixels, of a picture of `from`.
pub(super) fn double(x: &[f32], c: usize, from: Size) -> Vec<f32> {
    let line = 2 * from.width * c;
    let mut y = vec![0.0; 2 * from.height * line];
    y.par_chunks_exact_mut(line.max(1)).enumerate().for_each(|(row, y)| {
        let x = &x[row / 2 * from.width * c..][..from.width * c];
        for (pair, pixel) in y.chunks_exact_mut(2 * c).zip(x.chunks_exact(c)) {
            pair[..c].copy_from_slice(pixel);
            pair[c..].copy_from_slice(pixel);
        }
    });
    y
}

/// The sum over the 2x2 pixels that each pixel of a picture of `from` became.
pub(super) fn double_backward(grad_y: &[f32], c: usize, from: Size) -> Vec<f32> {
    let to = Size { width: 2 * from.width, height: 2 * from.height };
    let mut grad_x = vec![0.0; from.n_pixels() * c];
    grad_x.par_chunks_exact_mut((from.width * c).max(1)).enumerate().for_each(|(row, grad_x)| {
        for (column, grad_x) in grad_x.chunks_exact_mut(c).enumerate() {
            for source in quad(to, column, row) {
                grad_x.iter_mut().zip(&grad_y[source * c..]).for_each(|(sum, value)| *sum += value);
            }
        }
    });
    grad_x
}
