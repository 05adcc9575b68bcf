//! Convolutions of pictures: rows of pixels with channels last, `[h * w, C]`.
//!
//! A stride s turns s x s pixels into one pixel of s x s times as many channels, so every convolution is a
//! correlation of stride 1 without a border. Its gradient is one as well, with the kernel turned around. In a
//! correlation, the windows of a line of pixels are rows of one matrix that overlap in memory, so nothing is
//! gathered.

use std::borrow::Cow;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use stylegaussian::{
    decoder::product::{Matrix, product},
    work::Work,
};

use super::size::Size;

/// Columns of a product, if there are as many: the values of two vectors of AVX2. A product with fewer takes as
/// long.
const COLUMNS: usize = 16;

/// How a convolution sees beyond the picture's border.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Padding {
    /// As in a mirror, so many pixels above and left, and below and right. The border itself is not repeated.
    Reflect([usize; 2]),
    /// As zeros, so many on each side.
    Zeros(usize),
}

impl Padding {
    /// Pixels above and left, and below and right.
    fn pixels(self) -> [usize; 2] {
        match self {
            Self::Reflect(pixels) => pixels,
            Self::Zeros(zeros) => [zeros; 2],
        }
    }
}

/// A correlation y_p = sum_d W_d x_{p+d} over the d of a square, where the square lies within the picture.
#[derive(Clone, Debug)]
struct Correlation {
    /// Side of the square, in pixels.
    side: usize,
    d_in: usize,
    d_out: usize,
    /// `[side, side, D_in, D_out]`.
    weight: Vec<f32>,
}

impl Correlation {
    /// y `[h * w, D_out]` for a y of `size`, from x, which is larger by `side - 1`. Lines of y begin as copies
    /// of `bias` `[D_out]`, and `finish` is applied to each finished one. If `work` is canceled, lines are left
    /// out.
    fn apply(
        &self,
        x: &[f32],
        size: Size,
        bias: &[f32],
        finish: impl Fn(&mut [f32]) + Sync,
        work: &Work,
    ) -> Vec<f32> {
        let Self { side, d_in, d_out, .. } = *self;
        // Neighbors whose results are one row of the product: their windows are one window, somewhat wider.
        let widest = (COLUMNS / d_out).max(1);
        let joined = (1..=widest).rev().find(|joined| size.width.is_multiple_of(*joined)).unwrap_or(1);
        let (inner, weight) = (self.inner(joined), self.joined(joined));
        let x_line = (size.width + side - 1) * d_in;
        let mut y = vec![0.0; size.n_pixels() * d_out];
        y.par_chunks_mut((size.width * d_out).max(1)).enumerate().for_each(|(row, y)| {
            if work.is_canceled() {
                return;
            }
            y.chunks_exact_mut(d_out).for_each(|pixel| pixel.copy_from_slice(bias));
            for (line, weight) in weight.chunks_exact(inner * joined * d_out).enumerate() {
                let x = &x[(row + line) * x_line..][..x_line];
                let windows = Matrix::strided(x, size.width / joined, inner, joined * d_in);
                product(y, true, windows, Matrix::dense(weight, inner, joined * d_out));
            }
            finish(y);
        });
        y
    }

    /// Values of a line of the window of so many joined neighbors.
    fn inner(&self, joined: usize) -> usize {
        (joined + self.side - 1) * self.d_in
    }

    /// The weights of so many joined neighbors `[side, inner, joined, D_out]`, zeros where a neighbor does not
    /// look.
    fn joined(&self, joined: usize) -> Cow<'_, [f32]> {
        if joined == 1 {
            return Cow::Borrowed(&self.weight);
        }
        let (d_out, line) = (self.d_out, self.side * self.d_in);
        let inner = self.inner(joined);
        let mut weight = vec![0.0; self.side * inner * joined * d_out];
        let lines =
            weight.chunks_exact_mut(inner * joined * d_out).zip(self.weight.chunks_exact(line * d_out));
        for (target, source) in lines {
            for neighbor in 0..joined {
                for (i, of_value) in source.chunks_exact(d_out).enumerate() {
                    let row = neighbor * self.d_in + i;
                    target[(row * joined + neighbor) * d_out..][..d_out].copy_from_slice(of_value);
                }
            }
        }
        Cow::Owned(weight)
    }
}

