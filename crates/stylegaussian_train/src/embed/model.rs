//! The low-rank model of features, f_p = A f'_p + b, and its L1 error and gradient on a view.

use rayon::prelude::*;
use stylegaussian::decoder::product::{Matrix, product};
use stylegaussian::random::Random;

use super::samples::{Samples, add_scaled};

/// Cells per parallel piece. The number is fixed and sums over pieces run in order, so that results do not
/// depend on the number of threads. It is so small that the residuals of a piece stay in the second-level
/// cache.
const CELLS_PER_PIECE: usize = 128;

/// Least coverage of the cells on which the error is measured. Their features are those of the scene.
const MEASURED_COVERAGE: f32 = 0.9;

/// The result of embedding. Rendered, it gives A sum_i w_i f'_i + b sum_i w_i.
#[derive(Clone, Debug)]
pub struct Model {
    /// f' `[N, L]`.
    pub features: Vec<f32>,
    /// A `[D, L]`.
    pub basis: Vec<f32>,
    /// b `[D]`.
    pub offset: Vec<f32>,
    /// L.
    pub n_latent: usize,
}

/// Derivative of a loss with respect to A, b, and the rendered f' of each cell.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// `[D, L]`.
    pub basis: Vec<f32>,
    /// `[D]`.
    pub offset: Vec<f32>,
    /// With respect to sum_i w_i f'_i of each cell `[C, L]`. [`Samples::gather`] continues it to f'.
    pub cells: Vec<f32>,
    /// Sum of |sum_i w_i (A f'_i + b) - a F| over cells and channels, times the given scale.
    pub loss: f64,
}

impl Gradient {
    /// The gradient of a sum of two losses, without cells.
    pub fn plus(mut self, other: Self) -> Self {
        add_scaled(&mut self.basis, 1.0, &other.basis);
        add_scaled(&mut self.offset, 1.0, &other.offset);
        Self { cells: Vec::new(), loss: self.loss + other.loss, ..self }
    }
}

/// Temporary arrays of one thread.
#[derive(Default)]
struct Scratch {
    /// sum_i w_i f'_i `[cells, L]`.
    latent: Vec<f32>,
    /// `[cells, D]`.
    targets: Vec<f32>,
    /// `[cells, D]`.
    residuals: Vec<f32>,
}

impl Model {
    /// The paper's start: f' standard normal, A uniform in +-1/sqrt(L), as usual for a linear layer, and b = 0.
    pub fn noise(n_gaussians: usize, n_channels: usize, n_latent: usize, random: &mut Random) -> Self {
        let n_latent = n_latent.min(n_channels);
        let bound = 1.0 / (n_latent as f32).sqrt();
        Self {
            features: (0..n_gaussians * n_latent).map(|_| random.normal()).collect(),
            basis: (0..n_channels * n_latent).map(|_| bound * (2.0 * random.uniform() - 1.0)).collect(),
            offset: vec![0.0; n_channels],
            n_latent,
        }
    }

    /// D, the number of channels.
    pub fn n_channels(&self) -> usize {
        self.offset.len()
    }

    /// Root mean square over channels of the standard deviation of f, if f' has unit variance and uncorrelated
    /// channels.
    pub fn deviation(&self) -> f32 {
        let variance: f32 = self.basis.iter().map(|a| a * a).sum();
        (variance / self.n_channels().max(1) as f32).sqrt()
    }

    /// Divides each channel of f' by `scales` `[L]` and multiplies A's column by it, so that f stays the same.
    /// A channel with scale 0 is not changed.
    pub fn rescale(&mut self, scales: &[f32]) {
        // The comparison is false for NaN too.
        let scales: Vec<f32> = scales.iter().map(|&scale| if scale > 0.0 { scale } else { 1.0 }).collect();
        for row in self.features.chunks_exact_mut(self.n_latent) {
            row.iter_mut().zip(&scales).for_each(|(value, scale)| *value /= scale);
        }
        for row in self.basis.chunks_exact_mut(self.n_latent) {
            row.iter_mut().zip(&scales).for_each(|(value, scale)| *value *= scale);
        }
    }

    /// Scales and shifts each channel of f' to mean 0 and standard deviation 1 over the Gaussians, and A and b
    /// so that f stays the same. Files store features so, because 16-bit floats are then exact to 2^-11 of a
    /// deviation at one deviation.
    pub fn standardize(&mut self) {
        let n_latent = self.n_latent;
        let n = (self.features.len() / n_latent.max(1)).max(1) as f64;
        let mean_of = |features: &[f32], of: fn(f64) -> f64| -> Vec<f64> {
            let mut mean = vec![0.0; n_latent];
            for row in features.chunks_exact(n_latent) {
                mean.iter_mut().zip(row).for_each(|(mean, &value)| *mean += of(f64::from(value)) / n);
            }
            mean
        };
        let mean: Vec<f32> = mean_of(&self.features, |value| value).iter().map(|&mean| mean as f32).collect();
        // First the shift, then the scale: b takes A m' with the A that belongs to features of the old scale.
        for row in self.features.chunks_exact_mut(n_latent) {
            add_scaled(row, -1.0, &mean);
        }
        for (offset, row) in self.offset.iter_mut().zip(self.basis.chunks_exact(n_latent)) {
            *offset += row.iter().zip(&mean).map(|(a, mean)| a * mean).sum::<f32>();
        }
        // Of centered values: the squares of values far from 0 would swamp a small variance.
        let variance = mean_of(&self.features, |value| value * value);
        self.rescale(&variance.iter().map(|variance| variance.sqrt() as f32).collect::<Vec<_>>());
    }

