//! The custom operations of training, above all the KNN convolution and the splat render, for every backend of
//! burn.
//!
//! On the CPU they run the model's own kernels with their hand-written gradients. On other backends the default
//! bodies compose the same operations from gathers, products and sums, so that any GPU backend can train. A
//! test compares the two.

use std::sync::Arc;

use burn::{
    backend::{Backend, Dispatch, Flex, TensorMetadata, backend_extension, tensor::FloatTensor},
    tensor::{Tensor, TensorData},
};
use rayon::prelude::*;
use stylegaussian::{
    decoder::{KnnConvShape, ReverseNeighbors, knn_conv, knn_conv_backward_input, knn_conv_backward_weight},
    splat::BlendWeights,
};

mod autodiff;
mod composed;
mod pictures;
mod pixels;

/// The rows of the input that each output row of a convolution sees: a Gaussian's neighborhood, or a kernel's
/// window on a picture.
#[derive(Debug)]
pub struct Windows {
    /// K, the number of rows in a window.
    pub k: usize,
    /// Rows of the input `[N_out, K]`.
    pub neighbors: Vec<u32>,
    /// The reverse lists, for gradients: for each input row the windows that hold it.
    pub reverse: ReverseNeighbors,
}

impl Windows {
    /// Windows `[N_out, K]` over `n_in` input rows.
    pub fn new(neighbors: Vec<u32>, k: usize, n_in: usize) -> Self {
        let reverse = ReverseNeighbors::new(&neighbors, k, n_in);
        Self { k, neighbors, reverse }
    }

    /// N_out, the number of output rows.
    pub fn n_out(&self) -> usize {
        self.neighbors.len() / self.k
    }
}

/// The custom operations. Rows are Gaussians; weights are `[D_out, K * D_in]`, neighbor-major like the model's.
#[backend_extension(Flex, Cube: cfg(feature = "gpu"), Autodiff)]
pub trait TrainingOps: Backend {
    /// y `[N_out, D_out]` of x `[N_in, D_in]`, weight `[D_out, K * D_in]`, bias `[D_out]`.
    fn windows_conv(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        composed::windows_conv::<Self>(x, weight, bias, &windows)
    }

    /// Gradient with respect to x `[N_in, D_in]`, from grad `[N_out, D_out]`.
    fn windows_conv_backward_input(
        weight: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        composed::windows_conv_backward_input::<Self>(weight, grad, &windows)
    }

    /// Gradient with respect to the weight `[D_out, K * D_in]`, from x and grad.
    fn windows_conv_backward_weight(
        x: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        composed::windows_conv_backward_weight::<Self>(x, grad, &windows)
    }

    /// y = max(0, windows_conv(x)), differentiable in x alone, for networks that are not trained.
    fn windows_conv_relu(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        Self::relu(Self::windows_conv(x, weight, bias, windows))
    }

    /// Gradient with respect to x `[N_in, D_in]`, from y and grad `[N_out, D_out]`.
    fn windows_conv_relu_backward(
        y: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        // y is never negative. If it lets the gradient through its sign is 1, otherwise 0.
        Self::windows_conv_backward_input(weight, Self::float_mul(grad, Self::float_sign(y)), windows)
    }

    /// 2x2 max-pooling of a picture x `[H * W, C]`, `size` = [W, H]. If a side is odd, its last line is kept.
    fn max_pool(x: FloatTensor<Self>, size: [usize; 2]) -> FloatTensor<Self> {
        composed::max_pool::<Self>(x, size)
    }

    /// Gradient with respect to x `[H * W, C]`, from y and grad `[h * w, C]`.
    fn max_pool_backward(
        x: FloatTensor<Self>,
        y: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        size: [usize; 2],
    ) -> FloatTensor<Self> {
        composed::max_pool_backward::<Self>(x, y, grad, size)
    }

