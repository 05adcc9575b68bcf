//! The two custom operations of training, the KNN convolution and the splat render, for every backend of burn.
//!
//! On the CPU both run the model's own kernels with their hand-written gradients. Elsewhere the default bodies compose
//! the same sums from gathers, products and scatter-adds, so that any GPU backend trains; a test holds the two against
//! each other.

use std::sync::Arc;

use burn::backend::Dispatch;
use burn::tensor::Tensor;
use burn::{
    backend::{
        Autodiff, Backend, Flex, TensorMetadata,
        autodiff::{
            checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
            grads::Gradients,
            ops::{Backward, Ops, OpsKind},
        },
        backend_extension,
        tensor::{Device, FloatTensor, IntTensor},
    },
    tensor::{FloatDType, IndexingUpdateOp, Shape, TensorData},
};
use stylegaussian::{
    decoder::{KnnConvShape, ReverseNeighbors, knn_conv, knn_conv_backward_input, knn_conv_backward_weight},
    splat::BlendWeights,
};

/// The windows of one KNN convolution: which rows of the input each output row sees.
#[derive(Debug)]
pub struct Windows {
    /// K.
    pub k: usize,
    /// Rows of the input `[N_out, K]`.
    pub neighbors: Vec<u32>,
    /// The same lists read backwards.
    pub reverse: ReverseNeighbors,
}

impl Windows {
    /// Windows `[N_out, K]` over `n_in` input rows.
    pub fn new(neighbors: Vec<u32>, k: usize, n_in: usize) -> Self {
        let reverse = ReverseNeighbors::new(&neighbors, k, n_in);
        Self { k, neighbors, reverse }
    }

    /// N_out.
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
        let device = x.device();
        let (n_out, d_out) = (windows.n_out(), weight.shape()[0]);
        let gathered = gather_windows::<Self>(x, &windows, &device);
        let y = Self::float_matmul(gathered, Self::float_transpose(weight));
        let bias = Self::float_reshape(bias, Shape::new([1, d_out]));
        Self::float_add(y, Self::float_expand(bias, Shape::new([n_out, d_out])))
    }

    /// Gradient with respect to x `[N_in, D_in]`, from grad `[N_out, D_out]`.
    fn windows_conv_backward_input(
        weight: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let device = grad.device();
        let d_in = weight.shape()[1] / windows.k;
        let rows = Self::float_matmul(grad, weight);
        let rows = Self::float_reshape(rows, Shape::new([windows.neighbors.len(), d_in]));
        let zeros = Self::float_zeros(Shape::new([windows.reverse.n_in(), d_in]), &device, FloatDType::F32);
        let indices = indices::<Self>(&windows.neighbors, &device);
        Self::float_select_assign(zeros, 0, indices, rows, IndexingUpdateOp::Add)
    }

    /// Gradient with respect to the weight `[D_out, K * D_in]`, from x and grad.
    fn windows_conv_backward_weight(
        x: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let device = x.device();
        let gathered = gather_windows::<Self>(x, &windows, &device);
        Self::float_matmul(Self::float_transpose(grad), gathered)
    }

    /// A picture `[H * W, 3]` of colors `[M, 3]`: the blending weights' linear map.
    fn splat(colors: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        let n_pixels = weights.starts.len() - 1;
        blend::<Self>(colors, &weights, &weights.indices, &pixels(&weights), n_pixels)
    }

    /// Gradient with respect to the colors `[M, 3]`, from grad `[H * W, 3]`.
    fn splat_backward(grad: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        blend::<Self>(grad, &weights, &pixels(&weights), &weights.indices, weights.n_gaussians)
    }
}

fn indices<B: Backend>(rows: &[u32], device: &Device<B>) -> IntTensor<B> {
    let rows: Vec<i32> = rows.iter().map(|&row| row as i32).collect();
    let shape = [rows.len()];
    B::int_from_data(TensorData::new(rows, shape), device)
}

