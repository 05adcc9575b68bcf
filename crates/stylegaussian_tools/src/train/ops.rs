//! The two custom operations of training, the KNN convolution and the splat render, for every backend of burn.
//!
//! On the CPU both run the model's own kernels with their hand-written gradients. Elsewhere the default bodies compose
//! the same sums from gathers, products and scatter-adds, so that any GPU backend trains; a test holds the two against
//! each other.

use std::sync::Arc;

use burn::{
    backend::{
        Autodiff, Backend, Dispatch, Flex, TensorMetadata,
        autodiff::{
            checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
            grads::Gradients,
            ops::{Backward, Ops, OpsKind},
        },
        backend_extension,
        tensor::FloatTensor,
    },
    tensor::{Shape, Tensor, TensorData},
};
use stylegaussian::{
    decoder::{KnnConvShape, ReverseNeighbors, knn_conv, knn_conv_backward_input, knn_conv_backward_weight},
    splat::BlendWeights,
};

mod composed;

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

    /// A picture `[H * W, 3]` of colors `[M, 3]`: the blending weights' linear map.
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

#[cfg(test)]
mod tests {
    use glam::UVec2;

    use super::*;
    use crate::random::Random;

    fn tensor(random: &mut Random, shape: [usize; 2]) -> FloatTensor<Flex> {
        let values: Vec<f32> = (0..shape[0] * shape[1]).map(|_| random.normal()).collect();
        FloatTensor::<Flex>::from_data(TensorData::new(values, shape))
    }

    fn check_close(what: &str, a: FloatTensor<Flex>, b: FloatTensor<Flex>) {
        assert_eq!(a.shape(), b.shape(), "{what}");
        let [a, b] = [a, b].map(|tensor| tensor.to_contiguous());
        for (i, (a, b)) in a.storage::<f32>().iter().zip(b.storage::<f32>()).enumerate() {
            assert!(
                (a - b).abs() < 1e-4,
                "{what}[{i}]: the CPU kernel gives {a}, the composed operation {b}"
            );
        }
    }

    #[test]
    fn kernels_match_composed_operations() {
        let mut random = Random::new(1);
        let (n_in, n_out, k, d_in, d_out) = (50, 30, 3, 7, 5);
        let neighbors = (0..n_out * k).map(|_| random.below(n_in) as u32).collect();
        let windows = Arc::new(Windows::new(neighbors, k, n_in));
        let x = tensor(&mut random, [n_in, d_in]);
        let weight = tensor(&mut random, [d_out, k * d_in]);
        let bias = tensor(&mut random, [1, d_out]).reshape(Shape::new([d_out]));
        let grad = tensor(&mut random, [n_out, d_out]);
        check_close(
            "windows_conv",
            Flex::windows_conv(x.clone(), weight.clone(), bias.clone(), windows.clone()),
            composed::windows_conv::<Flex>(x.clone(), weight.clone(), bias, &windows),
        );
        check_close(
            "windows_conv_backward_input",
            Flex::windows_conv_backward_input(weight.clone(), grad.clone(), windows.clone()),
            composed::windows_conv_backward_input::<Flex>(weight, grad.clone(), &windows),
        );
        check_close(
            "windows_conv_backward_weight",
            Flex::windows_conv_backward_weight(x.clone(), grad.clone(), windows.clone()),
            composed::windows_conv_backward_weight::<Flex>(x, grad, &windows),
        );
    }

    #[test]
    fn splat_matches_composed_operations() {
        let mut random = Random::new(2);
        let weights = Arc::new(BlendWeights {
            size: UVec2::new(2, 2),
            n_gaussians: 3,
            starts: vec![0, 2, 2, 3, 5],
            indices: vec![0, 2, 1, 2, 0],
            weights: vec![0.5, 0.25, 0.75, 0.1, 0.9],
        });
        let (colors, grad) = (tensor(&mut random, [3, 3]), tensor(&mut random, [4, 3]));
        check_close(
            "splat",
            Flex::splat(colors.clone(), weights.clone()),
            composed::splat::<Flex>(colors, &weights),
        );
        check_close(
            "splat_backward",
            Flex::splat_backward(grad.clone(), weights.clone()),
            composed::splat_backward::<Flex>(grad, &weights),
        );
    }

    /// The gradients that autodiff records against finite differences of a loss that is linear in each argument.
    #[test]
    fn recorded_gradients_match_finite_differences() {
        let device = burn::tensor::Device::flex().autodiff();
        let mut random = Random::new(3);
        let windows = Arc::new(Windows::new(vec![0, 1, 2, 2, 1, 0], 2, 3));
        let mut values = |n: usize| (0..n).map(|_| random.normal()).collect::<Vec<f32>>();
        let (x, weight, bias) = (values(6), values(12), values(3));
        let direction = values(9);
        let loss = |[x, weight, bias]: [&[f32]; 3], grads: bool| {
            let tensor = |values: &[f32], shape: [usize; 2]| {
                Tensor::<2>::from_data(TensorData::new(values.to_vec(), shape), &device).require_grad()
            };
            let (x, weight, bias) = (tensor(x, [3, 2]), tensor(weight, [3, 4]), tensor(bias, [1, 3]));
            let y = windows_conv(x.clone(), weight.clone(), bias.clone().reshape([3]), &windows);
            let loss = (y * Tensor::from_data(TensorData::new(direction.clone(), [3, 3]), &device)).sum();
            let recorded: Vec<Vec<f32>> = match grads {
                true => {
                    let grads = loss.backward();
                    let grad =
                        |tensor: &Tensor<2>| tensor.grad(&grads).unwrap().into_data().try_to_vec().unwrap();
                    vec![grad(&x), grad(&weight), grad(&bias)]
                }
                false => Vec::new(),
            };
            (loss.into_scalar::<f32>(), recorded)
        };
        let arguments = [x, weight, bias];
        let view = |arguments: &[Vec<f32>; 3]| loss([&arguments[0], &arguments[1], &arguments[2]], false).0;
        let (base, grads) = loss([&arguments[0], &arguments[1], &arguments[2]], true);
        for which in 0..3 {
            for i in 0..arguments[which].len() {
                let mut moved = arguments.clone();
                moved[which][i] += 0.5;
                let difference = (view(&moved) - base) / 0.5;
                assert!((difference - grads[which][i]).abs() < 1e-4, "argument {which}[{i}]");
            }
        }
    }
}
