//! Adam (Kingma and Ba 2015) with the gradients' norm clipped.

use burn::tensor::{Gradients, Tensor};

use super::parameter::{Parameter, to_scalar};
use crate::TrainError;

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Limit of the gradients' norm over all parameters. AdaIN of a scene with a nearly constant channel
/// occasionally gives a gradient hundreds of times the usual one.
const MAX_NORM: f32 = 10.0;

/// First and second moments of every parameter.
pub struct Adam {
    /// Steps taken.
    pub step: u32,
    /// First and second moments, in the parameters' order.
    pub moments: Vec<[Tensor<2>; 2]>,
}

impl Adam {
    /// Zero moments, before the first step.
    pub fn new(parameters: &[Parameter]) -> Self {
        let zeros = |tensor: &Tensor<2>| Tensor::zeros(tensor.dims(), &tensor.device()).inner();
        let moments = parameters.iter().map(|p| [zeros(&p.values), zeros(&p.values)]).collect();
        Self { step: 0, moments }
    }

    /// Moves the parameters against the gradients. If the gradients' norm is not finite, nothing moves. Returns
    /// the norm before clipping.
    ///
    /// # Errors
    /// If the gradients cannot be read.
    pub fn update(
        &mut self,
        parameters: &mut [Parameter],
        gradients: &Gradients,
        rate: f32,
    ) -> Result<f32, TrainError> {
        let grads: Vec<Option<Tensor<2>>> =
            parameters.iter().map(|parameter| parameter.values.grad(gradients)).collect();
        let squares = grads.iter().flatten().map(|grad| to_scalar(&grad.clone().powi_scalar(2).sum()));
        let norm = squares.sum::<Result<f32, TrainError>>()?.sqrt();
        // One bad step must not spoil the moments for all steps after it.
        if !norm.is_finite() {
            return Ok(norm);
        }
        self.step += 1;
        let clip = (MAX_NORM / norm.max(1e-12)).min(1.0);
        // The moments start at zero. Without these factors the first step would be three times too large: 0.1 /
        // sqrt(0.001).
        let corrections = [1.0 - BETA_1.powi(self.step as i32), 1.0 - BETA_2.powi(self.step as i32)];
        for ((parameter, grad), moments) in parameters.iter_mut().zip(grads).zip(&mut self.moments) {
            // Parameters outside of the graph, such as the student's deviations, have no gradient and stay.
            let Some(grad) = grad.map(|grad| grad * clip) else { continue };
            let [first, second] = moments;
            *first = first.clone() * BETA_1 + grad.clone() * (1.0 - BETA_1);
            *second = second.clone() * BETA_2 + grad.powi_scalar(2) * (1.0 - BETA_2);
            let scale = (second.clone() / corrections[1]).sqrt() + EPSILON;
            let change = first.clone() / scale * (rate / corrections[0]);
            let moved = parameter.values.clone().inner() - change;
            // A new leaf: otherwise the graph of every step would hang on the one before.
            parameter.values = Tensor::from_inner(moved).require_grad();
        }
        Ok(norm)
    }
}
