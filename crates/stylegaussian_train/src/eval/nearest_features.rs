//! Distance of a picture's features to the nearest ones of a painting (NNFM, Zhang et al., "ARF", 2022).

use rayon::prelude::*;
use stylegaussian::{
    decoder::product::{Matrix, product},
    random::Random,
};

/// Most cells of a picture that are compared, chosen at random: with 2,048 of them the error of a mean of
/// distances between 0 and 1 is below 1%.
const MAX_QUERIES: usize = 2048;

/// Most cells of a painting that a cell is compared with, chosen at random. relu3_1 of 512 x 512 pixels has
/// 16,384.
const MAX_KEYS: usize = 8192;

/// Cells of the picture in one product.
const BLOCK: usize = 128;

/// Features of unit length, one row for each cell `[n, D]`.
pub struct Directions {
    rows: Vec<f32>,
    n_channels: usize,
}

impl Directions {
    /// Those cells of a picture's feature map `[h * w, D]` that count, or some of them, the same each time.
    pub fn of_picture(rows: &[f32], counts: &[bool]) -> Self {
        Self::some_of(rows, counts, MAX_QUERIES)
    }

    /// The cells of a painting's feature map `[h * w, D]`, or some of them.
    pub fn of_painting(rows: &[f32], n_cells: usize) -> Self {
        Self::some_of(rows, &vec![true; n_cells], MAX_KEYS)
    }

    fn some_of(rows: &[f32], counts: &[bool], most: usize) -> Self {
        let n_channels = rows.len() / counts.len().max(1);
        let cells: Vec<usize> = (0..counts.len()).filter(|&i| counts[i]).collect();
        let n = cells.len().min(most);
        // Even steps through the rows would fall on the same few columns in each of them.
        let mut order: Vec<usize> = match n < cells.len() {
            true => Random::new(0).permutation(cells.len())[..n].to_vec(),
            false => (0..n).collect(),
        };
        order.sort_unstable();
        let unit = |i: usize| {
            let row = &rows[cells[i] * n_channels..][..n_channels];
            let length = row.iter().map(|value| value * value).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
            row.iter().map(move |value| value / length)
        };
        Self { rows: order.into_iter().flat_map(unit).collect(), n_channels }
    }

    /// The mean over the picture's cells of the cosine distance (1 - cos) to the nearest of the painting's.
    /// `None` if there is no cell to compare.
    pub fn distance_to(&self, painting: &Self) -> Option<f64> {
        let d = self.n_channels;
        let n_keys = painting.rows.len() / d.max(1);
        let n = self.rows.len() / d.max(1);
        if n == 0 || n_keys == 0 {
            return None;
        }
        let keys = Matrix::dense(&painting.rows, n_keys, d).transposed();
        let of_block = |block: &[f32]| -> f64 {
            let n_rows = block.len() / d;
            let mut cosines = vec![0.0; n_rows * n_keys];
            product(&mut cosines, false, Matrix::dense(block, n_rows, d), keys);
            let nearest = |row: &[f32]| 1.0 - f64::from(row.iter().copied().fold(-1.0, f32::max));
            cosines.chunks_exact(n_keys).map(nearest).sum()
        };
        // Collected before they are summed, so that the order of additions does not depend on the threads.
        let sums: Vec<f64> = self.rows.par_chunks(BLOCK * d).map(of_block).collect();
        Some(sums.iter().sum::<f64>() / n as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_direction_counts_whatever_its_length() {
        let painting = Directions::of_painting(&[2.0, 0.0, 0.0, 5.0], 2);
        // Along the first, between both, and one that does not count.
        let picture = Directions::of_picture(&[7.0, 0.0, 1.0, 1.0, -1.0, 0.0], &[true, true, false]);
        let expected = (1.0 - 0.5_f64.sqrt()) / 2.0;
        assert!((picture.distance_to(&painting).unwrap() - expected).abs() < 1e-6);
        assert_eq!(Directions::of_picture(&[1.0, 1.0], &[false]).distance_to(&painting), None);
    }

    #[test]
    fn some_cells_stand_for_many() {
        // Angles over a quarter turn; the painting has the first half of them.
        let turn = |n: usize, share: f32| -> Vec<f32> {
            let direction = |i: usize| <[f32; 2]>::from((share * 1.57 * i as f32 / n as f32).sin_cos());
            (0..n).flat_map(direction).collect()
        };
        let n = 3 * MAX_QUERIES;
        let painting = Directions::of_painting(&turn(3 * MAX_KEYS, 0.5), 3 * MAX_KEYS);
        let picture = Directions::of_picture(&turn(n, 1.0), &vec![true; n]);
        assert_eq!((picture.rows.len(), painting.rows.len()), (2 * MAX_QUERIES, 2 * MAX_KEYS));
        // Half are in the painting; the others are between 0 and 0.785 away: the mean of 1 - cos over that is
        // 1 - sin(0.785) / 0.785 = 0.0997.
        // They deviate from that by 0.08, and so the mean of 2,048 of them by 0.002.
        assert!((picture.distance_to(&painting).unwrap() - 0.0997 / 2.0).abs() < 6e-3);
    }
}