/// `[N_out, K * D_in]`.
fn gather_windows<B: Backend>(x: FloatTensor<B>, windows: &Windows, device: &Device<B>) -> FloatTensor<B> {
    let d_in = x.shape()[1];
    let gathered = B::float_select(x, 0, indices::<B>(&windows.neighbors, device));
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
    let device = source.device();
    let n_channels = source.shape()[1];
    let n = weights.weights.len();
    let factors = B::float_from_data(TensorData::new(weights.weights.clone(), [n, 1]), &device);
    let rows = B::float_select(source, 0, indices::<B>(from, &device));
    let rows = B::float_mul(rows, B::float_expand(factors, Shape::new([n, n_channels])));
    let zeros = B::float_zeros(Shape::new([n_target, n_channels]), &device, FloatDType::F32);
    B::float_select_assign(zeros, 0, indices::<B>(to, &device), rows, IndexingUpdateOp::Add)
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

#[derive(Debug)]
struct WindowsConv;

impl<B: TrainingOps> Backward<B, 3> for WindowsConv {
    type State = (FloatTensor<B>, FloatTensor<B>, Arc<Windows>);

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
        let (x, weight, windows) = ops.state;
        let grad = grads.consume::<B>(&ops.node);
        let [x_node, weight_node, bias_node] = ops.parents;
        if let Some(node) = x_node {
            grads.register::<B>(
                node.id,
                B::windows_conv_backward_input(weight, grad.clone(), windows.clone()),
            );
        }
        if let Some(node) = weight_node {
            grads.register::<B>(node.id, B::windows_conv_backward_weight(x, grad.clone(), windows));
        }
        if let Some(node) = bias_node {
            let d_out = grad.shape()[1];
            grads.register::<B>(node.id, B::float_reshape(B::float_sum_dim(grad, 0), Shape::new([d_out])));
        }
    }
}

#[derive(Debug)]
struct Splat;

impl<B: TrainingOps> Backward<B, 1> for Splat {
    type State = Arc<BlendWeights>;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let grad = grads.consume::<B>(&ops.node);
        if let [Some(node)] = ops.parents {
            grads.register::<B>(node.id, B::splat_backward(grad, ops.state));
        }
    }
}

impl<B: TrainingOps, C: CheckpointStrategy> TrainingOps for Autodiff<B, C> {
    fn windows_conv(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let nodes = [x.node(), weight.node(), bias.node()];
        let [x, weight, bias] = [x, weight, bias].map(|tensor| tensor.into_primitive());
        let y = B::windows_conv(x.clone(), weight.clone(), bias, windows.clone());
        match WindowsConv.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish((x, weight, windows), y),
            OpsKind::UnTracked(prep) => prep.finish(y),
        }
    }

    fn splat(colors: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        let nodes = [colors.node()];
        let picture = B::splat(colors.into_primitive(), weights.clone());
        match Splat.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(weights, picture),
            OpsKind::UnTracked(prep) => prep.finish(picture),
        }
    }
}

/// y `[N_out, D_out]` of x `[N_in, D_in]`, weight `[D_out, K * D_in]`, bias `[D_out]`, differentiable in all three.
pub fn windows_conv(x: Tensor<2>, weight: Tensor<2>, bias: Tensor<1>, windows: &Arc<Windows>) -> Tensor<2> {
    let [x, weight] = [x, weight].map(Tensor::into_dispatch);
    Tensor::from_dispatch(<Dispatch as TrainingOps>::windows_conv(
        x,
        weight,
        bias.into_dispatch(),
        windows.clone(),
    ))
}

/// A picture `[H * W, 3]` of colors `[M, 3]`, differentiable in the colors.
pub fn splat(colors: Tensor<2>, weights: &Arc<BlendWeights>) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as TrainingOps>::splat(colors.into_dispatch(), weights.clone()))
}