    /// Mean and standard deviation `[2, C]` of rows x `[N, C]`, weighted by their shares `[N]`.
    fn row_statistics(x: FloatTensor<Self>, shares: Arc<Vec<f32>>) -> FloatTensor<Self> {
        composed::row_statistics::<Self>(x, &shares)
    }

    /// Gradient with respect to x `[N, C]`, from the statistics and their gradient `[2, C]`.
    fn row_statistics_backward(
        x: FloatTensor<Self>,
        statistics: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        shares: Arc<Vec<f32>>,
    ) -> FloatTensor<Self> {
        composed::row_statistics_backward::<Self>(x, statistics, grad, &shares)
    }

    /// A picture `[H * W, 3]` of colors `[M, 3]`: the linear map of the blend weights.
    fn splat(colors: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        composed::splat::<Self>(colors, &weights)
    }

    /// Gradient with respect to the colors `[M, 3]`, from grad `[H * W, 3]`.
    fn splat_backward(grad: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        composed::splat_backward::<Self>(grad, &weights)
    }
}

#[cfg(feature = "gpu")]
impl TrainingOps for burn::backend::wgpu::Wgpu {}

/// Runs a kernel on the values of contiguous tensors.
fn on_values<const N: usize>(
    tensors: [FloatTensor<Flex>; N],
    shape: impl FnOnce([&[usize]; N]) -> [usize; 2],
    kernel: impl FnOnce([&[f32]; N]) -> Vec<f32>,
) -> FloatTensor<Flex> {
    let shapes = tensors.each_ref().map(|tensor| tensor.shape().iter().copied().collect::<Vec<usize>>());
    let shape = shape(shapes.each_ref().map(Vec::as_slice));
    // A transposed or sliced tensor is a view of other values. The kernels take rows as they lie in memory.
    let tensors = tensors.map(|tensor| tensor.to_contiguous());
    let values = kernel(tensors.each_ref().map(|tensor| tensor.storage::<f32>()));
    FloatTensor::<Flex>::from_data(TensorData::new(values, shape))
}

fn conv_shape(weight: &[usize], k: usize) -> KnnConvShape {
    KnnConvShape { k, d_in: weight[1] / k, d_out: weight[0] }
}

impl TrainingOps for Flex {
    fn windows_conv(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let shape = conv_shape(&weight.shape()[..], windows.k);
        on_values(
            [x, weight, bias],
            |_| [windows.n_out(), shape.d_out],
            |[x, weight, bias]| knn_conv(shape, x, &windows.neighbors, weight, bias, |_| ()),
        )
    }

    fn windows_conv_backward_input(
        weight: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let shape = conv_shape(&weight.shape()[..], windows.k);
        on_values(
            [weight, grad],
            |_| [windows.reverse.n_in(), shape.d_in],
            |[weight, grad]| knn_conv_backward_input(shape, &windows.reverse, weight, grad),
        )
    }

    fn windows_conv_backward_weight(
        x: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let shape = KnnConvShape { k: windows.k, d_in: x.shape()[1], d_out: grad.shape()[1] };
        on_values(
            [x, grad],
            |_| [shape.d_out, shape.k * shape.d_in],
            |[x, grad]| knn_conv_backward_weight(shape, x, &windows.neighbors, grad),
        )
    }

    fn windows_conv_relu(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let shape = conv_shape(&weight.shape()[..], windows.k);
        // Applied while a block is in the cache, instead of in a pass of its own.
        let relu = |block: &mut [f32]| block.iter_mut().for_each(|value| *value = value.max(0.0));
        on_values(
            [x, weight, bias],
            |_| [windows.n_out(), shape.d_out],
            |[x, weight, bias]| knn_conv(shape, x, &windows.neighbors, weight, bias, relu),
        )
    }

    fn windows_conv_relu_backward(
        y: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let shape = conv_shape(&weight.shape()[..], windows.k);
        on_values(
            [y, weight, grad],
            |_| [windows.reverse.n_in(), shape.d_in],
            |[y, weight, grad]| {
                let pairs = y.par_iter().zip(grad);
                let passed: Vec<f32> = pairs.map(|(y, grad)| if *y > 0.0 { *grad } else { 0.0 }).collect();
                // By reverse lists each input row gathers its sum, so no two threads add to one row.
                knn_conv_backward_input(shape, &windows.reverse, weight, &passed)
            },
        )
    }