/// The place of a weight in a kernel of blocks of stride x stride pixels.
struct Place {
    /// The block, row-major.
    block: usize,
    /// The input's value within the block.
    value: usize,
    output: usize,
    /// Values of a block.
    d_block: usize,
}

impl Place {
    /// The place of weight i of a kernel `[D_out, D_in, side, side]`.
    fn of(i: usize, [d_in, side]: [usize; 2], stride: usize) -> Self {
        let (x, y) = (i % side, i / side % side);
        let (input, output) = (i / (side * side) % d_in, i / (side * side * d_in));
        Self {
            block: y / stride * (side / stride) + x / stride,
            value: (y % stride * stride + x % stride) * d_in + input,
            output,
            d_block: stride * stride * d_in,
        }
    }

    /// Its index in the weight of the correlation.
    fn forward(&self, d_out: usize) -> usize {
        (self.block * self.d_block + self.value) * d_out + self.output
    }
}

/// The parameters of a convolution.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    /// `[D_out, D_in, height, width]`.
    pub shape: [usize; 4],
    /// Row-major in `shape`.
    pub weight: Vec<f32>,
    /// `[D_out]`.
    pub bias: Vec<f32>,
}

/// A convolution, with a ReLU behind it if [`rectified`](Self::rectified).
#[derive(Clone, Debug)]
pub struct Convolution {
    /// Channels of the input.
    d_in: usize,
    /// Side of the kernel, in pixels; a multiple of the stride.
    side: usize,
    /// Distance between neighboring outputs, in pixels.
    stride: usize,
    padding: Padding,
    forward: Correlation,
    /// The gradient with respect to the input of `forward`.
    backward: Correlation,
    /// `[D_out]`.
    bias: Vec<f32>,
    relu: bool,
}

/// Most pixels of a kernel's side, of a stride, and of a border. The networks here need 6.
const MOST_PIXELS: usize = 32;

impl Convolution {
    /// A convolution of stride 1 without ReLU.
    ///
    /// # Errors
    /// A description of the kernel if it is not square, if its numbers do not fit its shape or are not finite,
    /// or if it or its border is larger than 32 pixels.
    pub fn new(kernel: &Kernel, padding: Padding) -> Result<Self, String> {
        Self::strided(kernel, padding, 1)
    }

    /// A convolution without ReLU at every `stride`-th row and column.
    ///
    /// # Errors
    /// As [`new`](Self::new), or if the kernel's side is no multiple of the stride.
    pub fn strided(kernel: &Kernel, padding: Padding, stride: usize) -> Result<Self, String> {
        let [d_out, d_in, height, side] = kernel.shape;
        let n = kernel.shape.into_iter().try_fold(1, usize::checked_mul);
        if height != side || !(1..=MOST_PIXELS).contains(&side) || d_in == 0 || d_out == 0 {
            return Err(format!("a kernel of the shape {:?}", kernel.shape));
        }
        if n != Some(kernel.weight.len()) || kernel.bias.len() != d_out {
            let (n, biases) = (kernel.weight.len(), kernel.bias.len());
            return Err(format!("{n} weights and {biases} biases for the shape {:?}", kernel.shape));
        }
        if kernel.weight.iter().chain(&kernel.bias).any(|value| !value.is_finite()) {
            return Err("a weight that is not finite".into());
        }
        if stride == 0 || !side.is_multiple_of(stride) {
            return Err(format!("a stride of {stride} for a kernel of {side} pixels"));
        }
        let [before, after] = padding.pixels();
        if before.max(after) > MOST_PIXELS {
            return Err(format!("a border of {} pixels", before.max(after)));
        }
        Ok(Self::of([d_out, d_in, side], &kernel.weight, kernel.bias.clone(), padding, stride))
    }

