//! The custom operations as sums of gathers, products and scatter-adds, for backends without a kernel of their own.

use burn::{
    backend::{
        Backend, TensorMetadata,
        tensor::{Device, FloatTensor, IntTensor},
    },
    tensor::{FloatDType, IndexingUpdateOp, Shape, TensorData},
};
use stylegaussian::splat::BlendWeights;

use super::Windows;

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
