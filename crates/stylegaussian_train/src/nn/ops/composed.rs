//! The custom operations as gathers, products and sums, for backends without their own kernels.
//!
//! They use no scatter-adds, because GPU backends run those as one invocation for each channel, which visits
//! all rows. Instead, rows that are added up lie side by side ([`segment_sums`]).

use burn::{
    backend::{
        Backend, TensorMetadata,
        tensor::{Device, FloatTensor, IntTensor},
    },
    tensor::{FloatDType, Shape, Slice, TensorData},
};
use stylegaussian::splat::BlendWeights;

use super::{Windows, pixels::VARIANCE_EPSILON};

/// Values that an operation gathers at a time: 64 MiB of f32, half of the binding size that every WebGPU
/// adapter supports. Memory then does not grow with pictures and scenes. Tests use so few that every operation
/// is cut.
const GATHERED_VALUES: usize = if cfg!(test) { 100 } else { 16 << 20 };

pub(super) fn windows_conv<B: Backend>(
    x: FloatTensor<B>,
    weight: FloatTensor<B>,
    bias: FloatTensor<B>,
    windows: &Windows,
) -> FloatTensor<B> {
    let (n_out, d_out) = (windows.n_out(), weight.shape()[0]);
    let weight = B::float_transpose(weight);
    // Gathered rows times the weights, for a part of the windows at a time.
    let parts = window_parts::<B>(&x, windows)
        .map(|part| B::float_matmul(gather_windows::<B>(&x, part, windows.k), weight.clone()));
    let y = concatenate::<B>(parts.collect(), 0);
    let bias = B::float_reshape(bias, Shape::new([1, d_out]));
    B::float_add(y, B::float_expand(bias, Shape::new([n_out, d_out])))
}

pub(super) fn windows_conv_backward_input<B: Backend>(
    weight: FloatTensor<B>,
    grad: FloatTensor<B>,
    windows: &Windows,
) -> FloatTensor<B> {
    let (d_out, k, n_entries) = (weight.shape()[0], windows.k, windows.neighbors.len());
    let d_in = weight.shape()[1] / k;
    let weight = B::float_reshape(weight, Shape::new([d_out, k, d_in]));
    let entries = (0..n_entries as u32).map(|i| (i, 1.0));
    let segments = Segments::new(&windows.neighbors, entries, windows.reverse.n_in());
    // Cut by channels and not by windows: an input row's entries come from windows anywhere.
    let n_channels = (GATHERED_VALUES / n_entries.max(1)).max(1);
    let parts = (0..d_in).step_by(n_channels).map(|first| {
        let channels = first..d_in.min(first + n_channels);
        let n_channels = channels.len();
        let slices = [Slice::from(..), Slice::from(..), Slice::from(channels)];
        let weight = B::float_slice(weight.clone(), &slices);
        let weight = B::float_reshape(weight, Shape::new([d_out, k * n_channels]));
        let rows = B::float_matmul(grad.clone(), weight);
        let rows = B::float_reshape(rows, Shape::new([n_entries, n_channels]));
        segment_sums::<B>(rows, segments.clone())
    });
    concatenate::<B>(parts.collect(), 1)
}

pub(super) fn windows_conv_backward_weight<B: Backend>(
    x: FloatTensor<B>,
    grad: FloatTensor<B>,
    windows: &Windows,
) -> FloatTensor<B> {
    let grad = B::float_transpose(grad);
    let mut start = 0;
    let parts = window_parts::<B>(&x, windows).map(|part| {
        let end = start + part.len() / windows.k;
        let grad = B::float_slice(grad.clone(), &[Slice::from(..), Slice::from(start..end)]);
        start = end;
        B::float_matmul(grad, gather_windows::<B>(&x, part, windows.k))
    });
    // Without windows there is no part, and the gradient is 0.
    parts.reduce(B::float_add).unwrap_or_else(|| {
        let shape = Shape::new([grad.shape()[0], windows.k * x.shape()[1]]);
        B::float_zeros(shape, &x.device(), FloatDType::F32)
    })
}

