//! The directions in which rows of numbers are largest: those of a principal component analysis without
//! centering.

use crate::{
    decoder::product::{Matrix, dot, product},
    random::Random,
};

/// Rounds of orthogonal iteration. Directions of nearly equal length stay mixed, which distances do not see.
const ROUNDS: usize = 12;

/// The `n` directions along which the squares of `rows` `[P, D]` sum to most, as unit vectors `[n, D]`, by
/// orthogonal iteration. For rows of mean 0 those are the directions of largest variance. If the rows have
/// fewer directions, the rest are zeros.
///
/// # Panics
/// If D is 0, or `rows` are no multiple of it.
pub fn leading_axes(rows: &[f32], n_channels: usize, n: usize) -> Vec<f32> {
    assert!(n_channels > 0 && rows.len().is_multiple_of(n_channels), "rows [P, D]");
    let mut random = Random::new(0);
    let mut axes: Vec<f32> = (0..n * n_channels).map(|_| random.normal()).collect();
    orthonormalize(&mut axes, n_channels);
    let n_rows = rows.len() / n_channels;
    let rows = Matrix::dense(rows, n_rows, n_channels);
    let mut squares = vec![0.0; n_channels * n_channels];
    product(&mut squares, false, rows.transposed(), rows);
    let squares = Matrix::dense(&squares, n_channels, n_channels);
    for _ in 0..ROUNDS {
        let mut next = vec![0.0; axes.len()];
        product(&mut next, false, Matrix::dense(&axes, n, n_channels), squares);
        axes = next;
        orthonormalize(&mut axes, n_channels);
    }
    axes
}

/// Gram and Schmidt, on rows. A row that depends on those before it becomes zero.
fn orthonormalize(axes: &mut [f32], n_channels: usize) {
    for i in 0..axes.len() / n_channels {
        let (before, rest) = axes.split_at_mut(i * n_channels);
        let axis = &mut rest[..n_channels];
        let length_before = dot(axis, axis).sqrt();
        for other in before.chunks_exact(n_channels) {
            let along = dot(axis, other);
            axis.iter_mut().zip(other).for_each(|(value, other)| *value -= along * other);
        }
        let length = dot(axis, axis).sqrt();
        // The rest of a dependent row is rounding: f32 has seven digits.
        let scale = if length > 1e-5 * length_before { 1.0 / length } else { 0.0 };
        axis.iter_mut().for_each(|value| *value *= scale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_come_by_length() {
        // Along (0.6, 0.8) the squares sum to 18, along (0.8, -0.6) to 2, and nowhere else to anything.
        let rows = [1.8, 2.4, 0.0, -1.8, -2.4, 0.0, 0.8, -0.6, 0.0, -0.8, 0.6, 0.0];
        let axes = leading_axes(&rows, 3, 3);
        let along = |axis: usize, other: [f32; 3]| dot(&axes[axis * 3..][..3], &other).abs();
        assert!((along(0, [0.6, 0.8, 0.0]) - 1.0).abs() < 1e-5, "{axes:?}");
        assert!((along(1, [0.8, -0.6, 0.0]) - 1.0).abs() < 1e-5, "{axes:?}");
        assert_eq!(axes[6..], [0.0; 3]);
    }
}
