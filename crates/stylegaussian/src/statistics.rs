//! Channel statistics of features, which AdaIN matches.

use std::future::{Future, ready};

use rayon::prelude::*;

use crate::{encoder_id::EncoderId, scene::Features, slices::at_once};

/// Mean and unbiased standard deviation of D channels, over pixels of an image or over Gaussians of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelStatistics {
    /// Mean of each channel `[D]`.
    pub mean: Vec<f32>,
    /// Unbiased (n - 1) standard deviation of each channel `[D]`.
    pub std_dev: Vec<f32>,
    /// Unbiased covariance `[D, D]`, row-major, for transfers beyond AdaIN.
    pub covariance: Option<Vec<f32>>,
    /// The encoder of these channels, or `None` if the file does not name it.
    pub encoder: Option<EncoderId>,
}

/// Mean and standard deviation of a scene's features in the encoder's D channels, in f64.
#[derive(Clone, Debug, PartialEq)]
pub struct ContentStatistics {
    /// mean(f) = A mean(f') + b `[D]`.
    pub mean: Vec<f64>,
    /// std(f) `[D]`, with [`STD_DEV_EPSILON`] added. If the scene names its encoder, [`STD_DEV_FLOOR`] applies
    /// as well.
    pub std_dev: Vec<f64>,
}

/// Added to every standard deviation, so that AdaIN never divides by zero. The value is that of the paper's
/// implementation.
pub const STD_DEV_EPSILON: f64 = 1e-8;

/// Least std(f) as a share of its median over channels. Without it AdaIN would magnify channels that hardly
/// vary in the scene without bound.
///
/// Applies to scenes that name their encoder. Checkpoints of the original name none and keep
/// [`STD_DEV_EPSILON`] alone, so that they stylize exactly like the original.
pub const STD_DEV_FLOOR: f64 = 1e-3;

impl ContentStatistics {
    /// Statistics over all Gaussians, each with the same weight, as in the paper.
    ///
    /// Computed from the covariance of the latent features: std(f)_d = sqrt((A Cov(f') A^T)_dd) + 1e-8,
    /// unbiased. The full features `[N, D]` are never formed. If N <= 1, std(f) is 1e-8.
    pub fn of(features: &Features) -> Self {
        at_once(Self::of_in_slices(features, &mut || ready(())))
    }

    /// [`of`](Self::of) in [slices](crate::slices).
    pub async fn of_in_slices<P: Future<Output = ()>>(
        features: &Features,
        pause: &mut impl FnMut() -> P,
    ) -> Self {
        let n_latent = features.n_latent;
        let mean_latent = mean_latent(features);
        let covariance = covariance_in_slices(features, &mean_latent, pause).await;
        let row = |d: usize| features.basis[d * n_latent..][..n_latent].iter().map(|a| f64::from(*a));
        let mean = |d: usize| {
            f64::from(features.offset[d]) + row(d).zip(&mean_latent).map(|(a, m)| a * m).sum::<f64>()
        };
        // Only the diagonal of A Cov A^T is needed: D L^2 operations, and D^2 L more for the whole.
        let variance = |d: usize| -> f64 {
            row(d)
                .enumerate()
                .map(|(i, a)| a * row(d).zip(&covariance[i * n_latent..]).map(|(a, c)| a * c).sum::<f64>())
                .sum()
        };
        let channels = 0..features.n_channels();
        let mut std_dev: Vec<f64> =
            // Rounding can leave a variance of zero slightly below it.
            channels.clone().into_par_iter().map(|d| variance(d).max(0.0).sqrt() + STD_DEV_EPSILON).collect();
        if features.encoder.is_some() {
            // The median, and not the mean, which a few strong channels would dominate.
            let mut sorted = std_dev.clone();
            sorted.sort_by(f64::total_cmp);
            let floor = STD_DEV_FLOOR * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
            std_dev.iter_mut().for_each(|value| *value = value.max(floor));
        }
        Self { mean: channels.map(mean).collect(), std_dev }
    }
}

/// mean(f') `[L]` in f64, or zeros if there is no Gaussian.
pub fn mean_latent(features: &Features) -> Vec<f64> {
    let n = (features.values.len() / features.n_latent).max(1) as f64;
    // One thread, so that the order of additions is fixed. Beside the covariance it costs little.
    let mut mean = vec![0.0; features.n_latent];
    for row in features.values.chunks_exact(features.n_latent) {
        mean.iter_mut().zip(row).for_each(|(sum, value)| *sum += f64::from(*value));
    }
    mean.iter_mut().for_each(|sum| *sum /= n);
    mean
}

/// Unbiased Cov(f') `[L, L]` in f64, or zeros if N <= 1, with mean(f') `[L]`, in [slices](crate::slices).
///
/// Blocks of rows are centered and multiplied in f64, then added in order, so the result does not depend on the
/// number of threads.
async fn covariance_in_slices<P: Future<Output = ()>>(
    features: &Features,
    mean: &[f64],
    pause: &mut impl FnMut() -> P,
) -> Vec<f64> {
    // Large enough that the L x L sum of a block costs little beside its rows, small enough to occupy all
    // threads.
    const BLOCK_ROWS: usize = 1024;
    // Enough for all threads of most machines.
    const SLICE_BLOCKS: usize = 16;
    let n_latent = features.n_latent;
    let n = features.values.len() / n_latent;
    // Centered first. The formula in one pass, E(x y) - E(x) E(y), cancels if means are large beside
    // deviations.
    let block_sum = |rows: &[f32]| {
        let centered: Vec<f64> =
            // A block begins with channel 0, because its length is a multiple of L.
            rows.iter().enumerate().map(|(i, value)| f64::from(*value) - mean[i % n_latent]).collect();
        let mut sum = vec![0.0; n_latent * n_latent];
        for row in centered.chunks_exact(n_latent) {
            for (target, a) in sum.chunks_exact_mut(n_latent).zip(row) {
                target.iter_mut().zip(row).for_each(|(t, b)| *t += a * b);
            }
        }
        sum
    };
    let mut covariance = vec![0.0; n_latent * n_latent];
    for slice in features.values.chunks(SLICE_BLOCKS * BLOCK_ROWS * n_latent) {
        let blocks: Vec<Vec<f64>> = slice.par_chunks(BLOCK_ROWS * n_latent).map(block_sum).collect();
        for block in blocks {
            covariance.iter_mut().zip(block).for_each(|(sum, value)| *sum += value);
        }
        pause().await;
    }
    // The sum over one Gaussian or none is 0, whatever it is divided by.
    let divisor = if n > 1 { (n - 1) as f64 } else { 1.0 };
    covariance.iter_mut().for_each(|sum| *sum /= divisor);
    covariance
}