/// The windows `[N, K]` in parts, each with as many windows of x's rows as [`GATHERED_VALUES`] allows.
fn window_parts<'a, B: Backend>(x: &FloatTensor<B>, windows: &'a Windows) -> std::slice::Chunks<'a, u32> {
    let width = windows.k * x.shape()[1];
    windows.neighbors.chunks((GATHERED_VALUES / width.max(1)).max(1) * windows.k)
}

fn concatenate<B: Backend>(mut parts: Vec<FloatTensor<B>>, dim: usize) -> FloatTensor<B> {
    if parts.len() == 1 { parts.remove(0) } else { B::float_cat(parts, dim) }
}

pub(super) fn splat<B: Backend>(colors: FloatTensor<B>, weights: &BlendWeights) -> FloatTensor<B> {
    blend::<B>(colors, weights, &weights.indices, &pixels(weights), weights.starts.len() - 1)
}

pub(super) fn splat_backward<B: Backend>(grad: FloatTensor<B>, weights: &BlendWeights) -> FloatTensor<B> {
    blend::<B>(grad, weights, &pixels(weights), &weights.indices, weights.n_gaussians)
}

/// The four pixels of each pooled pixel, as four lists `[h * w]`. Beyond the edge the last line is repeated.
fn pooled_cells([width, height]: [usize; 2]) -> [Vec<u32>; 4] {
    let (columns, lines) = (width.div_ceil(2), height.div_ceil(2));
    [0, 1, 2, 3].map(|corner| {
        let cell = |i: usize| {
            let x = (i % columns * 2 + corner % 2).min(width - 1);
            let y = (i / columns * 2 + corner / 2).min(height - 1);
            (y * width + x) as u32
        };
        (0..columns * lines).map(cell).collect()
    })
}

pub(super) fn max_pool<B: Backend>(x: FloatTensor<B>, size: [usize; 2]) -> FloatTensor<B> {
    let device = x.device();
    let corners =
        pooled_cells(size).map(|cells| B::float_select(x.clone(), 0, indices::<B>(&cells, &device)));
    let [n_out, n_channels] = [corners[0].shape()[0], corners[0].shape()[1]];
    let corners = corners.map(|corner| B::float_reshape(corner, Shape::new([1, n_out, n_channels])));
    let largest = B::float_max_dim(B::float_cat(corners.into(), 0), 0);
    B::float_reshape(largest, Shape::new([n_out, n_channels]))
}

pub(super) fn max_pool_backward<B: Backend>(
    x: FloatTensor<B>,
    y: FloatTensor<B>,
    grad: FloatTensor<B>,
    [width, height]: [usize; 2],
) -> FloatTensor<B> {
    let device = x.device();
    let pooled = |i: usize| (i / width / 2 * width.div_ceil(2) + i % width / 2) as u32;
    let pooled: Vec<u32> = (0..width * height).map(pooled).collect();
    let spread = |tensor| B::float_select(tensor, 0, indices::<B>(&pooled, &device));
    // 0 if x is the largest of its window, otherwise 1. Ties pass the whole gradient to each, as the CPU kernel
    // does.
    let below = B::float_sign(B::float_sub(spread(y), x));
    let spread_grad = spread(grad);
    B::float_sub(spread_grad.clone(), B::float_mul(spread_grad, below))
}

/// Shares as rows `[N, C]`.
fn spread_shares<B: Backend>(x: &FloatTensor<B>, shares: &[f32]) -> FloatTensor<B> {
    let column = B::float_from_data(TensorData::new(shares.to_vec(), [shares.len(), 1]), &x.device());
    B::float_expand(column, x.shape().clone())
}

fn spread_rows<B: Backend>(row: FloatTensor<B>, like: &FloatTensor<B>) -> FloatTensor<B> {
    B::float_expand(row, like.shape().clone())
}

