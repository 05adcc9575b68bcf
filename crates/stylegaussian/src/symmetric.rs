//! Eigenvalues of symmetric matrices.

use glam::{DMat3, DVec3};

/// Eigenvalues and eigenvectors (columns, a rotation) of a symmetric matrix, by Jacobi's method (Golub and Van
/// Loan, section 8.5).
pub fn eigen(mut matrix: DMat3) -> (DVec3, DMat3) {
    let mut vectors = DMat3::IDENTITY;
    // Converges quadratically: five sweeps leave rounding only.
    for _ in 0..8 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (app, aqq, apq) = (matrix.col(p)[p], matrix.col(q)[q], matrix.col(q)[p]);
            if apq == 0.0 {
                continue;
            }
            // The smaller root of t^2 + 2 theta t - 1: the tangent of the angle that makes the element zero.
            let theta = (aqq - app) / (2.0 * apq);
            let tangent = theta.signum() / (theta.abs() + theta.mul_add(theta, 1.0).sqrt());
            let cosine = tangent.mul_add(tangent, 1.0).sqrt().recip();
            let sine = tangent * cosine;
            let mut turn = DMat3::IDENTITY;
            (turn.col_mut(p)[p], turn.col_mut(q)[q]) = (cosine, cosine);
            (turn.col_mut(q)[p], turn.col_mut(p)[q]) = (sine, -sine);
            matrix = turn.transpose() * matrix * turn;
            vectors *= turn;
        }
    }
    (DVec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z), vectors)
}

#[cfg(test)]
mod tests {
    use glam::EulerRot;

    use super::*;

    #[test]
    fn eigenvectors_rebuild_the_matrix() {
        let turn = DMat3::from_euler(EulerRot::XYZ, 0.3, -1.2, 2.5);
        for values in [DVec3::new(1.0, 2.0, 3.0), DVec3::splat(0.5), DVec3::new(1e-12, 1e4, 1.0), DVec3::ZERO]
        {
            let matrix = turn * DMat3::from_diagonal(values) * turn.transpose();
            let (found, vectors) = eigen(matrix);
            let rebuilt = vectors * DMat3::from_diagonal(found) * vectors.transpose();
            assert!(rebuilt.abs_diff_eq(matrix, 1e-12 * values.max_element().max(1.0)), "{values}");
            assert!((vectors.determinant() - 1.0).abs() < 1e-12);
        }
    }
}