    fn max_pool(x: FloatTensor<Self>, size: [usize; 2]) -> FloatTensor<Self> {
        let n_out = size[0].div_ceil(2) * size[1].div_ceil(2);
        on_values([x], |[x]| [n_out, x[1]], |[x]| pixels::max_pool(x, size))
    }

    fn max_pool_backward(
        x: FloatTensor<Self>,
        y: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        size: [usize; 2],
    ) -> FloatTensor<Self> {
        on_values(
            [x, y, grad],
            |[x, ..]| [x[0], x[1]],
            |[x, y, grad]| pixels::max_pool_backward(x, y, grad, size),
        )
    }

    fn row_statistics(x: FloatTensor<Self>, shares: Arc<Vec<f32>>) -> FloatTensor<Self> {
        on_values([x], |[x]| [2, x[1]], |[x]| pixels::row_statistics(x, &shares))
    }

    fn row_statistics_backward(
        x: FloatTensor<Self>,
        statistics: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        shares: Arc<Vec<f32>>,
    ) -> FloatTensor<Self> {
        on_values(
            [x, statistics, grad],
            |[x, ..]| [x[0], x[1]],
            |[x, statistics, grad]| pixels::row_statistics_backward(x, &shares, statistics, grad),
        )
    }

    fn splat(colors: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        on_values(
            [colors],
            |[colors]| [weights.starts.len() - 1, colors[1]],
            |[colors]| weights.apply(colors, 3),
        )
    }

    fn splat_backward(grad: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        on_values([grad], |[grad]| [weights.n_gaussians, grad[1]], |[grad]| weights.apply_transposed(grad, 3))
    }
}

/// y `[N_out, D_out]` of x `[N_in, D_in]`, weight `[D_out, K * D_in]`, bias `[D_out]`, differentiable in all
/// three.
pub fn windows_conv(x: Tensor<2>, weight: Tensor<2>, bias: Tensor<1>, windows: &Arc<Windows>) -> Tensor<2> {
    let [x, weight] = [x, weight].map(Tensor::into_dispatch);
    Tensor::from_dispatch(<Dispatch as TrainingOps>::windows_conv(
        x,
        weight,
        bias.into_dispatch(),
        windows.clone(),
    ))
}

/// y = max(0, [`windows_conv`]), differentiable in x alone, for networks that are not trained.
pub fn windows_conv_relu(
    x: Tensor<2>,
    weight: Tensor<2>,
    bias: Tensor<1>,
    windows: &Arc<Windows>,
) -> Tensor<2> {
    let [x, weight] = [x, weight].map(Tensor::into_dispatch);
    let y = <Dispatch as TrainingOps>::windows_conv_relu(x, weight, bias.into_dispatch(), windows.clone());
    Tensor::from_dispatch(y)
}

/// 2x2 max-pooling of a picture x `[H * W, C]`, `size` = [W, H]. If a side is odd, its last line is kept.
pub fn max_pool(x: Tensor<2>, size: [usize; 2]) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as TrainingOps>::max_pool(x.into_dispatch(), size))
}

/// Mean and standard deviation `[2, C]` of rows x `[N, C]`, weighted by their shares `[N]`, which sum to 1. A
/// variance of 1e-8 is added under the root.
pub fn row_statistics(x: Tensor<2>, shares: &Arc<Vec<f32>>) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as TrainingOps>::row_statistics(x.into_dispatch(), shares.clone()))
}

/// A picture `[H * W, 3]` of colors `[M, 3]`, differentiable in the colors.
pub fn splat(colors: Tensor<2>, weights: &Arc<BlendWeights>) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as TrainingOps>::splat(colors.into_dispatch(), weights.clone()))
}

#[cfg(test)]
mod tests;