    fn of(
        [d_out, d_in, side]: [usize; 3],
        oihw: &[f32],
        bias: Vec<f32>,
        padding: Padding,
        stride: usize,
    ) -> Self {
        // In blocks of stride x stride pixels.
        let (blocks, d_block) = (side / stride, stride * stride * d_in);
        let mut forward = vec![0.0; oihw.len()];
        let mut backward = vec![0.0; oihw.len()];
        for (i, &weight) in oihw.iter().enumerate() {
            let place = Place::of(i, [d_in, side], stride);
            forward[place.forward(d_out)] = weight;
            let turned = blocks * blocks - 1 - place.block;
            backward[(turned * d_out + place.output) * d_block + place.value] = weight;
        }
        let forward = Correlation { side: blocks, d_in: d_block, d_out, weight: forward };
        let backward = Correlation { side: blocks, d_in: d_out, d_out: d_block, weight: backward };
        Self { d_in, side, stride, padding, forward, backward, bias, relu: false }
    }

    /// The same with a ReLU behind it.
    pub fn rectified(self) -> Self {
        Self { relu: true, ..self }
    }

    /// Whether a ReLU is behind it.
    pub fn relu(&self) -> bool {
        self.relu
    }

    /// Distance between neighboring outputs, in pixels.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Its view beyond the picture's border.
    pub fn padding(&self) -> Padding {
        self.padding
    }

    /// Channels that it takes.
    pub fn d_in(&self) -> usize {
        self.d_in
    }

    /// Channels that it gives.
    pub fn d_out(&self) -> usize {
        self.forward.d_out
    }

    /// Its parameters.
    pub fn kernel(&self) -> Kernel {
        let (d_in, d_out, side) = (self.d_in, self.d_out(), self.side);
        let n = d_out * d_in * side * side;
        let place = |i| Place::of(i, [d_in, side], self.stride);
        let weight = (0..n).map(|i| self.forward.weight[place(i).forward(d_out)]).collect();
        Kernel { shape: [d_out, d_in, side, side], weight, bias: self.bias.clone() }
    }

    /// The size of the result for a picture of `size`; 0 if the picture with its border is smaller than the
    /// kernel.
    pub(super) fn size_after(&self, size: Size) -> Size {
        let [before, after] = self.padding.pixels();
        let places = |n: usize| {
            n.saturating_add(before + after).checked_sub(self.side).map_or(0, |rest| rest / self.stride + 1)
        };
        Size { width: places(size.width), height: places(size.height) }
    }

    /// The convolution of a picture of `size` `[h * w, D_in]`. If `work` is canceled, parts of it are missing.
    pub(super) fn forward(&self, x: &[f32], size: Size, work: &Work) -> Vec<f32> {
        let rectify = |line: &mut [f32]| {
            if self.relu {
                line.iter_mut().for_each(|value| *value = value.max(0.0));
            }
        };
        self.forward.apply(&self.blocks(x, size), self.size_after(size), &self.bias, rectify, work)
    }

    /// The gradient with respect to a picture of `size`, from the one with respect to the result before the
    /// ReLU. If `work` is canceled, parts of it are missing.
    pub(super) fn backward(&self, grad_y: &[f32], size: Size, work: &Work) -> Vec<f32> {
        let (from, border) = (self.size_after(size), self.forward.side - 1);
        let grad_y = with_zeros(grad_y, self.d_out(), from, border);
        let zeros = vec![0.0; self.backward.d_out];
        let grad = self.backward.apply(&grad_y, from.plus(border), &zeros, |_| (), work);
        self.fold(grad, size)
    }

    /// Whether the correlation sees the picture itself.
    fn sees_all_once(&self) -> bool {
        self.stride == 1 && matches!(self.padding, Padding::Reflect([0, 0]) | Padding::Zeros(0))
    }

    /// For every line of pixels that is seen, the picture's own line `0..n` there; none if it is beyond a
    /// border of zeros.
    fn seen(&self, n: usize, places: usize) -> Vec<Option<usize>> {
        let source = |at: usize| match self.padding {
            Padding::Reflect([before, _]) => Some(reflected(at as isize - before as isize, n)),
            Padding::Zeros(zeros) => at.checked_sub(zeros).filter(|&at| at < n),
        };
        (0..(places - 1) * self.stride + self.side).map(source).collect()
    }