    /// The gradient of `scale` times the L1 error of some cells, and that error. At a residual of exactly 0, it
    /// is 0.
    pub fn gradient(&self, samples: &Samples, scale: f32) -> Gradient {
        let (n_latent, n_channels) = (self.n_latent, self.n_channels());
        let mut cells = vec![0.0; samples.n_cells() * n_latent];
        let pieces: Vec<Gradient> = cells
            .par_chunks_mut(CELLS_PER_PIECE * n_latent)
            .enumerate()
            .map_init(Scratch::default, |scratch, (piece, cells)| {
                self.piece_gradient(samples, piece * CELLS_PER_PIECE, scale, scratch, cells)
            })
            .collect();
        let zero = Gradient {
            basis: vec![0.0; n_channels * n_latent],
            offset: vec![0.0; n_channels],
            cells: Vec::new(),
            loss: 0.0,
        };
        Gradient { cells, ..pieces.into_iter().fold(zero, Gradient::plus) }
    }

    /// The gradient of one piece's cells, from `first` on. `cells` `[cells, L]` receives the part of each cell.
    fn piece_gradient(
        &self,
        samples: &Samples,
        first: usize,
        scale: f32,
        scratch: &mut Scratch,
        cells: &mut [f32],
    ) -> Gradient {
        let (n_latent, n_channels) = (self.n_latent, self.n_channels());
        let n_cells = cells.len() / n_latent;
        self.residuals(samples, first..first + n_cells, true, scratch);
        let Scratch { latent, residuals, .. } = scratch;
        let mut offset = vec![0.0; n_channels];
        let mut loss = 0.0;
        for (row, coverage) in residuals.chunks_exact_mut(n_channels).zip(&samples.coverage()[first..]) {
            // A row has D terms, few enough for f32. Rows are many, so their sum is in f64.
            loss += f64::from(row.iter().map(|residual| residual.abs()).sum::<f32>() * scale);
            for (residual, offset) in row.iter_mut().zip(&mut offset) {
                // The derivative of |r| replaces r, which nothing needs any more. Both products below read it.
                *residual = sign(*residual) * scale;
                // b enters a cell with sum_i w_i, which is its coverage.
                *offset += coverage * *residual;
            }
        }
        let signs = Matrix::dense(residuals, n_cells, n_channels);
        let mut basis = vec![0.0; n_channels * n_latent];
        product(&mut basis, false, signs.transposed(), Matrix::dense(latent, n_cells, n_latent));
        product(cells, false, signs, Matrix::dense(&self.basis, n_channels, n_latent));
        Gradient { basis, offset, cells: Vec::new(), loss }
    }

    /// Rendered features minus the cells' target: a F if `weighted` by coverage, otherwise F.
    fn residuals(
        &self,
        samples: &Samples,
        cells: std::ops::Range<usize>,
        weighted: bool,
        Scratch { latent, targets, residuals }: &mut Scratch,
    ) {
        let (n_latent, n_channels) = (self.n_latent, self.n_channels());
        let coverage = &samples.coverage()[cells.clone()];
        samples.render(&self.features, n_latent, cells.clone(), latent);
        samples.targets(cells, targets);
        residuals.resize(targets.len(), 0.0);
        let basis = Matrix::dense(&self.basis, n_channels, n_latent);
        product(residuals, false, Matrix::dense(latent, coverage.len(), n_latent), basis.transposed());
        let rows = residuals.chunks_exact_mut(n_channels).zip(targets.chunks_exact(n_channels));
        for ((row, targets), &coverage) in rows.zip(coverage) {
            let weight = if weighted { coverage } else { 1.0 };
            for ((residual, target), offset) in row.iter_mut().zip(targets).zip(&self.offset) {
                *residual += coverage * offset - weight * target;
            }
        }
    }

    /// The mean over views of the mean |rendered - true| over the channels of well-covered cells, in all parts
    /// of the view. `None` if no view has such a cell.
    pub fn mean_error(&self, views: &[&[Samples]]) -> Option<f64> {
        let error = |view: &&[Samples]| {
            let sums = view.iter().map(|part| self.error_sum(part));
            let (sum, n) = sums.fold((0.0, 0), |total, part| (total.0 + part.0, total.1 + part.1));
            (n > 0).then(|| sum / n as f64)
        };
        let errors: Vec<f64> = views.iter().filter_map(error).collect();
        (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
    }

    /// Sum of |rendered - true| over the channels of well-covered cells, and the number of its terms.
    fn error_sum(&self, samples: &Samples) -> (f64, usize) {
        let n_channels = self.n_channels();
        let n_pieces = samples.n_cells().div_ceil(CELLS_PER_PIECE);
        let pieces: Vec<(f64, usize)> = (0..n_pieces)
            .into_par_iter()
            .map_init(Scratch::default, |scratch, piece| {
                let first = piece * CELLS_PER_PIECE;
                let cells = first..(first + CELLS_PER_PIECE).min(samples.n_cells());
                // Unweighted: the error is against the encoder's features themselves, in the encoder's units.
                self.residuals(samples, cells.clone(), false, scratch);
                let rows = scratch.residuals.chunks_exact(n_channels).zip(&samples.coverage()[cells]);
                let measured = rows.filter(|&(_, &coverage)| coverage > MEASURED_COVERAGE);
                measured.fold((0.0, 0), |(sum, n), (row, _)| {
                    (sum + f64::from(row.iter().map(|residual| residual.abs()).sum::<f32>()), n + n_channels)
                })
            })
            .collect();
        pieces.iter().fold((0.0, 0), |total, piece| (total.0 + piece.0, total.1 + piece.1))
    }
}

/// The sign: -1, 0 or 1.
fn sign(value: f32) -> f32 {
    if value > 0.0 {
        1.0
    } else if value < 0.0 {
        -1.0
    } else {
        0.0
    }
}
