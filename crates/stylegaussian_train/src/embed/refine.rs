//! Stochastic descent of the L1 error with Adam (Kingma and Ba 2015), one view or part of a view per step.
//!
//! A step changes only the rows of f' that it sees, and their moments, and each row counts its own steps.
//! PyTorch's dense Adam also moves unseen rows. The held-out error is the same to 0.001, and the cost of a step
//! depends on the view instead of the scene.

use rayon::prelude::*;
use stylegaussian::random::Random;

use super::{
    model::{Gradient, Model},
    samples::{GAUSSIANS_PER_PIECE, Samples},
};

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Steps and learning rates of a descent.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// Steps, one batch each.
    pub iterations: u32,
    /// Learning rate of f'.
    pub feature_rate: f32,
    /// Learning rate of A and b.
    pub map_rate: f32,
    /// Whether the rates fall to 0 along half a cosine.
    pub decay: bool,
}

impl Schedule {
    /// The paper's rates.
    pub fn optimize(iterations: u32) -> Self {
        Self { iterations, feature_rate: 0.01, map_rate: 0.001, decay: false }
    }

    /// Rates for a few steps from a closed form with f' of unit variance: ten and about sixty times the
    /// paper's. The rate of A and b is proportional to the encoder's scale, which is that of the closed form's
    /// A.
    ///
    /// On the playbot scene, half of either rate increases the held-out error by 0.3% to 1%, and twice changes
    /// nothing.
    pub fn after_closed_form(iterations: u32, closed_form: &Model) -> Self {
        let map_rate = 0.05 * closed_form.deviation();
        Self { iterations, feature_rate: 0.1, map_rate, decay: true }
    }

    /// The factor on both rates at step `step` of 0..iterations.
    fn factor(&self, step: u32) -> f32 {
        if !self.decay {
            return 1.0;
        }
        // The middle of the step, so that the last step still moves.
        let progress = (step as f32 + 0.5) / self.iterations as f32;
        0.5 * (1.0 + (std::f32::consts::PI * progress).cos())
    }
}

/// Descends with one batch of `batches` per step, in random order. Calls `before_step(step)` before each step,
/// and stops if it returns false. Returns the number of steps taken.
pub fn refine(
    model: &mut Model,
    batches: &[&[Samples]],
    schedule: Schedule,
    random: &mut Random,
    mut before_step: impl FnMut(u32) -> bool,
) -> u32 {
    let mut adam = Adam::new(model);
    let mut order = Vec::new();
    for step in 0..schedule.iterations {
        // Every batch once before any comes again. Drawing with replacement would leave views out for long.
        if order.is_empty() {
            order = random.permutation(batches.len());
        }
        let Some(batch) = order.pop() else { return step };
        if !before_step(step) {
            return step;
        }
        adam.step(model, batches[batch], schedule, schedule.factor(step));
    }
    schedule.iterations
}

/// First and second moments of one group of parameters.
#[derive(Clone, Debug)]
struct Moments {
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Moments {
    fn zeros(n: usize) -> Self {
        Self { first: vec![0.0; n], second: vec![0.0; n] }
    }
}

/// The state of the descent.
struct Adam {
    features: Moments,
    /// Steps that changed each row of f' `[N]`.
    row_steps: Vec<u32>,
    basis: Moments,
    offset: Moments,
    steps: u32,
}

impl Adam {
    fn new(model: &Model) -> Self {
        Self {
            features: Moments::zeros(model.features.len()),
            row_steps: vec![0; model.features.len() / model.n_latent.max(1)],
            basis: Moments::zeros(model.basis.len()),
            offset: Moments::zeros(model.offset.len()),
            steps: 0,
        }
    }

    /// Takes a step on the mean absolute error over the cells and channels of a batch.
    fn step(&mut self, model: &mut Model, batch: &[Samples], schedule: Schedule, factor: f32) {
        let n_terms = batch.iter().map(Samples::n_cells).sum::<usize>() * model.n_channels();
        // All gradients before any parameter moves: those of f' depend on A, and those of A on f'.
        let gradients: Vec<Gradient> =
            batch.iter().map(|samples| model.gradient(samples, 1.0 / n_terms as f32)).collect();
        self.step_features(model, batch, &gradients, schedule.feature_rate * factor);
        let Some(sum) = gradients.into_iter().reduce(Gradient::plus) else { return };
        self.steps += 1;
        let rate = Rate::new(schedule.map_rate * factor, self.steps);
        rate.apply(&mut model.basis, &sum.basis, &mut self.basis.first, &mut self.basis.second);
        rate.apply(&mut model.offset, &sum.offset, &mut self.offset.first, &mut self.offset.second);
    }

