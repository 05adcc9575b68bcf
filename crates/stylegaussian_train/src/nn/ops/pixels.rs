//! CPU kernels of the loss network on pictures in rows `[H * W, C]`: max-pooling and channel statistics.

use rayon::prelude::*;

/// Rows that are summed in f32 before their sum is added in f64.
const BLOCK_ROWS: usize = 512;

/// Added to variances under the root, because the root's gradient is unbounded at 0.
pub const VARIANCE_EPSILON: f32 = 1e-8;

/// 2x2 max-pooling of x `[H * W, C]`, `size` = [W, H], to `[h * w, C]`. If a side is odd, its last
/// line is kept.
pub fn max_pool(x: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
    let n_channels = x.len() / (width * height);
    let n_columns = width.div_ceil(2);
    let mut y = vec![f32::NEG_INFINITY; n_columns * height.div_ceil(2) * n_channels];
    // Two lines of the picture for each pooled one. The last odd line is a shorter chunk.
    let lines = y.par_chunks_mut(n_columns * n_channels).zip(x.par_chunks(2 * width * n_channels));
    lines.for_each(|(y, x)| {
        for (i, cell) in x.chunks_exact(n_channels).enumerate() {
            let target = &mut y[i % width / 2 * n_channels..][..n_channels];
            target.iter_mut().zip(cell).for_each(|(max, value)| *max = max.max(*value));
        }
    });
    y
}

/// Gradient with respect to x, from y = [`max_pool`] (x) and its gradient, which goes to the maximum of each
/// window. If several are equal, each gets the whole gradient. That happens only after a ReLU, at 0, which lets
/// no gradient through.
pub fn max_pool_backward(x: &[f32], y: &[f32], grad_y: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
    let n_channels = x.len() / (width * height);
    let n_columns = width.div_ceil(2);
    let mut grad_x = vec![0.0; x.len()];
    let pairs = 2 * width * n_channels;
    let pooled = y.par_chunks(n_columns * n_channels).zip(grad_y.par_chunks(n_columns * n_channels));
    let lines = grad_x.par_chunks_mut(pairs).zip(x.par_chunks(pairs)).zip(pooled);
    lines.for_each(|((grad_x, x), (y, grad_y))| {
        let cells = grad_x.chunks_exact_mut(n_channels).zip(x.chunks_exact(n_channels));
        for (i, (target, cell)) in cells.enumerate() {
            let from = i % width / 2 * n_channels;
            let pooled = y[from..][..n_channels].iter().zip(&grad_y[from..][..n_channels]);
            for ((target, value), (max, grad)) in target.iter_mut().zip(cell).zip(pooled) {
                *target = if value == max { *grad } else { 0.0 };
            }
        }
    });
    grad_x
}

/// Mean and standard deviation `[2, C]` of rows x `[N, C]` weighted by their shares `[N]`, which sum to 1.
pub fn row_statistics(x: &[f32], shares: &[f32]) -> Vec<f32> {
    let n_channels = x.len() / shares.len();
    let mean = weighted_sum(x, shares, n_channels, |value, _| value);
    // A second pass around the mean: E[x^2] - E[x]^2 cancels in f32, and can be negative.
    let variance = weighted_sum(x, shares, n_channels, |value, c| (value - mean[c]).powi(2));
    let std_dev = variance.iter().map(|variance| (variance + VARIANCE_EPSILON).sqrt());
    mean.iter().copied().chain(std_dev).collect()
}

fn weighted_sum(
    x: &[f32],
    shares: &[f32],
    n_channels: usize,
    term: impl Fn(f32, usize) -> f32 + Sync,
) -> Vec<f32> {
    let block = |(x, shares): (&[f32], &[f32])| {
        let mut sums = vec![0.0_f32; n_channels];
        for (row, share) in x.chunks_exact(n_channels).zip(shares) {
            sums.iter_mut()
                .zip(row)
                .enumerate()
                .for_each(|(c, (sum, value))| *sum += share * term(*value, c));
        }
        sums
    };
    let blocks: Vec<Vec<f32>> =
        x.par_chunks(BLOCK_ROWS * n_channels).zip(shares.par_chunks(BLOCK_ROWS)).map(block).collect();
    let channel = |c: usize| blocks.iter().map(|sums| f64::from(sums[c])).sum::<f64>() as f32;
    (0..n_channels).map(channel).collect()
}

