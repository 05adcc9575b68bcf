//! Adam (Kingma and Ba 2015) with the gradients' norm clipped.

use burn::tensor::{Gradients, Tensor};

use super::network::Parameter;

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// The gradients' norm over all parameters is clipped to this: AdaIN of a scene with a nearly constant channel now and
/// then gives a step that is hundreds of times the usual one.
const MAX_NORM: f32 = 10.0;

/// First and second moments of every parameter.
pub struct Adam {
    /// Steps taken.
    pub step: u32,
    /// First and second moments, in the parameters' order.
    pub moments: Vec<[Tensor<2>; 2]>,
}

impl Adam {
    /// No step taken.
    pub fn new(parameters: &[Parameter]) -> Self {
        let zeros = |tensor: &Tensor<2>| Tensor::zeros(tensor.dims(), &tensor.device()).inner();
        let moments = parameters.iter().map(|p| [zeros(&p.values), zeros(&p.values)]).collect();
        Self { step: 0, moments }
    }

    /// Moves the parameters against the gradients. Returns the gradients' norm before clipping; a norm that is not
    /// finite moves nothing.
    pub fn update(&mut self, parameters: &mut [Parameter], gradients: &Gradients, rate: f32) -> f32 {
        let grads: Vec<Option<Tensor<2>>> =
            parameters.iter().map(|parameter| parameter.values.grad(gradients)).collect();
        let squares =
            grads.iter().flatten().map(|grad| grad.clone().powi_scalar(2).sum().into_scalar::<f32>());
        let norm = squares.sum::<f32>().sqrt();
        if !norm.is_finite() {
            return norm;
        }
        self.step += 1;
        let clip = (MAX_NORM / norm.max(1e-12)).min(1.0);
        let corrections = [1.0 - BETA_1.powi(self.step as i32), 1.0 - BETA_2.powi(self.step as i32)];
        for ((parameter, grad), moments) in parameters.iter_mut().zip(grads).zip(&mut self.moments) {
            let Some(grad) = grad.map(|grad| grad * clip) else { continue };
            let [first, second] = moments;
            *first = first.clone() * BETA_1 + grad.clone() * (1.0 - BETA_1);
            *second = second.clone() * BETA_2 + grad.powi_scalar(2) * (1.0 - BETA_2);
            let scale = (second.clone() / corrections[1]).sqrt() + EPSILON;
            let change = first.clone() / scale * (rate / corrections[0]);
            let moved = parameter.values.clone().inner() - change;
            parameter.values = Tensor::from_inner(moved).require_grad();
        }
        norm
    }
}
