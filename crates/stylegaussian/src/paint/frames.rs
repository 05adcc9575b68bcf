//! Normals of the scene's surfaces, and the direction along them in which strokes run.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::{neighbors::Neighbors, palette::LUMINANCE, scene::Scene};

/// Rounds of averaging normals over neighborhoods. On thin or bushy things, single Gaussians point anywhere.
const NORMAL_ROUNDS: usize = 2;

/// Rounds of averaging directions: a few more, so that adjacent strokes are parallel.
const DIRECTION_ROUNDS: usize = 4;

/// Surfaces through the Gaussians.
pub(super) struct Frames {
    /// Unit normals of either sign `[N]`.
    pub normals: Vec<Vec3>,
    /// Unit directions along edges of the scene's colors, in the tangent plane and of either sign `[N]`; zero
    /// if there is no edge.
    pub directions: Vec<Vec3>,
    /// How clear each direction is `[N]`, from 0 (none) to 1.
    pub clarity: Vec<f32>,
}

impl Frames {
    /// Surfaces through `scene`, whose base colors are `base` `[N]`.
    pub fn new(scene: &Scene, neighbors: &Neighbors, base: &[Vec3]) -> Self {
        let shapes = (0..scene.len()).into_par_iter().map(|i| shape(scene, neighbors, i)).collect();
        let normals: Vec<Vec3> =
            averaged(shapes, neighbors, NORMAL_ROUNDS).par_iter().map(thinnest).collect();
        let edges = (0..scene.len()).into_par_iter().map(|i| {
            let gradient = gradient(scene, neighbors, base, i).reject_from_normalized(normals[i]);
            outer(gradient, gradient)
        });
        let edges = averaged(edges.collect(), neighbors, DIRECTION_ROUNDS);
        let (directions, clarity) =
            edges.par_iter().zip(&normals).map(|(edge, normal)| along(edge, *normal)).unzip();
        Self { normals, directions, clarity }
    }
}

/// The direction along an edge with structure tensor `edge`, and how clear it is.
fn along(edge: &Mat3, normal: Vec3) -> (Vec3, f32) {
    let across = dominant(*edge);
    let trace = edge.x_axis.x + edge.y_axis.y + edge.z_axis.z;
    let first = across.dot(*edge * across);
    // In the plane there are two eigenvalues: the first, and the rest of the trace.
    let clarity = if trace > 0.0 { ((2.0 * first - trace) / trace).clamp(0.0, 1.0) } else { 0.0 };
    (normal.cross(across).normalize_or_zero(), clarity)
}

/// Covariance of a Gaussian and of the means around it, each with trace 1: flat on a surface.
fn shape(scene: &Scene, neighbors: &Neighbors, i: usize) -> Mat3 {
    let axes = Mat3::from_quat(scene.rotations[i]) * Mat3::from_diagonal(scene.scales[i]);
    let around = around(neighbors, i).map(|j| scene.means[j] - scene.means[i]);
    let spread = around.fold(Mat3::ZERO, |sum, offset| sum + outer(offset, offset));
    with_unit_trace(axes * axes.transpose()) + with_unit_trace(spread)
}

/// The gradient of luminance at Gaussian `i`, in luminance per spacing of Gaussians.
fn gradient(scene: &Scene, neighbors: &Neighbors, base: &[Vec3], i: usize) -> Vec3 {
    let (mut sum, mut square) = (Vec3::ZERO, 0.0);
    for j in around(neighbors, i) {
        let offset = scene.means[j] - scene.means[i];
        let distance_squared = offset.length_squared();
        if distance_squared > 0.0 {
            sum += offset * ((base[j] - base[i]).dot(LUMINANCE) / distance_squared);
            square += distance_squared;
        }
    }
    // Both sums are over K neighbors: a mean gradient times a root mean square distance.
    let n = neighbors.k as f32;
    sum / n * (square / n).sqrt()
}

/// `tensors` `[N]` averaged over neighborhoods.
fn averaged(mut tensors: Vec<Mat3>, neighbors: &Neighbors, rounds: usize) -> Vec<Mat3> {
    for _ in 0..rounds {
        let mean = |i| around(neighbors, i).map(|j| tensors[j]).fold(Mat3::ZERO, |a, b| a + b);
        tensors = (0..tensors.len()).into_par_iter().map(|i| mean(i) * (1.0 / neighbors.k as f32)).collect();
    }
    tensors
}

fn around(neighbors: &Neighbors, i: usize) -> impl Iterator<Item = usize> + '_ {
    neighbors.indices[i * neighbors.k..(i + 1) * neighbors.k].iter().map(|&j| j as usize)
}

fn with_unit_trace(matrix: Mat3) -> Mat3 {
    let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
    if trace > 0.0 && trace.is_finite() { matrix * (1.0 / trace) } else { Mat3::ZERO }
}

/// The matrix a b^T.
pub(super) fn outer(a: Vec3, b: Vec3) -> Mat3 {
    Mat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The unit eigenvector of the largest eigenvalue of a positive semidefinite matrix. Any unit vector if it is
/// zero.
pub(super) fn dominant(matrix: Mat3) -> Vec3 {
    // Squaring doubles the ratio of eigenvalues in the exponent: after six, a ratio of 1.1 has become 445.
    let mut power = with_unit_trace(matrix);
    for _ in 0..6 {
        power = with_unit_trace(power * power);
    }
    // Every column is a multiple of the eigenvector. The longest has the most digits.
    let columns = [power.x_axis, power.y_axis, power.z_axis];
    let longest = columns.into_iter().fold(Vec3::ZERO, |a, b| if b.length() > a.length() { b } else { a });
    longest.try_normalize().unwrap_or(Vec3::X)
}

/// The unit eigenvector of the smallest eigenvalue of a positive semidefinite matrix.
pub(super) fn thinnest(matrix: &Mat3) -> Vec3 {
    // The inverse has the eigenvalues' inverses. A share of the trace on the diagonal keeps it finite for flat
    // things.
    let regular = with_unit_trace(*matrix) + Mat3::from_diagonal(Vec3::splat(1e-3));
    dominant(regular.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_of_the_largest_and_the_smallest_eigenvalue() {
        let axes = Mat3::from_rotation_z(0.3) * Mat3::from_rotation_x(1.1);
        let matrix = axes * Mat3::from_diagonal(Vec3::new(1.0, 4.0, 0.2)) * axes.transpose();
        assert!(dominant(matrix).dot(axes.y_axis).abs() > 0.9999);
        assert!(thinnest(&matrix).dot(axes.z_axis).abs() > 0.9999);
        assert_eq!(dominant(Mat3::ZERO), Vec3::X);
    }
}
