//! Training data of one view: the encoder's features of its cells, and the Gaussians in each cell.
//!
//! A cell of the feature map covers a square of pixels, so the weight of a Gaussian in a cell is the mean of
//! its blend weights over those pixels. Rendering at the feature map's own size would be wrong: the rasterizer
//! widens every splat by 0.3 px^2, which is much in pixels of four times the size. On the playbot scene that
//! adds a quarter to the held-out error.
//!
//! A cell with coverage a = sum_i w_i shows the scene with weight a and the background with weight 1 - a. The
//! scene's part of the cell's features F is therefore taken as a F, and the residual is sum_i w_i (A f'_i + b)
//! - a F. It weighs cells by coverage, so cells without scene have no influence.
//!
//! The cells of a view are split into four interleaved parts, like a chess board with four colors. Neighboring
//! cells show nearly the same Gaussians, so a quarter of the cells gives nearly the gradient of all.

use half::{f16, slice::HalfFloatSliceExt};
use rayon::prelude::*;
use stylegaussian::splat::BlendWeights;
use stylegaussian_encoder::FeatureMap;

/// Cells with less coverage are left out, because they show hardly anything but background.
const MIN_COVERAGE: f32 = 0.05;

/// Blend weights are stored as multiples of this, in 16 bits. The error is at most 0.8e-5.
const WEIGHT_UNIT: f32 = 1.0 / 65_535.0;

/// Gaussians per parallel piece of [`Samples::gather`]. The number is fixed, so that results do not depend on
/// the number of threads.
pub const GAUSSIANS_PER_PIECE: usize = 1024;

/// A feature map does not fit the view's size.
#[derive(Debug, thiserror::Error)]
#[error(
    "the encoder's feature map is {}x{} for a picture of {}x{}, expected the same power of two \
     fewer cells both ways",
    map[0], map[1], picture[0], picture[1]
)]
pub struct CellSizeError {
    map: [u32; 2],
    picture: [u32; 2],
}

/// Parts on a side of the repeated square: there are 2x2 interleaved parts.
const PARTS_PER_SIDE: usize = 2;

/// Covered cells of one part of a view, C of them, with sparse weights both ways: by cell and by Gaussian.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// D.
    n_channels: usize,
    /// Sum of weights of each cell `[C]`, 0..1.
    coverage: Vec<f32>,
    /// Encoder features of each cell `[C, D]`.
    targets: Vec<f16>,
    by_cell: Sparse,
    /// Gaussians with any weight, ascending `[S]`; rows of `by_gaussian`.
    seen: Vec<u32>,
    by_gaussian: Sparse,
}

/// Rows of (index, weight) pairs.
#[derive(Clone, Debug, Default)]
struct Sparse {
    /// Start of each row, and end of the last `[rows + 1]`.
    starts: Vec<u32>,
    indices: Vec<u32>,
    /// In [`WEIGHT_UNIT`]s.
    weights: Vec<u16>,
}

impl Sparse {
    fn row(&self, row: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        let weights = self.weights[range.clone()].iter().map(|&weight| f32::from(weight) * WEIGHT_UNIT);
        self.indices[range].iter().map(|&index| index as usize).zip(weights)
    }

    fn push(&mut self, index: u32, weight: u16) {
        self.indices.push(index);
        self.weights.push(weight);
    }

