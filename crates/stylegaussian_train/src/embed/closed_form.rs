//! The start without any iteration over views: a PCA basis, and weighted means over the cells of each Gaussian.
//!
//! b is the mean of the views' features weighted by coverage, and A has their first L principal directions.
//! Because the columns are orthonormal, F' = A^T (F - b) are the best coordinates of a cell. Each Gaussian gets
//! the mean over its cells: f'_p = sum w F' / sum w. Each channel is then scaled to unit variance, and A takes
//! the factor, so that one learning rate suits all.

use rayon::prelude::*;
use stylegaussian::decoder::product::{Matrix, product};
use stylegaussian::random::Random;

use super::{
    model::Model,
    samples::{GAUSSIANS_PER_PIECE, Samples, add_scaled},
};

/// Directions that are iterated beyond the L wanted. The error of the L-th falls with the ratio of eigenvalues
/// L + 8 and L.
const OVERSAMPLING: usize = 8;
/// Rounds of orthogonal iteration. Directions with nearly equal eigenvalues stay mixed, which does no harm.
const ROUNDS: usize = 40;

/// Mean and covariance of the views' features, cells weighted by coverage.
struct Moments {
    /// `[D]`.
    mean: Vec<f32>,
    /// `[D, D]`.
    covariance: Vec<f64>,
}

/// PCA basis and lifted features of `n_gaussians` Gaussians, with at most `n_latent` latent features. Gaussians
/// that no view sees get 0, the mean.
pub fn closed_form(views: &[&[Samples]], n_channels: usize, n_gaussians: usize, n_latent: usize) -> Model {
    let n_latent = n_latent.min(n_channels);
    // The first part of each view stands for all: thousands of cells are plenty for a covariance.
    let first_parts: Vec<&Samples> = views.iter().filter_map(|view| view.first()).collect();
    let Moments { mean, covariance } = moments(&first_parts, n_channels);
    let basis = principal_directions(&covariance, n_channels, n_latent);
    let mut model = Model { features: vec![0.0; n_gaussians * n_latent], basis, offset: mean, n_latent };
    let parts: Vec<&Samples> = views.iter().copied().flatten().collect();
    let weights = lift(&mut model, &parts);
    equalize(&mut model, &weights);
    model
}

fn moments(views: &[&Samples], n_channels: usize) -> Moments {
    // Two passes, mean first. A single pass would subtract the mean's square from the mean of squares, and lose
    // the digits of channels whose mean is large.
    let sums: Vec<(f64, Vec<f64>)> = views.par_iter().map(|samples| weighted_sum(samples)).collect();
    let total = sums.iter().map(|(weight, _)| weight).sum::<f64>().max(f64::MIN_POSITIVE);
    let mut mean = vec![0.0; n_channels];
    for (_, sum) in &sums {
        mean.iter_mut().zip(sum).for_each(|(mean, sum)| *mean += sum / total);
    }
    let mean: Vec<f32> = mean.iter().map(|&mean| mean as f32).collect();
    let products: Vec<Vec<f32>> = views.par_iter().map(|samples| centered_products(samples, &mean)).collect();
    // In the order of the views, and in f64: f32 is precise enough for the cells of one view, not for all
    // views.
    let mut covariance = vec![0.0; n_channels * n_channels];
    for products in products {
        covariance.iter_mut().zip(products).for_each(|(sum, value)| *sum += f64::from(value) / total);
    }
    Moments { mean, covariance }
}

/// Sums of a and of a F `[D]` over the cells of a view.
fn weighted_sum(samples: &Samples) -> (f64, Vec<f64>) {
    let mut sum = vec![0.0; samples.n_channels()];
    let mut targets = Vec::new();
    samples.targets(0..samples.n_cells(), &mut targets);
    for (target, &coverage) in targets.chunks_exact(samples.n_channels().max(1)).zip(samples.coverage()) {
        sum.iter_mut().zip(target).for_each(|(sum, value)| *sum += f64::from(coverage * value));
    }
    (samples.coverage().iter().map(|&coverage| f64::from(coverage)).sum(), sum)
}

/// Sum of a (F - mean) (F - mean)^T `[D, D]` over the cells of a view.
fn centered_products(samples: &Samples, mean: &[f32]) -> Vec<f32> {
    let n_channels = mean.len();
    let mut rows = Vec::new();
    samples.targets(0..samples.n_cells(), &mut rows);
    for (row, coverage) in rows.chunks_exact_mut(n_channels.max(1)).zip(samples.coverage()) {
        // Both factors of the product get the root, so the product gets the coverage.
        let weight = coverage.sqrt();
        row.iter_mut().zip(mean).for_each(|(value, mean)| *value = weight * (*value - mean));
    }
    let rows = Matrix::dense(&rows, samples.n_cells(), n_channels);
    let mut products = vec![0.0; n_channels * n_channels];
    product(&mut products, false, rows.transposed(), rows);
    products
}

