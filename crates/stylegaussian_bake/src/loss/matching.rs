//! Nearest-neighbor feature matching (Zhang et al., "ARF", 2022): every cell should resemble some cell of the
//! painting.

use rayon::prelude::*;
use stylegaussian::{
    decoder::product::{Matrix, dot, product},
    principal::leading_axes,
    random::Random,
};

/// Directions in which keys are compared: those in which the painting's are largest. The 256 channels of the
/// encoder's output are made of 80.
const DIRECTIONS: usize = 64;
/// Queries per product. 64 rows of 750 similarities are 192 KB, within a core's second-level cache.
const BLOCK: usize = 64;
/// Added to lengths: a cell without any feature has no direction, and no gradient.
const EPSILON: f32 = 1e-6;

/// Cells of paintings with which a picture's are matched.
pub(crate) struct Keys {
    channels: usize,
    /// The cells at length 1 `[m, C]`.
    units: Vec<f32>,
    /// Directions in which the units are largest `[D, C]`.
    axes: Vec<f32>,
    /// The units along the axes `[m, D]`.
    along: Vec<f32>,
}

impl Keys {
    /// From rows `[m, C]` of any length.
    pub fn new(rows: Vec<f32>, channels: usize) -> Self {
        let units = normalized(rows, channels);
        let axes = leading_axes(&units, channels, channels.min(DIRECTIONS));
        let along = coordinates(&units, &axes, channels);
        Self { channels, units, axes, along }
    }
}

/// Rows `[n, C]` along axes `[D, C]`: `[n, D]`.
fn coordinates(rows: &[f32], axes: &[f32], channels: usize) -> Vec<f32> {
    let (n, n_axes) = (rows.len() / channels, axes.len() / channels);
    let mut along = vec![0.0; n * n_axes];
    let axes = Matrix::dense(axes, n_axes, channels).transposed();
    product(&mut along, false, Matrix::dense(rows, n, channels), axes);
    along
}

/// The rows `[n, C]` at length 1.
fn normalized(mut rows: Vec<f32>, channels: usize) -> Vec<f32> {
    for row in rows.chunks_exact_mut(channels) {
        let over = 1.0 / (length(row) + EPSILON);
        row.iter_mut().for_each(|value| *value *= over);
    }
    rows
}

fn length(row: &[f32]) -> f32 {
    dot(row, row).sqrt()
}

/// `n` of the rows in random order; all, if there are no more.
pub(crate) fn some_of(cells: &[u32], n: usize, random: &mut Random) -> Vec<u32> {
    if cells.len() <= n {
        return cells.to_vec();
    }
    let mut cells = cells.to_vec();
    for i in 0..n {
        let other = i + random.below(cells.len() - i);
        cells.swap(i, other);
    }
    cells.truncate(n);
    cells
}

/// Mean over `queries`, rows of `rows` `[n, C]`, of the cosine distance to the nearest of `keys`. Adds `weight`
/// times the gradient to `grad` `[n, C]`.
pub(crate) fn matching(rows: &[f32], queries: &[u32], keys: &Keys, weight: f32, grad: &mut [f32]) -> f32 {
    let Keys { channels, units, axes, along } = keys;
    let (channels, n_keys, n_axes) = (*channels, units.len() / channels, axes.len() / channels);
    if n_keys == 0 || queries.is_empty() {
        return 0.0;
    }
    let row = |cell: u32| &rows[cell as usize * channels..][..channels];
    let scale = weight / queries.len() as f32;
    let keys_t = Matrix::dense(along, n_keys, n_axes).transposed();
    let blocks: Vec<(f64, Vec<f32>)> = queries
        .par_chunks(BLOCK)
        .map_init(Vec::new, |similarities: &mut Vec<f32>, block| {
            let gathered: Vec<f32> = block.iter().flat_map(|&cell| row(cell)).copied().collect();
            let unit = normalized(gathered, channels);
            similarities.resize(block.len() * n_keys, 0.0);
            let along = coordinates(&unit, axes, channels);
            product(similarities, false, Matrix::dense(&along, block.len(), n_axes), keys_t);
            let (mut sum, mut grads) = (0.0, Vec::with_capacity(unit.len()));
            for (i, (&cell, unit)) in block.iter().zip(unit.chunks_exact(channels)).enumerate() {
                let key = &units[largest(&similarities[i * n_keys..][..n_keys]) * channels..][..channels];
                let similarity = dot(unit, key);
                sum += f64::from(1.0 - similarity);
                // d(1 - u k) / dx with u = x / |x|: -(k - (u k) u) / |x|.
                let over = scale / (length(row(cell)) + EPSILON);
                grads.extend(key.iter().zip(unit).map(|(key, unit)| over * (similarity * unit - key)));
            }
            (sum, grads)
        })
        .collect();
    let of_queries = blocks.iter().flat_map(|(_, grads)| grads.chunks_exact(channels));
    for (&cell, of_query) in queries.iter().zip(of_queries) {
        let target = &mut grad[cell as usize * channels..][..channels];
        target.iter_mut().zip(of_query).for_each(|(sum, value)| *sum += value);
    }
    (blocks.iter().map(|(sum, _)| sum).sum::<f64>() / queries.len() as f64) as f32
}

/// The place of the first of the largest values.
fn largest(values: &[f32]) -> usize {
    // The maximum first, which needs no branch and runs in vectors.
    let max = values.iter().fold(f32::NEG_INFINITY, |max, &value| max.max(value));
    values.iter().position(|&value| value == max).unwrap_or(0)
}