    fn step_features(&mut self, model: &mut Model, batch: &[Samples], gradients: &[Gradient], rate: f32) {
        let n_latent = model.n_latent;
        let piece = GAUSSIANS_PER_PIECE * n_latent;
        let values = model.features.par_chunks_mut(piece);
        let first = self.features.first.par_chunks_mut(piece);
        let second = self.features.second.par_chunks_mut(piece);
        let row_steps = self.row_steps.par_chunks_mut(GAUSSIANS_PER_PIECE);
        // Threads share Gaussians, as in the closed form, so sums do not depend on the number of threads.
        values.zip(first).zip(second).zip(row_steps).enumerate().for_each_init(
            || RowGradients::new(n_latent),
            |rows, (piece, (((values, first), second), row_steps))| {
                for (samples, gradient) in batch.iter().zip(gradients) {
                    rows.add(samples, piece, &gradient.cells);
                }
                rows.drain(|place, gradient| {
                    // The bias correction of a row counts the row's own steps. With the common count, rows
                    // first seen late would start with steps three times too large: 0.1 / sqrt(0.001).
                    row_steps[place] += 1;
                    let rate = Rate::new(rate, row_steps[place]);
                    let range = place * n_latent..(place + 1) * n_latent;
                    let (first, second) = (&mut first[range.clone()], &mut second[range.clone()]);
                    rate.apply(&mut values[range], gradient, first, second);
                });
            },
        );
    }
}

/// Gradients of the rows of f' of one piece of Gaussians.
struct RowGradients {
    n_latent: usize,
    /// Sums of gradients `[GAUSSIANS_PER_PIECE, L]`, 0 if nothing was added.
    sums: Vec<f32>,
    seen: [bool; GAUSSIANS_PER_PIECE],
}

impl RowGradients {
    fn new(n_latent: usize) -> Self {
        Self { n_latent, sums: vec![0.0; GAUSSIANS_PER_PIECE * n_latent], seen: [false; GAUSSIANS_PER_PIECE] }
    }

    fn add(&mut self, samples: &Samples, piece: usize, cells: &[f32]) {
        for (row, place) in samples.seen_in_piece(piece) {
            samples.gather(row, cells, &mut self.sums[place * self.n_latent..][..self.n_latent]);
            self.seen[place] = true;
        }
    }

    /// Passes on the rows to which something was added, and clears them.
    fn drain(&mut self, mut take: impl FnMut(usize, &[f32])) {
        for (place, (sum, seen)) in self.sums.chunks_exact_mut(self.n_latent).zip(&mut self.seen).enumerate()
        {
            // Rayon hands these arrays from one piece to the next, so they must leave as they came: all zero.
            if std::mem::take(seen) {
                take(place, sum);
                sum.fill(0.0);
            }
        }
    }
}

/// A learning rate with the moments' bias corrections.
struct Rate {
    step: f32,
    second_correction: f32,
}

impl Rate {
    fn new(rate: f32, steps: u32) -> Self {
        // From here on both corrections are 1 to the last bit of an f32.
        // 0.999^20,000 = 2e-9, less than half of an f32's last bit at 1.
        let steps = steps.min(20_000) as i32;
        Self { step: rate / (1.0 - BETA_1.powi(steps)), second_correction: 1.0 / (1.0 - BETA_2.powi(steps)) }
    }

    fn apply(&self, values: &mut [f32], gradient: &[f32], first: &mut [f32], second: &mut [f32]) {
        for (((value, &g), m), v) in values.iter_mut().zip(gradient).zip(first).zip(second) {
            *m = BETA_1 * *m + (1.0 - BETA_1) * g;
            *v = BETA_2 * *v + (1.0 - BETA_2) * g * g;
            *value -= self.step * *m / ((self.second_correction * *v).sqrt() + EPSILON);
        }
    }
}
