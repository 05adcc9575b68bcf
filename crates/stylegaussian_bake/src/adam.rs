//! Adam on the Gaussians' colors, with one second moment for each Gaussian.

/// Decay of the two running means. The second is shorter than usual, since a bake has a hundred steps and not a
/// hundred thousand.
const BETAS: [f32; 2] = [0.9, 0.99];
/// The share of all Gaussians' root mean square that is added to each one's: one with a hundredth of the usual
/// gradient, which hardly anything sees, moves by a tenth of a step.
const DAMPING: f32 = 0.1;

/// The two running means of the gradient.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Adam {
    /// Running mean of the gradient `[N * 3]`.
    pub mean: Vec<f32>,
    /// Running mean of its squared length `[N]`. Not one for each channel: dividing each by its own would turn
    /// a small tint of the gradient into a full step in red, green or blue.
    pub square: Vec<f32>,
}

impl Adam {
    pub fn new(n_gaussians: usize) -> Self {
        Self { mean: vec![0.0; n_gaussians * 3], square: vec![0.0; n_gaussians] }
    }

    /// Moves `values` `[N * 3]` by one step against `grad`. `steps` counts those before. `scale` `[N]`
    /// multiplies the rate of each Gaussian.
    pub fn step(&mut self, values: &mut [f32], grad: &[f32], steps: u32, rate: f32, scale: &[f32]) {
        for (square, grad) in self.square.iter_mut().zip(grad.chunks_exact(3)) {
            let length: f32 = grad.iter().map(|value| value * value).sum::<f32>() / 3.0;
            *square += (1.0 - BETAS[1]) * (length - *square);
        }
        // In f64 and in order, so that the sum is the same for any number of threads.
        let seen = self.square.iter().filter(|square| **square > 0.0);
        let (n, sum) = seen.fold((0_u32, 0.0_f64), |(n, sum), square| (n + 1, sum + f64::from(*square)));
        let correction = BETAS.map(|beta| 1.0 - beta.powi(steps as i32 + 1));
        let typical = ((sum / f64::from(n.max(1))) as f32 / correction[1]).sqrt();
        let rows = values.chunks_exact_mut(3).zip(grad.chunks_exact(3)).zip(self.mean.chunks_exact_mut(3));
        for (((value, grad), mean), (square, scale)) in rows.zip(self.square.iter().zip(scale)) {
            let over =
                rate * scale / ((square / correction[1]).sqrt() + DAMPING * typical + f32::MIN_POSITIVE);
            for ((value, grad), mean) in value.iter_mut().zip(grad).zip(mean) {
                *mean += (1.0 - BETAS[0]) * (grad - *mean);
                *value -= over * *mean / correction[0];
            }
        }
    }
}
