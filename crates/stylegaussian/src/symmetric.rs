//! Eigenvalues of symmetric matrices.

use glam::{DMat3, DVec3};

/// Sweeps of rotations over a matrix's three pairs of axes. Once they are small, each sweep squares them at
/// least, so ten leave nothing but rounding.
const SWEEPS: usize = 10;

/// The eigenvalues of a symmetric matrix, and its unit eigenvectors as columns, by Jacobi's rotations. They
/// find small eigenvalues beside large ones as well.
pub(crate) fn eigen(matrix: DMat3) -> (DVec3, DMat3) {
    let (mut diagonal, mut axes) = (matrix, DMat3::IDENTITY);
    for (p, q) in [(0, 1), (0, 2), (1, 2)].into_iter().cycle().take(3 * SWEEPS) {
        let angle = 0.5 * (2.0 * diagonal.col(q)[p]).atan2(diagonal.col(q)[q] - diagonal.col(p)[p]);
        let mut turn = DMat3::IDENTITY;
        let (sin, cos) = angle.sin_cos();
        (turn.col_mut(p)[p], turn.col_mut(q)[q]) = (cos, cos);
        (turn.col_mut(q)[p], turn.col_mut(p)[q]) = (sin, -sin);
        diagonal = turn.transpose() * diagonal * turn;
        axes *= turn;
    }
    (DVec3::new(diagonal.x_axis.x, diagonal.y_axis.y, diagonal.z_axis.z), axes)
}
