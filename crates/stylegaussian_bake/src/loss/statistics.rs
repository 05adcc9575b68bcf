//! Means and deviations of channels, compared with a painting's.

/// Added to variances, so that a channel that never fires has a gradient.
const EPSILON: f32 = 1e-6;

/// First and second moments of channels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Moments {
    /// Mean of each channel `[C]`.
    pub mean: Vec<f32>,
    /// Mean square of each channel `[C]`.
    pub square: Vec<f32>,
}

impl Moments {
    /// Moments of `rows` `[n, C]` over the rows in `cells`.
    pub fn of(rows: &[f32], channels: usize, cells: impl ExactSizeIterator<Item = usize>) -> Self {
        let n = cells.len().max(1) as f64;
        let (mut mean, mut square) = (vec![0.0_f64; channels], vec![0.0_f64; channels]);
        for cell in cells {
            for ((mean, square), &value) in mean.iter_mut().zip(&mut square).zip(&rows[cell * channels..]) {
                *mean += f64::from(value);
                *square += f64::from(value) * f64::from(value);
            }
        }
        let over_n = |sums: Vec<f64>| sums.into_iter().map(|sum| (sum / n) as f32).collect();
        Self { mean: over_n(mean), square: over_n(square) }
    }

    /// Moves these toward `other` by `share`.
    pub fn blend(&mut self, other: &Self, share: f32) {
        let pairs = self.mean.iter_mut().zip(&other.mean).chain(self.square.iter_mut().zip(&other.square));
        for (value, other) in pairs {
            *value += share * (other - *value);
        }
    }

    /// Deviation of each channel `[C]`.
    pub fn deviations(&self) -> Vec<f32> {
        let pairs = self.mean.iter().zip(&self.square);
        pairs.map(|(mean, square)| ((square - mean * mean).max(0.0) + EPSILON).sqrt()).collect()
    }
}

/// Means and deviations that a picture should have `[C]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Target {
    pub mean: Vec<f32>,
    pub deviation: Vec<f32>,
}

/// Mean squared error of the means plus that of the deviations of `pooled`. Adds `weight` times the gradient
/// with respect to `rows` `[n, C]` to `grad`, as if `pooled` were the moments of the rows in `cells`.
///
/// With running moments, the error is the scene's and the gradient the crop's: a crop of sky is not asked for
/// the contrast of the whole painting.
pub(crate) fn statistics(
    rows: &[f32],
    cells: &[u32],
    pooled: &Moments,
    target: &Target,
    weight: f32,
    grad: &mut [f32],
) -> f32 {
    let channels = target.mean.len();
    let deviations = pooled.deviations();
    let errors: Vec<[f32; 2]> = (0..channels)
        .map(|c| [pooled.mean[c] - target.mean[c], deviations[c] - target.deviation[c]])
        .collect();
    let sum: f32 = errors.iter().map(|[mean, deviation]| mean * mean + deviation * deviation).sum();
    // d mean / dx = 1 / n and d deviation / dx = (x - mean) / (n deviation).
    let scale = 2.0 * weight / (channels * cells.len().max(1)) as f32;
    let slopes: Vec<[f32; 2]> = errors
        .iter()
        .zip(&deviations)
        .map(|([mean, deviation], s)| [scale * mean, scale * deviation / s])
        .collect();
    for &cell in cells {
        let range = cell as usize * channels..(cell as usize + 1) * channels;
        let values = rows[range.clone()].iter().zip(&pooled.mean).zip(&slopes);
        for (grad, ((x, mean), [of_mean, of_deviation])) in grad[range].iter_mut().zip(values) {
            *grad += of_mean + of_deviation * (x - mean);
        }
    }
    sum / channels as f32
}
