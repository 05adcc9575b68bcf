//! Features of one image and their statistics.

use stylegaussian::ChannelStatistics;

/// Features of an image: D channels for each cell of a grid. The grid has a quarter of the image's size for
/// relu3_1.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureMap {
    /// Columns of the grid.
    pub width: u32,
    /// Rows of the grid.
    pub height: u32,
    /// Channels of each cell, D.
    pub n_channels: usize,
    /// Row-major, channels last `[height * width, D]`.
    pub values: Vec<f32>,
}

impl FeatureMap {
    /// Mean and unbiased standard deviation of each channel over the cells, accumulated in f64. If there is
    /// only one cell, the deviation is 0.
    ///
    /// The covariance and the encoder are `None`: this map does not know its encoder.
    pub fn statistics(&self) -> ChannelStatistics {
        // In two passes: the mean of the squares less the square of the mean would cancel if the mean is large.
        let mean = self.means();
        let mut squares = vec![0.0_f64; self.n_channels];
        for cell in self.values.chunks_exact(self.n_channels.max(1)) {
            for ((square, &value), mean) in squares.iter_mut().zip(cell).zip(&mean) {
                *square += (f64::from(value) - mean).powi(2);
            }
        }
        let divisor = self.unbiased_divisor();
        ChannelStatistics {
            mean: mean.iter().map(|&mean| mean as f32).collect(),
            std_dev: squares.iter().map(|square| (square / divisor).sqrt() as f32).collect(),
            covariance: None,
            encoder: None,
        }
    }

    /// Unbiased covariance of the channels over the cells `[D, D]`, for transfers beyond AdaIN.
    pub fn covariance(&self) -> Vec<f32> {
        let n_channels = self.n_channels;
        let mean = self.means();
        let mut products = vec![0.0_f64; n_channels * n_channels];
        let mut centered = vec![0.0_f64; n_channels];
        for cell in self.values.chunks_exact(n_channels.max(1)) {
            for ((centered, &value), mean) in centered.iter_mut().zip(cell).zip(&mean) {
                *centered = f64::from(value) - mean;
            }
            for (row, products) in products.chunks_exact_mut(n_channels).enumerate() {
                // Only the upper triangle: the matrix is symmetric.
                let factor = centered[row];
                for (product, other) in products[row..].iter_mut().zip(&centered[row..]) {
                    *product += factor * other;
                }
            }
        }
        let divisor = self.unbiased_divisor();
        let upper = |row: usize, column: usize| products[row.min(column) * n_channels + row.max(column)];
        (0..n_channels * n_channels)
            .map(|i| (upper(i / n_channels, i % n_channels) / divisor) as f32)
            .collect()
    }

    /// The number of cells.
    fn n_cells(&self) -> usize {
        self.values.len() / self.n_channels.max(1)
    }

    /// n - 1, or 1 if there is only one cell: its sum of squares is 0.
    fn unbiased_divisor(&self) -> f64 {
        self.n_cells().saturating_sub(1).max(1) as f64
    }

    fn means(&self) -> Vec<f64> {
        let mut sums = vec![0.0_f64; self.n_channels];
        for cell in self.values.chunks_exact(self.n_channels.max(1)) {
            for (sum, &value) in sums.iter_mut().zip(cell) {
                *sum += f64::from(value);
            }
        }
        let n_cells = self.n_cells().max(1) as f64;
        sums.iter().map(|sum| sum / n_cells).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two channels over three cells: (1, 10), (2, 20), (6, 60).
    fn three_cells() -> FeatureMap {
        FeatureMap { width: 3, height: 1, n_channels: 2, values: vec![1.0, 10.0, 2.0, 20.0, 6.0, 60.0] }
    }

    #[test]
    fn statistics_are_unbiased() {
        // Mean 3, deviations -2 -1 3, squares 14, over n - 1 = 2: variance 7. The second channel is ten times
        // the first.
        let statistics = three_cells().statistics();
        assert_eq!(statistics.mean, [3.0, 30.0]);
        assert_eq!(statistics.std_dev, [7.0_f32.sqrt(), 700.0_f32.sqrt()]);
        assert_eq!(three_cells().covariance(), [7.0, 70.0, 70.0, 700.0]);
    }

    #[test]
    fn one_cell_does_not_deviate() {
        let one = FeatureMap { width: 1, height: 1, n_channels: 2, values: vec![4.0, 5.0] };
        assert_eq!(one.statistics().mean, [4.0, 5.0]);
        assert_eq!(one.statistics().std_dev, [0.0, 0.0]);
        assert_eq!(one.covariance(), [0.0; 4]);
    }
}