/// The `n` leading eigenvectors of a covariance `[D, D]` as columns `[D, n]`, by orthogonal iteration.
/// Directions without variance are 0.
fn principal_directions(covariance: &[f64], n_channels: usize, n: usize) -> Vec<f32> {
    // Not the option's seed: the directions found hardly depend on where the iteration starts.
    let mut random = Random::new(0);
    let n_directions = (n + OVERSAMPLING).min(n_channels);
    let mut directions: Vec<Vec<f64>> =
        (0..n_directions).map(|_| (0..n_channels).map(|_| f64::from(random.normal())).collect()).collect();
    // The sum of all eigenvalues. A vector that multiplication shrinks to a billionth of it holds only rounding
    // errors, and normalizing it would make a direction of them.
    let trace: f64 = (0..n_channels).map(|d| covariance[d * n_channels + d]).sum();
    for _ in 0..ROUNDS {
        directions.par_iter_mut().for_each(|direction| {
            *direction = covariance.chunks_exact(n_channels).map(|row| dot(row, direction)).collect();
        });
        orthonormalize(&mut directions, trace * 1e-9);
    }
    let mut basis = vec![0.0; n_channels * n];
    for (column, direction) in directions.iter().take(n).enumerate() {
        for (d, &value) in direction.iter().enumerate() {
            basis[d * n + column] = value as f32;
        }
    }
    basis
}

/// Gram-Schmidt orthonormalization. Vectors that become shorter than `floor` are set to 0.
fn orthonormalize(vectors: &mut [Vec<f64>], floor: f64) {
    for i in 0..vectors.len() {
        let (before, [vector, ..]) = vectors.split_at_mut(i) else { return };
        // Modified Gram-Schmidt: each projection is of the previous one's remainder, which is stable in finite
        // precision.
        for other in before.iter() {
            let along = dot(vector, other);
            vector.iter_mut().zip(other).for_each(|(value, other)| *value -= along * other);
        }
        let length = dot(vector, vector).sqrt();
        let factor = if length > floor { 1.0 / length } else { 0.0 };
        vector.iter_mut().for_each(|value| *value *= factor);
    }
}

/// The scalar product, in eight partial sums, which the compiler turns into SIMD.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    for (a, b) in a.chunks(8).zip(b.chunks(8)) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum()
}

/// Sets f'_p = sum w F' / sum w, and returns the sums of weights `[N]`, in cells.
fn lift(model: &mut Model, parts: &[&Samples]) -> Vec<f32> {
    let n_latent = model.n_latent;
    let coordinates: Vec<Vec<f32>> = parts.par_iter().map(|samples| coordinates(model, samples)).collect();
    let mut weights = vec![0.0; model.features.len() / n_latent.max(1)];
    // Threads share Gaussians and not views: no two write to one sum, and each sum runs over the views in
    // order.
    let pieces = model.features.par_chunks_mut(GAUSSIANS_PER_PIECE * n_latent.max(1));
    pieces.zip(weights.par_chunks_mut(GAUSSIANS_PER_PIECE)).enumerate().for_each(
        |(piece, (features, weights))| {
            for (samples, coordinates) in parts.iter().zip(&coordinates) {
                for (row, place) in samples.seen_in_piece(piece) {
                    weights[place] +=
                        samples.gather(row, coordinates, &mut features[place * n_latent..][..n_latent]);
                }
            }
            for (feature, &weight) in features.chunks_exact_mut(n_latent).zip(weights.iter()) {
                // An unseen Gaussian keeps 0, the mean. Its division would be 0 / 0.
                let factor = if weight > 0.0 { 1.0 / weight } else { 0.0 };
                feature.iter_mut().for_each(|value| *value *= factor);
            }
        },
    );
    weights
}

/// F' = A^T (F - b) of every cell `[C, L]`.
fn coordinates(model: &Model, samples: &Samples) -> Vec<f32> {
    let n_channels = model.n_channels();
    let mut rows = Vec::new();
    samples.targets(0..samples.n_cells(), &mut rows);
    for row in rows.chunks_exact_mut(n_channels.max(1)) {
        add_scaled(row, -1.0, &model.offset);
    }
    let mut coordinates = vec![0.0; samples.n_cells() * model.n_latent];
    let basis = Matrix::dense(&model.basis, n_channels, model.n_latent);
    product(&mut coordinates, false, Matrix::dense(&rows, samples.n_cells(), n_channels), basis);
    coordinates
}

/// Divides each channel of f' by its root mean square, weighted by how much of each Gaussian is seen. A takes
/// the factor.
fn equalize(model: &mut Model, weights: &[f32]) {
    let n_latent = model.n_latent;
    let mut squares = vec![0.0_f64; n_latent];
    for (feature, &weight) in model.features.chunks_exact(n_latent.max(1)).zip(weights) {
        squares.iter_mut().zip(feature).for_each(|(sum, value)| *sum += f64::from(weight * value * value));
    }
    let total: f64 = weights.iter().map(|&weight| f64::from(weight)).sum();
    // NaN if nothing is seen. `rescale` then leaves the channels as they are.
    let deviations: Vec<f32> = squares.iter().map(|square| (square / total).sqrt() as f32).collect();
    model.rescale(&deviations);
}
