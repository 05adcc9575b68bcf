//! Stochastic descent of the L1 error, one view per step, by Adam (Kingma and Ba 2015).
//!
//! The rows of f' that a view does not see are left alone in its step, moments included, and each row counts its own
//! steps. Against PyTorch's dense Adam, whose moments move unseen rows on, the held-out error is the same to 0.001 and a
//! step costs what the view sees and not what the scene holds.

use rayon::prelude::*;

use super::{
    model::Model,
    random::Random,
    samples::{GAUSSIANS_PER_PIECE, Samples},
};

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// How to descend.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// Steps, one view each.
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

    /// Rates for a few passes over the views from the closed form, whose f' have unit variance. Ten and forty times the
    /// paper's: the start is good and the steps are few. Twice or half of either costs 0.3% to 1% of the held-out error
    /// after 5 passes over 20 views of the playbot scene.
    pub fn after_closed_form(iterations: u32) -> Self {
        Self { iterations, feature_rate: 0.1, map_rate: 0.04, decay: true }
    }

    /// The factor on both rates in step `step` of 0..iterations.
    fn factor(&self, step: u32) -> f32 {
        if !self.decay {
            return 1.0;
        }
        let progress = (step as f32 + 0.5) / self.iterations as f32;
        0.5 * (1.0 + (std::f32::consts::PI * progress).cos())
    }
}

/// Descends, calling `before_step(step)` before each step and stopping when it returns false. Returns the steps taken.
pub fn refine(
    model: &mut Model,
    views: &[&Samples],
    schedule: Schedule,
    random: &mut Random,
    mut before_step: impl FnMut(u32) -> bool,
) -> u32 {
    let mut adam = Adam::new(model);
    let mut order = Vec::new();
    for step in 0..schedule.iterations {
        if order.is_empty() {
            order = random.permutation(views.len());
        }
        let Some(view) = order.pop() else { return step };
        if !before_step(step) {
            return step;
        }
        adam.step(model, views[view], schedule, schedule.factor(step));
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
    /// Steps each row of f' has had `[N]`.
    row_steps: Vec<u32>,
    basis: Moments,
    offset: Moments,
    steps: u32,
}

impl Adam {
    fn new(model: &Model) -> Self {
        Self {
            features: Moments::zeros(model.features.len()),
            row_steps: vec![0; model.features.len() / model.n_low.max(1)],
            basis: Moments::zeros(model.basis.len()),
            offset: Moments::zeros(model.offset.len()),
            steps: 0,
        }
    }

    fn step(&mut self, model: &mut Model, samples: &Samples, schedule: Schedule, factor: f32) {
        let gradient = model.gradient(samples);
        self.step_features(model, samples, &gradient.cells, schedule.feature_rate * factor);
        self.steps += 1;
        let rate = Rate::new(schedule.map_rate * factor, self.steps);
        rate.apply(&mut model.basis, &gradient.basis, &mut self.basis.first, &mut self.basis.second);
        rate.apply(&mut model.offset, &gradient.offset, &mut self.offset.first, &mut self.offset.second);
    }

    fn step_features(&mut self, model: &mut Model, samples: &Samples, cells: &[f32], rate: f32) {
        let n_low = model.n_low;
        let piece = GAUSSIANS_PER_PIECE * n_low.max(1);
        let values = model.features.par_chunks_mut(piece);
        let first = self.features.first.par_chunks_mut(piece);
        let second = self.features.second.par_chunks_mut(piece);
        let row_steps = self.row_steps.par_chunks_mut(GAUSSIANS_PER_PIECE);
        let pieces = values.zip(first).zip(second).zip(row_steps).enumerate();
        pieces.for_each_init(
            || vec![0.0; n_low],
            |gradient, (piece, (((values, first), second), row_steps))| {
                for (row, place) in samples.seen_in_piece(piece) {
                    gradient.fill(0.0);
                    samples.gather(row, cells, gradient);
                    row_steps[place] += 1;
                    let rate = Rate::new(rate, row_steps[place]);
                    let range = place * n_low..(place + 1) * n_low;
                    let (first, second) = (&mut first[range.clone()], &mut second[range.clone()]);
                    rate.apply(&mut values[range], gradient, first, second);
                }
            },
        );
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