pub(super) fn row_statistics<B: Backend>(x: FloatTensor<B>, shares: &[f32]) -> FloatTensor<B> {
    let shares = spread_shares::<B>(&x, shares);
    let mean = B::float_sum_dim(B::float_mul(x.clone(), shares.clone()), 0);
    let deviation = B::float_sub(x.clone(), spread_rows::<B>(mean.clone(), &x));
    let variance = B::float_sum_dim(B::float_mul(B::float_mul(deviation.clone(), deviation), shares), 0);
    let std_dev = B::float_sqrt(B::float_add_scalar(variance, VARIANCE_EPSILON.into()));
    B::float_cat(vec![mean, std_dev], 0)
}

pub(super) fn row_statistics_backward<B: Backend>(
    x: FloatTensor<B>,
    statistics: FloatTensor<B>,
    grad: FloatTensor<B>,
    shares: &[f32],
) -> FloatTensor<B> {
    let device = x.device();
    let row = |tensor: &FloatTensor<B>, i: u32| {
        spread_rows::<B>(B::float_select(tensor.clone(), 0, indices::<B>(&[i], &device)), &x)
    };
    // The standard deviation has `VARIANCE_EPSILON` under its root, so it is never 0.
    let slope = B::float_div(row(&grad, 1), row(&statistics, 1));
    let deviation = B::float_sub(x.clone(), row(&statistics, 0));
    let per_share = B::float_add(row(&grad, 0), B::float_mul(slope, deviation));
    B::float_mul(per_share, spread_shares::<B>(&x, shares))
}

fn indices<B: Backend>(rows: &[u32], device: &Device<B>) -> IntTensor<B> {
    // Scenes and pictures have fewer rows than 2^31.
    let rows: Vec<i32> = rows.iter().map(|&row| row as i32).collect();
    let shape = [rows.len()];
    B::int_from_data(TensorData::new(rows, shape), device)
}

/// The rows of x in each of the windows `[N, K]`, side by side `[N, K * D_in]`.
fn gather_windows<B: Backend>(x: &FloatTensor<B>, windows: &[u32], k: usize) -> FloatTensor<B> {
    let gathered = B::float_select(x.clone(), 0, indices::<B>(windows, &x.device()));
    B::float_reshape(gathered, Shape::new([windows.len() / k, k * x.shape()[1]]))
}

/// The pixel of every blend weight.
fn pixels(weights: &BlendWeights) -> Vec<u32> {
    let spans = weights.starts.windows(2).enumerate();
    spans.flat_map(|(pixel, span)| (span[0]..span[1]).map(move |_| pixel as u32)).collect()
}

/// Sums of rows: target[to_i] += w_i source[from_i].
fn blend<B: Backend>(
    source: FloatTensor<B>,
    weights: &BlendWeights,
    from: &[u32],
    to: &[u32],
    n_target: usize,
) -> FloatTensor<B> {
    let entries = from.iter().copied().zip(weights.weights.iter().copied());
    segment_sums::<B>(source, Segments::new(to, entries, n_target))
}

/// Rows that one round of [`segment_sums`] adds up. Segments are padded to a multiple of it, and the number of
/// rounds is the longest segment's logarithm to this base. Most reverse lists of decoder neighborhoods have 8
/// entries.
const FAN_IN: usize = 8;

/// The rows of a source that are added up for each target, and their factors.
#[derive(Clone)]
pub(super) struct Segments {
    /// Start of each target's entries `[n_target + 1]`.
    starts: Vec<usize>,
    /// Source row and factor of each entry, in the targets' order.
    entries: Vec<(u32, f32)>,
}