    /// Columns with any entry, in ascending order, and the transpose with one row for each of them.
    fn transposed(&self, n_columns: usize) -> (Vec<u32>, Self) {
        // A counting sort. `slots` first holds the number of entries of each column, then the place of its next
        // entry.
        let mut slots = vec![0_u32; n_columns];
        for &column in &self.indices {
            slots[column as usize] += 1;
        }
        let columns: Vec<u32> = (0..n_columns as u32).filter(|&column| slots[column as usize] > 0).collect();
        let mut starts = vec![0_u32];
        for &column in &columns {
            let start = starts[starts.len() - 1];
            // Reads the count and leaves the start of the column's row in its place.
            starts.push(start + std::mem::replace(&mut slots[column as usize], start));
        }
        let (mut indices, mut weights) = (vec![0; self.indices.len()], vec![0; self.weights.len()]);
        // Rows in ascending order, so each transposed row is ascending too, and sums over it have one order.
        for row in 0..self.starts.len() - 1 {
            for entry in self.starts[row] as usize..self.starts[row + 1] as usize {
                let slot = &mut slots[self.indices[entry] as usize];
                (indices[*slot as usize], weights[*slot as usize]) = (row as u32, self.weights[entry]);
                *slot += 1;
            }
        }
        (columns, Self { starts, indices, weights })
    }
}

impl Samples {
    /// Averages `weights`, at the picture's size, over the cells of `features`, and splits the covered cells
    /// into parts. A part without cells is left out.
    ///
    /// # Errors
    /// If a cell is not a square of pixels whose side is a power of two.
    pub fn of_view(weights: &BlendWeights, features: &FeatureMap) -> Result<Vec<Self>, CellSizeError> {
        let side = cell_side(features, weights)?;
        let columns = features.width as usize;
        let cells: Vec<Vec<(u32, u16)>> = (0..columns * features.height as usize)
            .into_par_iter()
            .map_init(Vec::new, |entries, cell| {
                cell_weights(weights, side, [cell % columns, cell / columns], entries)
            })
            .collect();
        let mut parts = vec![Self::empty(features.n_channels); PARTS_PER_SIDE * PARTS_PER_SIDE];
        // Chunks of 0 values would panic. A map without channels gives no targets.
        let targets = features.values.chunks_exact(features.n_channels.max(1));
        for (cell, (entries, target)) in cells.iter().zip(targets).enumerate() {
            let [column, row] = [cell % columns, cell / columns].map(|place| place % PARTS_PER_SIDE);
            parts[row * PARTS_PER_SIDE + column].push_cell(entries, target);
        }
        parts.retain(|part| part.n_cells() > 0);
        parts.par_iter_mut().for_each(|part| {
            (part.seen, part.by_gaussian) = part.by_cell.transposed(weights.n_gaussians);
        });
        Ok(parts)
    }

    fn empty(n_channels: usize) -> Self {
        let mut empty = Self { n_channels, ..Self::default() };
        empty.by_cell.starts.push(0);
        empty
    }

