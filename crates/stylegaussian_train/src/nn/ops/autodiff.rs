//! Gradients of the custom operations.

use std::sync::Arc;

use burn::{
    backend::{
        Autodiff, Backend, TensorMetadata,
        autodiff::{
            checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
            grads::Gradients,
            ops::{Backward, Ops, OpsKind},
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

/// Registers the gradient of an operation's one argument, computed from the state and the result's gradient.
fn pass_back<B: Backend, S>(
    ops: Ops<S, 1>,
    grads: &mut Gradients,
    gradient: impl FnOnce(S, FloatTensor<B>) -> FloatTensor<B>,
) {
    let grad = grads.consume::<B>(&ops.node);
    if let [Some(parent)] = ops.parents {
        grads.register::<B>(parent.id, gradient(ops.state, grad));
    }
}

#[derive(Debug)]
struct WindowsConvRelu;

impl<B: TrainingOps> Backward<B, 1> for WindowsConvRelu {
    type State = (FloatTensor<B>, FloatTensor<B>, Arc<Windows>);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        pass_back::<B, _>(ops, grads, |(y, weight, windows), grad| {
            B::windows_conv_relu_backward(y, weight, grad, windows)
        });
    }
}

#[derive(Debug)]
struct MaxPool;

impl<B: TrainingOps> Backward<B, 1> for MaxPool {
    type State = (FloatTensor<B>, FloatTensor<B>, [usize; 2]);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        pass_back::<B, _>(ops, grads, |(x, y, size), grad| B::max_pool_backward(x, y, grad, size));
    }
}

#[derive(Debug)]
struct RowStatistics;

impl<B: TrainingOps> Backward<B, 1> for RowStatistics {
    type State = (FloatTensor<B>, FloatTensor<B>, Arc<Vec<f32>>);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        pass_back::<B, _>(ops, grads, |(x, statistics, shares), grad| {
            B::row_statistics_backward(x, statistics, grad, shares)
        });
    }
}

#[derive(Debug)]
struct Splat;

impl<B: TrainingOps> Backward<B, 1> for Splat {
    type State = Arc<BlendWeights>;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        pass_back::<B, _>(ops, grads, |weights, grad| B::splat_backward(grad, weights));
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
        let nodes = [x.node()];
        let [x, weight, bias] = [x, weight, bias].map(|tensor| tensor.into_primitive());
        let y = B::windows_conv_relu(x, weight.clone(), bias, windows.clone());
        match WindowsConvRelu.prepare::<C>(nodes).compute_bound().stateful() {
            // y instead of x: it tells where the ReLU let a value through.
            OpsKind::Tracked(prep) => prep.finish((y.clone(), weight, windows), y),
            OpsKind::UnTracked(prep) => prep.finish(y),
        }
    }

    fn max_pool(x: FloatTensor<Self>, size: [usize; 2]) -> FloatTensor<Self> {
        let nodes = [x.node()];
        let x = x.into_primitive();
        let y = B::max_pool(x.clone(), size);
        match MaxPool.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish((x, y.clone(), size), y),
            OpsKind::UnTracked(prep) => prep.finish(y),
        }
    }

    fn row_statistics(x: FloatTensor<Self>, shares: Arc<Vec<f32>>) -> FloatTensor<Self> {
        let nodes = [x.node()];
        let x = x.into_primitive();
        let statistics = B::row_statistics(x.clone(), shares.clone());
        match RowStatistics.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish((x, statistics.clone(), shares), statistics),
            OpsKind::UnTracked(prep) => prep.finish(statistics),
        }
    }

    fn splat(colors: FloatTensor<Self>, weights: Arc<BlendWeights>) -> FloatTensor<Self> {
        let nodes = [colors.node()];
        let picture = B::splat(colors.into_primitive(), weights.clone());
        match Splat.prepare::<C>(nodes).compute_bound().stateful() {
            // The map is linear, so the colors themselves are not needed.
            OpsKind::Tracked(prep) => prep.finish(weights, picture),
            OpsKind::UnTracked(prep) => prep.finish(picture),
        }
    }
}