impl Segments {
    /// Entry i goes to target `to[i]`.
    pub(super) fn new(to: &[u32], entries: impl Iterator<Item = (u32, f32)>, n_target: usize) -> Self {
        let mut starts = vec![0; n_target + 1];
        to.iter().for_each(|&target| starts[target as usize + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        // A stable counting sort: a target's entries keep their order, and so does their sum.
        let mut next = starts.clone();
        let mut sorted = vec![(0, 0.0); to.len()];
        for (entry, &target) in entries.zip(to) {
            let position = &mut next[target as usize];
            sorted[*position] = entry;
            *position += 1;
        }
        Self { starts, entries: sorted }
    }

    /// Segments padded with rows of factor 0 to a multiple of [`FAN_IN`], at least one multiple; then the
    /// segments of the sums.
    fn pad(self) -> (Vec<(u32, f32)>, Self) {
        let mut padded = Vec::with_capacity(self.entries.len() + self.starts.len() * FAN_IN / 2);
        let mut starts = vec![0];
        for span in self.starts.windows(2) {
            padded.extend_from_slice(&self.entries[span[0]..span[1]]);
            // An empty segment becomes one sum of zeros, so every target has a row.
            let n_sums = (span[1] - span[0]).div_ceil(FAN_IN).max(1);
            let end = starts.last().map_or(n_sums, |start| start + n_sums);
            // Row 0 exists in any source that is not empty, and the factor removes it.
            padded.resize(end * FAN_IN, (0, 0.0));
            starts.push(end);
        }
        let entries = (0..padded.len() / FAN_IN).map(|i| (i as u32, 1.0)).collect();
        (padded, Self { starts, entries })
    }

    /// Cuts between targets, so that no part has more than `n_slots` padded entries.
    pub(super) fn split(self, n_slots: usize) -> Vec<Self> {
        let mut parts = Vec::new();
        let (mut first, mut slots) = (0, 0);
        for target in 0..=self.n_targets() {
            let length = self.starts.get(target + 1).map_or(0, |end| end - self.starts[target]);
            let padded = length.div_ceil(FAN_IN).max(1) * FAN_IN;
            // A single target may exceed the limit: its sum cannot be cut here.
            if target == self.n_targets() || (slots + padded > n_slots && target > first) {
                let start = self.starts[first];
                let starts: Vec<usize> = self.starts[first..=target].iter().map(|at| at - start).collect();
                let entries = self.entries[start..self.starts[target]].to_vec();
                parts.push(Self { starts, entries });
                (first, slots) = (target, 0);
            }
            slots += padded;
        }
        parts
    }

    /// Whether each target has one row.
    fn is_done(&self) -> bool {
        self.entries.len() == self.n_targets()
    }

    pub(super) fn n_targets(&self) -> usize {
        self.starts.len() - 1
    }
}

/// One row for each target, from the rows of `source` `[N, C]`, for a part of the targets at a time.
pub(super) fn segment_sums<B: Backend>(source: FloatTensor<B>, segments: Segments) -> FloatTensor<B> {
    let n_slots = GATHERED_VALUES / source.shape()[1].max(1);
    let parts = segments.split(n_slots);
    concatenate::<B>(parts.into_iter().map(|part| sums::<B>(source.clone(), part)).collect(), 0)
}

/// Adds up all segments at once, in rounds of [`FAN_IN`] rows each.
fn sums<B: Backend>(source: FloatTensor<B>, mut segments: Segments) -> FloatTensor<B> {
    let (n_channels, device) = (source.shape()[1], source.device());
    let mut rows = source;
    loop {
        // Each round divides the entries by FAN_IN, until every target has one.
        let (padded, sums) = segments.pad();
        let (from, factors): (Vec<u32>, Vec<f32>) = padded.into_iter().unzip();
        let n = from.len();
        let factors = B::float_from_data(TensorData::new(factors, [n, 1]), &device);
        let gathered = B::float_select(rows, 0, indices::<B>(&from, &device));
        let weighted = B::float_mul(gathered, B::float_expand(factors, Shape::new([n, n_channels])));
        let grouped = B::float_reshape(weighted, Shape::new([n / FAN_IN, FAN_IN, n_channels]));
        rows = B::float_reshape(B::float_sum_dim(grouped, 1), Shape::new([n / FAN_IN, n_channels]));
        segments = sums;
        if segments.is_done() {
            return rows;
        }
    }
}