/// Gradient with respect to x, from `statistics` = [`row_statistics`] (x) `[2, C]` and their gradient: share
/// (g_mean + g_std (x - mean) / std). The deviation's dependence on the mean cancels, because shares sum to 1.
pub fn row_statistics_backward(x: &[f32], shares: &[f32], statistics: &[f32], grad: &[f32]) -> Vec<f32> {
    let n_channels = x.len() / shares.len();
    let (mean, std_dev) = statistics.split_at(n_channels);
    let (grad_mean, grad_std_dev) = grad.split_at(n_channels);
    let slope: Vec<f32> = grad_std_dev.iter().zip(std_dev).map(|(grad, std_dev)| grad / std_dev).collect();
    // slope (x - mean) + g_mean as slope x + offset, with one multiplication per value.
    let offset: Vec<f32> =
        grad_mean.iter().zip(&slope).zip(mean).map(|((grad, slope), mean)| grad - slope * mean).collect();
    let mut grad_x = vec![0.0; x.len()];
    let blocks = grad_x.par_chunks_mut(BLOCK_ROWS * n_channels).zip(x.par_chunks(BLOCK_ROWS * n_channels));
    blocks.zip(shares.par_chunks(BLOCK_ROWS)).for_each(|((grad_x, x), shares)| {
        let rows = grad_x.chunks_exact_mut(n_channels).zip(x.chunks_exact(n_channels)).zip(shares);
        for ((target, row), share) in rows {
            let channels = target.iter_mut().zip(row).zip(slope.iter().zip(&offset));
            channels
                .for_each(|((target, value), (slope, offset))| *target = share * (slope * value + offset));
        }
    });
    grad_x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loss(values: &[f32], direction: &[f32]) -> f64 {
        values.iter().zip(direction).map(|(v, d)| f64::from(v * d)).sum()
    }

    #[track_caller]
    fn check_gradient(x: &[f32], grad: &[f32], step: f32, loss: impl Fn(&[f32]) -> f64) {
        for i in 0..x.len() {
            let moved = |by: f32| {
                let mut moved = x.to_vec();
                moved[i] += by;
                loss(&moved)
            };
            let difference = (moved(step) - moved(-step)) / f64::from(2.0 * step);
            assert!((difference - f64::from(grad[i])).abs() < 2e-3, "[{i}]: {difference}, found {}", grad[i]);
        }
    }

    #[test]
    fn pooling_takes_the_largest_of_four_and_keeps_odd_lines() {
        // 3x3 cells of two channels, the second the first's negative.
        let x: Vec<f32> = [1, 5, 2, 4, 3, 9, 8, 6, 7].iter().flat_map(|&v| [v as f32, -v as f32]).collect();
        let y = max_pool(&x, [3, 3]);
        assert_eq!(y, [5.0, -1.0, 9.0, -2.0, 8.0, -6.0, 7.0, -7.0]);
        let direction = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let grad = max_pool_backward(&x, &y, &direction, [3, 3]);
        check_gradient(&x, &grad, 0.25, |x| loss(&max_pool(x, [3, 3]), &direction));
    }

    #[test]
    fn statistics_match_a_hand_worked_case_and_finite_differences() {
        let (x, shares) = ([1.0, 2.0, 5.0, 2.0, 9.0, 6.0], [0.5, 0.25, 0.25]);
        // Means 0.5 + 1.25 + 2.25 = 4 and 1 + 0.5 + 1.5 = 3; variances 0.5 * 9 + 0.25 + 6.25 = 11 and 0.5 +
        // 0.25 + 2.25 = 3.
        let statistics = row_statistics(&x, &shares);
        let expected = [4.0, 3.0, 11.0_f32.sqrt(), 3.0_f32.sqrt()];
        assert!(statistics.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{statistics:?}");
        let direction = [1.0, -2.0, 3.0, 0.5];
        let grad = row_statistics_backward(&x, &shares, &statistics, &direction);
        check_gradient(&x, &grad, 0.01, |x| loss(&row_statistics(x, &shares), &direction));
    }
}