    fn push_cell(&mut self, entries: &[(u32, u16)], target: &[f32]) {
        // A sum of whole numbers is exact. It is that of the weights as stored, so a F and sum_i w_i agree in
        // the residual.
        let units: u32 = entries.iter().map(|&(_, weight)| u32::from(weight)).sum();
        let coverage = units as f32 * WEIGHT_UNIT;
        if coverage < MIN_COVERAGE {
            return;
        }
        for &(gaussian, weight) in entries {
            self.by_cell.push(gaussian, weight);
        }
        self.by_cell.starts.push(self.by_cell.indices.len() as u32);
        self.coverage.push(coverage);
        // A finite value outside the range of 16 bits must stay finite.
        let stored = |&value: &f32| f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()));
        self.targets.extend(target.iter().map(stored));
    }

    /// C, the number of covered cells.
    pub fn n_cells(&self) -> usize {
        self.coverage.len()
    }

    /// D, the number of channels.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// Sum of weights of each cell `[C]`.
    pub fn coverage(&self) -> &[f32] {
        &self.coverage
    }

    /// Encoder features of `cells` `[cells, D]`.
    pub fn targets(&self, cells: std::ops::Range<usize>, out: &mut Vec<f32>) {
        out.resize(cells.len() * self.n_channels, 0.0);
        self.targets[cells.start * self.n_channels..cells.end * self.n_channels].convert_to_f32_slice(out);
    }

    /// Renders values `[N, L]` of the Gaussians into `cells` `[cells, L]`: sum_i w_i v_i.
    pub fn render(&self, values: &[f32], n_latent: usize, cells: std::ops::Range<usize>, out: &mut Vec<f32>) {
        out.clear();
        out.resize(cells.len() * n_latent, 0.0);
        for (out, cell) in out.chunks_exact_mut(n_latent).zip(cells) {
            for (gaussian, weight) in self.by_cell.row(cell) {
                add_scaled(out, weight, &values[gaussian * n_latent..][..n_latent]);
            }
        }
    }

    /// Rows of the seen Gaussians of the `piece`-th run of [`GAUSSIANS_PER_PIECE`] Gaussians, each with its
    /// index within the run.
    pub fn seen_in_piece(&self, piece: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let first = piece * GAUSSIANS_PER_PIECE;
        // `seen` is ascending, so a piece's Gaussians are one run of it.
        let start = self.seen.partition_point(|&gaussian| (gaussian as usize) < first);
        let gaussians = self.seen[start..].iter().map(move |&gaussian| gaussian as usize - first);
        (start..).zip(gaussians.take_while(|&place| place < GAUSSIANS_PER_PIECE))
    }

    /// The transpose of [`Self::render`] for one seen Gaussian. Adds sum_c w_c v_c over cell values `[C, L]` to
    /// `out` `[L]`, and returns sum_c w_c.
    pub fn gather(&self, row: usize, cell_values: &[f32], out: &mut [f32]) -> f32 {
        let mut sum = 0.0;
        for (cell, weight) in self.by_gaussian.row(row) {
            add_scaled(out, weight, &cell_values[cell * out.len()..][..out.len()]);
            sum += weight;
        }
        sum
    }
}

/// Pixels on a side of a cell.
fn cell_side(features: &FeatureMap, weights: &BlendWeights) -> Result<usize, CellSizeError> {
    let (map, picture) = ([features.width, features.height], weights.size.to_array());
    let fits = |side: u32| {
        // An encoder either keeps the last odd line at each halving, as ours do, or drops it.
        map == picture.map(|pixels| pixels.div_ceil(side)) || map == picture.map(|pixels| pixels / side)
    };
    // The smallest side that fits. Small maps can fit several.
    let side = (0..8).map(|power| 1 << power).find(|&side| fits(side));
    side.map(|side| side as usize).ok_or(CellSizeError { map, picture })
}

/// The weights of one cell, means over its pixels, in ascending order of Gaussians. `entries` is temporary.
fn cell_weights(
    weights: &BlendWeights,
    side: usize,
    [column, row]: [usize; 2],
    entries: &mut Vec<(u32, f32)>,
) -> Vec<(u32, u16)> {
    let [width, height] = weights.size.to_array().map(|pixels| pixels as usize);
    entries.clear();
    let mut n_pixels = 0;
    for y in row * side..((row + 1) * side).min(height) {
        for x in column * side..((column + 1) * side).min(width) {
            entries.extend(weights.pixel(y * width + x).map(|(gaussian, weight)| (gaussian as u32, weight)));
            n_pixels += 1;
        }
    }
    // A stable sort keeps the entries of one Gaussian in pixel order, so that their sum is always the same.
    entries.sort_by_key(|&(gaussian, _)| gaussian);
    let unit = WEIGHT_UNIT * n_pixels as f32;
    let of_one_gaussian = entries.chunk_by(|a, b| a.0 == b.0);
    let means = of_one_gaussian.map(|run| {
        let sum: f32 = run.iter().map(|&(_, weight)| weight).sum();
        // A pixel's weights sum to at most 1, so the mean is at most 65,535 units. The cast saturates if
        // rounding exceeds it.
        (run[0].0, (sum / unit).round() as u16)
    });
    // Weights that round to 0 would only lengthen the lists.
    means.filter(|&(_, weight)| weight > 0).collect()
}

/// Adds `factor * values` to `sum`.
pub fn add_scaled(sum: &mut [f32], factor: f32, values: &[f32]) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += factor * value;
    }
}
