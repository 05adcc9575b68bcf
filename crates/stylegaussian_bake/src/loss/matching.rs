//! Nearest-neighbor feature matching (Zhang et al., "ARF", 2022): every cell should resemble some cell of the painting.

use rayon::prelude::*;
use stylegaussian::{
    decoder::product::{Matrix, product},
    random::Random,
};

/// Queries per product. 64 rows of 4,500 similarities are 1.2 MB, within two cores' caches.
const BLOCK: usize = 64;
/// Added to lengths: a cell without any feature has no direction, and no gradient.
const EPSILON: f32 = 1e-6;

/// Rows of length 1 `[n, C]`.
pub(crate) fn normalized(rows: &[f32], channels: usize) -> Vec<f32> {
    let mut unit = rows.to_vec();
    unit.par_chunks_exact_mut(channels).for_each(|row| {
        let over = 1.0 / (length(row) + EPSILON);
        row.iter_mut().for_each(|value| *value *= over);
    });
    unit
}

fn length(row: &[f32]) -> f32 {
    dot(row, row).sqrt()
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
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

/// Mean over `queries`, rows of `rows` `[n, C]`, of the cosine distance to the nearest of `keys` `[m, C]`, which have
/// length 1. Adds `weight` times the gradient to `grad` `[n, C]`.
pub(crate) fn matching(
    rows: &[f32],
    channels: usize,
    queries: &[u32],
    keys: &[f32],
    weight: f32,
    grad: &mut [f32],
) -> f32 {
    let n_keys = keys.len() / channels;
    if n_keys == 0 || queries.is_empty() {
        return 0.0;
    }
    let row = |cell: u32| &rows[cell as usize * channels..][..channels];
    let scale = weight / queries.len() as f32;
    let blocks: Vec<(f64, Vec<f32>)> = queries
        .par_chunks(BLOCK)
        .map_init(Vec::new, |similarities: &mut Vec<f32>, block| {
            let gathered: Vec<f32> = block.iter().flat_map(|&cell| row(cell)).copied().collect();
            let unit = normalized_here(gathered, channels);
            similarities.resize(block.len() * n_keys, 0.0);
            let keys_t = Matrix::dense(keys, n_keys, channels).transposed();
            product(similarities, false, Matrix::dense(&unit, block.len(), channels), keys_t);
            let (mut sum, mut grads) = (0.0, Vec::with_capacity(unit.len()));
            for (i, (&cell, unit)) in block.iter().zip(unit.chunks_exact(channels)).enumerate() {
                let (best, similarity) = largest(&similarities[i * n_keys..][..n_keys]);
                sum += f64::from(1.0 - similarity);
                // d(1 - u k) / dx with u = x / |x|: -(k - (u k) u) / |x|.
                let over = scale / (length(row(cell)) + EPSILON);
                let key = &keys[best * channels..][..channels];
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

fn normalized_here(mut rows: Vec<f32>, channels: usize) -> Vec<f32> {
    for row in rows.chunks_exact_mut(channels) {
        let over = 1.0 / (length(row) + EPSILON);
        row.iter_mut().for_each(|value| *value *= over);
    }
    rows
}

/// The first of the largest values, and its place.
fn largest(values: &[f32]) -> (usize, f32) {
    // The maximum first, which needs no branch and runs in vectors.
    let max = values.iter().fold(f32::NEG_INFINITY, |max, &value| max.max(value));
    (values.iter().position(|&value| value == max).unwrap_or(0), max)
}
