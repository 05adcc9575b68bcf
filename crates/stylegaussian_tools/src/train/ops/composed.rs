//! The custom operations as sums of gathers, products and scatter-adds, for backends without a kernel of their own.

use burn::{
    backend::{
        Backend, TensorMetadata,
        tensor::{Device, FloatTensor, IntTensor},
    },
    tensor::{FloatDType, IndexingUpdateOp, Shape, TensorData},
};
use stylegaussian::splat::BlendWeights;

use super::{Windows, pixels::VARIANCE_EPSILON};

pub(super) fn windows_conv<B: Backend>(
    x: FloatTensor<B>,
    weight: FloatTensor<B>,
    bias: FloatTensor<B>,
    windows: &Windows,
) -> FloatTensor<B> {
    let (n_out, d_out) = (windows.n_out(), weight.shape()[0]);
    let y = B::float_matmul(gather_windows::<B>(x, windows), B::float_transpose(weight));
    let bias = B::float_reshape(bias, Shape::new([1, d_out]));
    B::float_add(y, B::float_expand(bias, Shape::new([n_out, d_out])))
}

pub(super) fn windows_conv_backward_input<B: Backend>(
    weight: FloatTensor<B>,
    grad: FloatTensor<B>,
    windows: &Windows,
) -> FloatTensor<B> {
    let device = grad.device();
    let d_in = weight.shape()[1] / windows.k;
    let rows = B::float_reshape(B::float_matmul(grad, weight), Shape::new([windows.neighbors.len(), d_in]));
    let zeros = B::float_zeros(Shape::new([windows.reverse.n_in(), d_in]), &device, FloatDType::F32);
    let indices = indices::<B>(&windows.neighbors, &device);
    B::float_select_assign(zeros, 0, indices, rows, IndexingUpdateOp::Add)
}

pub(super) fn windows_conv_backward_weight<B: Backend>(
    x: FloatTensor<B>,
    grad: FloatTensor<B>,
    windows: &Windows,
) -> FloatTensor<B> {
    B::float_matmul(B::float_transpose(grad), gather_windows::<B>(x, windows))
}

pub(super) fn splat<B: Backend>(colors: FloatTensor<B>, weights: &BlendWeights) -> FloatTensor<B> {
    blend::<B>(colors, weights, &weights.indices, &pixels(weights), weights.starts.len() - 1)
}

pub(super) fn splat_backward<B: Backend>(grad: FloatTensor<B>, weights: &BlendWeights) -> FloatTensor<B> {
    blend::<B>(grad, weights, &pixels(weights), &weights.indices, weights.n_gaussians)
}

/// The cells of each pooled cell, one in four windows `[h * w]`; beyond the edge the last line again.
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
    // 1 where x is its window's largest, 0 where it is less.
    let below = B::float_sign(B::float_sub(spread(y), x));
    let spread_grad = spread(grad);
    B::float_sub(spread_grad.clone(), B::float_mul(spread_grad, below))
}

/// Shares `[N, C]`, one row for each.
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
    let slope = B::float_div(row(&grad, 1), row(&statistics, 1));
    let deviation = B::float_sub(x.clone(), row(&statistics, 0));
    let per_share = B::float_add(row(&grad, 0), B::float_mul(slope, deviation));
    B::float_mul(per_share, spread_shares::<B>(&x, shares))
}

fn indices<B: Backend>(rows: &[u32], device: &Device<B>) -> IntTensor<B> {
    let rows: Vec<i32> = rows.iter().map(|&row| row as i32).collect();
    let shape = [rows.len()];
    B::int_from_data(TensorData::new(rows, shape), device)
}

/// `[N_out, K * D_in]`.
fn gather_windows<B: Backend>(x: FloatTensor<B>, windows: &Windows) -> FloatTensor<B> {
    let (d_in, device) = (x.shape()[1], x.device());
    let gathered = B::float_select(x, 0, indices::<B>(&windows.neighbors, &device));
    B::float_reshape(gathered, Shape::new([windows.n_out(), windows.k * d_in]))
}

/// The pixel of every blending weight.
fn pixels(weights: &BlendWeights) -> Vec<u32> {
    let spans = weights.starts.windows(2).enumerate();
    spans.flat_map(|(pixel, span)| (span[0]..span[1]).map(move |_| pixel as u32)).collect()
}

/// target[to_i] += w_i source[from_i].
fn blend<B: Backend>(
    source: FloatTensor<B>,
    weights: &BlendWeights,
    from: &[u32],
    to: &[u32],
    n_target: usize,
) -> FloatTensor<B> {
    let (n_channels, device) = (source.shape()[1], source.device());
    let n = weights.weights.len();
    let factors = B::float_from_data(TensorData::new(weights.weights.clone(), [n, 1]), &device);
    let rows = B::float_select(source, 0, indices::<B>(from, &device));
    let rows = B::float_mul(rows, B::float_expand(factors, Shape::new([n, n_channels])));
    let zeros = B::float_zeros(Shape::new([n_target, n_channels]), &device, FloatDType::F32);
    B::float_select_assign(zeros, 0, indices::<B>(to, &device), rows, IndexingUpdateOp::Add)
}
