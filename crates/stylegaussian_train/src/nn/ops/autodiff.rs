//! Gradients of the custom operations.

use std::{fmt::Debug, sync::Arc};

use burn::{
    backend::{
        Autodiff, Backend, TensorMetadata,
        autodiff::{
            checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
            grads::Gradients,
            ops::{Backward, NodeGuard, Ops, OpsKind, unary},
        },
        tensor::FloatTensor,
    },
    tensor::Shape,
};
use stylegaussian::splat::BlendWeights;

use super::{TrainingOps, Windows};

#[derive(Debug)]
struct WindowsConv;

impl<B: TrainingOps> Backward<B, 3> for WindowsConv {
    type State = (FloatTensor<B>, FloatTensor<B>, Arc<Windows>);

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
        let (x, weight, windows) = ops.state;
        let grad = grads.consume::<B>(&ops.node);
        // An argument that records no gradient has no node, and its gradient is not computed.
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

/// The gradient of an operation's one argument, from what was kept and the result's gradient.
#[derive(Debug)]
struct Unary<B: Backend, S>(fn(S, FloatTensor<B>) -> FloatTensor<B>);

impl<B: Backend, S: Clone + Send + Debug + 'static> Backward<B, 1> for Unary<B, S> {
    type State = S;

    fn backward(self, ops: Ops<S, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        unary::<B, _>(ops.parents, ops.node, grads, |grad| self.0(ops.state, grad));
    }
}

/// Records the result `y` of an operation of one argument, and what its gradient needs.
fn recorded<B: Backend, C: CheckpointStrategy, S: Clone + Send + Debug + 'static>(
    argument: NodeGuard,
    y: FloatTensor<B>,
    kept: S,
    gradient: fn(S, FloatTensor<B>) -> FloatTensor<B>,
) -> FloatTensor<Autodiff<B, C>> {
    match Unary(gradient).prepare::<C>([argument]).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(kept, y),
        OpsKind::UnTracked(prep) => prep.finish(y),
    }
}

impl<B: TrainingOps, C: CheckpointStrategy> TrainingOps for Autodiff<B, C> {
    fn windows_conv(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        // `compute_bound` keeps the result for the backward pass. Computing it anew would double the costliest
        // step.
        let nodes = [x.node(), weight.node(), bias.node()];
        let [x, weight, bias] = [x, weight, bias].map(|tensor| tensor.into_primitive());
        let y = B::windows_conv(x.clone(), weight.clone(), bias, windows.clone());
        match WindowsConv.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish((x, weight, windows), y),
            OpsKind::UnTracked(prep) => prep.finish(y),
        }
    }

    fn windows_conv_relu(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        windows: Arc<Windows>,
    ) -> FloatTensor<Self> {
        let (node, weight) = (x.node(), weight.into_primitive());
        let [x, bias] = [x, bias].map(|tensor| tensor.into_primitive());
        let y = B::windows_conv_relu(x, weight.clone(), bias, windows.clone());
        // y instead of x: it tells where the ReLU let a value through.
        recorded::<B, C, _>(node, y.clone(), (y, weight, windows), |(y, weight, windows), grad| {
            B::windows_conv_relu_backward(y, weight, grad, windows)
        })
    }

    fn max_pool(x: FloatTensor<Self>, size: [usize; 2]) -> FloatTensor<Self> {
        let (node, x) = (x.node(), x.into_primitive());
        let y = B::max_pool(x.clone(), size);
        recorded::<B, C, _>(node, y.clone(), (x, y, size), |(x, y, size), grad| {
            B::max_pool_backward(x, y, grad, size)
        })
    }

    fn row_statistics(x: FloatTensor<Self>, shares: Arc<Vec<f32>>) -> FloatTensor<Self> {
        let (node, x) = (x.node(), x.into_primitive());
        let statistics = B::row_statistics(x.clone(), shares.clone());
        recorded::<B, C, _>(
            node,
            statistics.clone(),
            (x, statistics, shares),
            |(x, statistics, shares), grad| B::row_statistics_backward(x, statistics, grad, shares),
        )
    }

    fn splat(colors: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        let node = colors.node();
        let picture = B::splat(colors.into_primitive(), weights.clone());
        // The map is linear, so the colors themselves are not needed.
        recorded::<B, C, _>(node, picture, weights, |weights, grad| B::splat_backward(grad, weights))
    }
}