    /// Rows and columns that are seen, and the size of the picture of blocks.
    fn border(&self, size: Size) -> ([Vec<Option<usize>>; 2], Size) {
        let places = self.size_after(size);
        let seen = [self.seen(size.height, places.height), self.seen(size.width, places.width)];
        (seen, places.plus(self.forward.side - 1))
    }

    /// The place of a pixel within a line of blocks: `line` of the stride lines of pixels there, and the
    /// pixel's `column`.
    fn value(&self, line: usize, column: usize) -> usize {
        let (stride, block) = (self.stride, self.forward.d_in);
        column / stride * block + (line * stride + column % stride) * self.d_in
    }

    /// The picture with its border, as blocks of stride x stride pixels.
    fn blocks<'a>(&self, x: &'a [f32], size: Size) -> Cow<'a, [f32]> {
        if self.sees_all_once() {
            return Cow::Borrowed(x);
        }
        let (d_in, ([rows, columns], blocks)) = (self.d_in, self.border(size));
        let line_of_blocks = blocks.width * self.forward.d_in;
        let mut seen = vec![0.0; blocks.height * line_of_blocks];
        let lines = seen.par_chunks_mut(line_of_blocks).zip(rows.par_chunks(self.stride));
        lines.for_each(|(seen, rows)| {
            for (line, row) in rows.iter().enumerate() {
                let Some(row) = row else { continue };
                let x = &x[row * size.width * d_in..][..size.width * d_in];
                for (column, source) in columns.iter().enumerate() {
                    if let Some(source) = source {
                        let target = &mut seen[self.value(line, column)..][..d_in];
                        target.copy_from_slice(&x[source * d_in..][..d_in]);
                    }
                }
            }
        });
        Cow::Owned(seen)
    }

    /// The transpose of [`Self::blocks`]: sums the values of all appearances of each pixel.
    fn fold(&self, seen: Vec<f32>, size: Size) -> Vec<f32> {
        if self.sees_all_once() {
            return seen;
        }
        let (d_in, ([rows, columns], blocks)) = (self.d_in, self.border(size));
        let line_of_blocks = blocks.width * self.forward.d_in;
        let mut x = vec![0.0; size.n_pixels() * d_in];
        x.par_chunks_mut(size.width * d_in).enumerate().for_each(|(row, x)| {
            let seen_at = rows.iter().enumerate().filter(|(_, source)| **source == Some(row));
            for (at, _) in seen_at {
                let seen = &seen[at / self.stride * line_of_blocks..][..line_of_blocks];
                for (column, source) in columns.iter().enumerate() {
                    if let Some(source) = source {
                        let of_pixel = &seen[self.value(at % self.stride, column)..][..d_in];
                        let target = &mut x[source * d_in..][..d_in];
                        target.iter_mut().zip(of_pixel).for_each(|(sum, value)| *sum += value);
                    }
                }
            }
        });
        x
    }
}

/// The picture `[h * w, C]` within a border of so many zeros on each side.
fn with_zeros(x: &[f32], channels: usize, size: Size, border: usize) -> Cow<'_, [f32]> {
    if border == 0 {
        return Cow::Borrowed(x);
    }
    let line = (size.width + 2 * border) * channels;
    let mut padded = vec![0.0; (size.height + 2 * border) * line];
    let lines = padded[border * line..].par_chunks_mut(line).zip(x.par_chunks(size.width * channels));
    lines.for_each(|(padded, x)| padded[border * channels..][..x.len()].copy_from_slice(x));
    Cow::Owned(padded)
}

/// The pixel 0..n that a mirror shows at `at`, with as many reflections as it takes.
fn reflected(at: isize, n: usize) -> usize {
    let period = 2 * (n as isize - 1).max(1);
    let at = at.rem_euclid(period);
    (at.min(period - at) as usize).min(n - 1)
}

#[cfg(test)]
mod tests {
    use stylegaussian::random::Random;

    use super::*;

    #[test]
    fn a_mirror_does_not_repeat_the_border() {
        let shown: Vec<usize> = (-3..6).map(|at| reflected(at, 3)).collect();
        assert_eq!(shown, [1, 2, 1, 0, 1, 2, 1, 0, 1]);
        assert!((-3..4).all(|at| reflected(at, 1) == 0));
    }

    /// A convolution by its definition, in f64.
    struct Direct<'a> {
        shape: [usize; 3],
        oihw: &'a [f32],
        bias: &'a [f32],
        padding: Padding,
        stride: usize,
    }

    impl Direct<'_> {
        fn source(&self, at: usize, n: usize) -> Option<usize> {
            match self.padding {
                Padding::Reflect([before, _]) => Some(reflected(at as isize - before as isize, n)),
                Padding::Zeros(zeros) => at.checked_sub(zeros).filter(|&at| at < n),
            }
        }

        /// Calls `visit` with each index of y, of x and of the kernel that are multiplied.
        fn for_each(&self, from: Size, to: Size, mut visit: impl FnMut(usize, usize, usize)) {
            let [d_out, d_in, side] = self.shape;
            for p in 0..to.n_pixels() {
                for d in 0..side * side {
                    let row = self.source(p / to.width * self.stride + d / side, from.height);
                    let column = self.source(p % to.width * self.stride + d % side, from.width);
                    let Some((row, column)) = row.zip(column) else { continue };
                    for output in 0..d_out {
                        for input in 0..d_in {
                            let x = (row * from.width + column) * d_in + input;
                            visit(p * d_out + output, x, (output * d_in + input) * side * side + d);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn both_directions_are_those_of_the_definition() {
        let mut random = Random::new(1);
        // Sizes that are no multiple of the stride, a picture smaller than its kernel, and few channels, which
        // are joined.
        for (shape, padding, stride, size) in [
            ([5, 3, 6], Padding::Reflect([2, 3]), 2, [13, 9]),
            ([3, 4, 3], Padding::Reflect([1, 1]), 1, [12, 7]),
            ([20, 2, 2], Padding::Zeros(0), 2, [9, 6]),
            ([2, 3, 3], Padding::Zeros(1), 1, [10, 4]),
            ([7, 6, 1], Padding::Zeros(0), 1, [5, 4]),
            ([2, 2, 3], Padding::Reflect([1, 1]), 1, [1, 2]),
        ] {
            let [d_out, d_in, side] = shape;
            let mut values = |n: usize| -> Vec<f32> { (0..n).map(|_| random.normal()).collect() };
            let (oihw, bias) = (values(d_out * d_in * side * side), values(d_out));
            let convolution = Convolution::of(shape, &oihw, bias.clone(), padding, stride);
            let from = Size { width: size[0], height: size[1] };
            assert_eq!(convolution.kernel().weight, oihw);
            let to = convolution.size_after(from);
            let (x, grad_y) = (values(from.n_pixels() * d_in), values(to.n_pixels() * d_out));
            let direct = Direct { shape, oihw: &oihw, bias: &bias, padding, stride };
            let mut y: Vec<f64> = (0..grad_y.len()).map(|i| f64::from(direct.bias[i % d_out])).collect();
            let mut grad_x = vec![0.0; x.len()];
            direct.for_each(from, to, |of_y, of_x, weight| {
                let weight = f64::from(direct.oihw[weight]);
                y[of_y] += weight * f64::from(x[of_x]);
                grad_x[of_x] += weight * f64::from(grad_y[of_y]);
            });
            for (found, expected) in [
                (convolution.forward(&x, from, &Work::default()), y),
                (convolution.backward(&grad_y, from, &Work::default()), grad_x),
            ] {
                assert_eq!(found.len(), expected.len(), "{shape:?} {padding:?}");
                for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
                    let off = (f64::from(*found) - expected).abs();
                    assert!(off < 1e-4, "{shape:?} {padding:?} [{i}]: {found} for {expected}");
                }
            }
        }
    }
}
