//! Spherical harmonics, degrees 0 to 3: the captured, view-dependent color of a Gaussian.
//!
//! Real spherical harmonics with the Condon-Shortley phase, in the order and with the signs that trained 3DGS
//! scenes use: coefficient `l (l + 1) + m` for m = -l..=l.

use glam::{DMat3, Vec3};
use rayon::prelude::*;

/// The highest degree that scenes carry.
pub const MAX_DEGREE: u8 = 3;

/// Y_00 = 1 / (2 sqrt(pi)): the constant basis function.
pub const Y_0: f32 = 0.282_094_79;

/// sqrt(3 / (4 pi)).
const C_1: f32 = 0.488_602_51;

/// sqrt(15 / (4 pi)), sqrt(5 / (16 pi)), sqrt(15 / (16 pi)).
const C_2: [f32; 3] = [1.092_548_4, 0.315_391_57, 0.546_274_2];

/// sqrt(35 / (32 pi)), sqrt(105 / (4 pi)), sqrt(21 / (32 pi)), sqrt(7 / (16 pi)), sqrt(105 / (16 pi)).
const C_3: [f32; 5] = [0.590_043_6, 2.890_611_4, 0.457_045_8, 0.373_176_34, 1.445_305_7];

/// Number of coefficients of a channel at `degree`: (degree + 1)^2.
pub const fn n_coefficients(degree: u8) -> usize {
    let n = degree as usize + 1;
    n * n
}

/// The first (degree + 1)^2 basis functions at a unit direction. The remaining entries are zero.
pub fn basis(degree: u8, direction: Vec3) -> [f32; 16] {
    let Vec3 { x, y, z } = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    // Polynomials, order and signs are those of the 3DGS rasterizer, on which trained coefficients depend.
    let mut b = [0.0; 16];
    b[0] = Y_0;
    if degree >= 1 {
        b[1] = -C_1 * y;
        b[2] = C_1 * z;
        b[3] = -C_1 * x;
    }
    if degree >= 2 {
        b[4] = C_2[0] * x * y;
        b[5] = -C_2[0] * y * z;
        b[6] = C_2[1] * (2.0 * zz - xx - yy);
        b[7] = -C_2[0] * x * z;
        b[8] = C_2[2] * (xx - yy);
    }
    if degree >= 3 {
        b[9] = -C_3[0] * y * (3.0 * xx - yy);
        b[10] = C_3[1] * x * y * z;
        b[11] = -C_3[2] * y * (4.0 * zz - xx - yy);
        b[12] = C_3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
        b[13] = -C_3[2] * x * (4.0 * zz - xx - yy);
        b[14] = C_3[4] * z * (xx - yy);
        b[15] = -C_3[0] * x * (xx - 3.0 * yy);
    }
    b
}

/// The color of one Gaussian seen along `direction`: display-referred RGB, 0.5 added, clamped at 0 from below.
///
/// `coefficients` are that Gaussian's `[(degree + 1)^2, 3]`, RGB innermost; `direction` is the unit vector from
/// the camera to the mean, in the scene's own space.
///
/// # Panics
/// If `coefficients` is shorter than its degree demands.
pub fn evaluate(degree: u8, coefficients: &[f32], direction: Vec3) -> Vec3 {
    let n = n_coefficients(degree.min(MAX_DEGREE));
    let basis = basis(degree, direction);
    let sum = basis[..n]
        .iter()
        .zip(coefficients[..3 * n].chunks_exact(3))
        .fold(Vec3::ZERO, |sum, (&b, rgb)| sum + b * Vec3::from_slice(rgb));
    // Training adds 0.5, so that coefficients of 0 are mid-gray, and clamps from below only.
    (sum + 0.5).max(Vec3::ZERO)
}

/// The color of a constant coefficient: 0.5 + Y_0 dc, unclamped.
pub fn color_from_dc(dc: [f32; 3]) -> [f32; 3] {
    dc.map(|dc| 0.5 + Y_0 * dc)
}

/// The constant coefficient of a color, the inverse of [`color_from_dc`].
pub fn dc_from_color(color: [f32; 3]) -> [f32; 3] {
    color.map(|c| (c - 0.5) / Y_0)
}

/// Turns coefficients `[N, (degree + 1)^2, 3]`: the color that a Gaussian showed along d, it then shows along
/// `turn` d. `turn` is orthogonal: a rotation or a mirror.
///
/// # Panics
/// If the degree is beyond [`MAX_DEGREE`].
pub fn rotate(turn: DMat3, degree: u8, coefficients: &mut [f32]) {
    let matrix = rotation_matrix(turn);
    let n = n_coefficients(degree);
    coefficients.par_chunks_exact_mut(3 * n).for_each(|values| {
        let mut old = [[0.0; 3]; 16];
        old[..n].as_flattened_mut().copy_from_slice(values);
        for band in 1..=usize::from(degree) {
            // Rotations mix the functions of a degree among one another only.
            let of_band = band * band..(band + 1) * (band + 1);
            for i in of_band.clone() {
                let sum = of_band.clone().fold([0.0_f64; 3], |sum, j| {
                    std::array::from_fn(|c| sum[c] + matrix[i][j] * f64::from(old[j][c]))
                });
                values[3 * i..3 * i + 3].copy_from_slice(&sum.map(|value| value as f32));
            }
        }
    });
}

/// The inner products of all basis functions with all turned ones: those of functions of one degree are the
/// matrix of [`rotate`], the others are zero.
fn rotation_matrix(turn: DMat3) -> [[f64; 16]; 16] {
    // Nodes and weights of Gauss and Legendre, exact to degree 7; eight azimuths are exact below frequency 8.
    // Products of two functions have degree 6 at most.
    const NODES: [(f64, f64); 4] = [
        (-0.861_136_311_594_052_6, 0.347_854_845_137_453_86),
        (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
        (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_86),
    ];
    let mut matrix = [[0.0; 16]; 16];
    for (z, weight) in NODES {
        for i in 0..8 {
            let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_4).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            let direction = glam::DVec3::new(radius * cos, radius * sin, z);
            let before = basis(MAX_DEGREE, (turn.transpose() * direction).as_vec3());
            let after = basis(MAX_DEGREE, direction.as_vec3());
            for (row, after) in matrix.iter_mut().zip(after) {
                for (value, before) in row.iter_mut().zip(before) {
                    *value += weight * std::f64::consts::FRAC_PI_4 * f64::from(after) * f64::from(before);
                }
            }
        }
    }
    matrix
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::Quat;

    use super::*;

    /// Points of a midpoint rule in z and azimuth with their weights; exact enough for products of degree 6.
    fn sphere() -> impl Iterator<Item = (Vec3, f64)> {
        // 16 azimuths sum all frequencies below 16 exactly, and products of two functions have at most 6. The
        // midpoint rule in z leaves errors of the order of (2 / 400)^2.
        let (n_z, n_phi) = (400, 16);
        (0..n_z * n_phi).map(move |i| {
            let z = -1.0 + 2.0 * ((i / n_phi) as f64 + 0.5) / n_z as f64;
            let phi = 2.0 * PI * (i % n_phi) as f64 / n_phi as f64;
            let r = (1.0 - z * z).sqrt();
            let direction = Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32);
            (direction, 4.0 * PI / (n_z * n_phi) as f64)
        })
    }

    #[test]
    fn basis_is_orthonormal() {
        let mut gram = [[0.0_f64; 16]; 16];
        for (direction, weight) in sphere() {
            let b = basis(3, direction);
            for i in 0..16 {
                for j in 0..16 {
                    gram[i][j] += weight * f64::from(b[i]) * f64::from(b[j]);
                }
            }
        }
        for (i, row) in gram.iter().enumerate() {
            for (j, &value) in row.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((value - expected).abs() < 1e-4, "<{i}, {j}> = {value}");
            }
        }
    }

    /// Each degree's functions span a space that rotations keep: sum_m Y_lm(a) Y_lm(b) depends on a . b only.
    #[test]
    fn addition_theorem_holds_under_rotation() {
        let (a, b) = (Vec3::new(0.6, -0.48, 0.64), Vec3::new(-0.28, 0.0, 0.96));
        let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.3);
        for degree in 0..=3_usize {
            let band = degree * degree..(degree + 1) * (degree + 1);
            let kernel = |a: Vec3, b: Vec3| -> f32 {
                let (ya, yb) = (basis(3, a), basis(3, b));
                band.clone().map(|i| ya[i] * yb[i]).sum()
            };
            // The Legendre polynomial of this degree. The theorem says that the kernel is (2 l + 1) / (4 pi)
            // times it.
            let legendre = {
                let t = a.dot(b);
                [1.0, t, 1.5 * t * t - 0.5, 2.5 * t * t * t - 1.5 * t][degree]
            };
            let expected = (2 * degree + 1) as f32 / (4.0 * PI as f32) * legendre;
            assert!((kernel(a, b) - expected).abs() < 1e-5, "degree {degree}");
            assert!((kernel(turn * a, turn * b) - expected).abs() < 1e-5, "degree {degree}, rotated");
        }
    }

    #[test]
    fn evaluates_hand_worked_colors() {
        // Degree 0: 0.5 + 0.28209479 * 1 = 0.78209479; -0.5 + ... clamps at 0.
        let color = evaluate(0, &[1.0, 0.0, -4.0], Vec3::X);
        assert!(color.abs_diff_eq(Vec3::new(0.782_094_8, 0.5, 0.0), 1e-6));
        // Degree 1 along +y: coefficient 1 enters as -0.4886 y; along +x coefficient 3 as -0.4886 x.
        let mut c = [0.0; 12];
        c[3] = 0.5; // coefficient 1, red
        c[7] = 0.5; // coefficient 2, green
        c[11] = -0.5; // coefficient 3, blue
        assert!(evaluate(1, &c, Vec3::Y).abs_diff_eq(Vec3::new(0.255_698_7, 0.5, 0.5), 1e-6));
        assert!(evaluate(1, &c, Vec3::Z).abs_diff_eq(Vec3::new(0.5, 0.744_301_3, 0.5), 1e-6));
        assert!(evaluate(1, &c, Vec3::X).abs_diff_eq(Vec3::new(0.5, 0.5, 0.744_301_3), 1e-6));
    }

    #[test]
    fn evaluates_each_higher_function_at_a_hand_worked_point() {
        // At (x, y, z) = (2, 3, 6) / 7: every polynomial below is worked out by hand over 49 or 343.
        let direction = Vec3::new(2.0, 3.0, 6.0) / 7.0;
        let expected = [
            (4, 1.092_548_4 * 6.0 / 49.0),
            (5, -1.092_548_4 * 18.0 / 49.0),
            (6, 0.315_391_57 * (72.0 - 4.0 - 9.0) / 49.0),
            (7, -1.092_548_4 * 12.0 / 49.0),
            (8, 0.546_274_2 * -5.0 / 49.0),
            (9, -0.590_043_6 * 3.0 * (12.0 - 9.0) / 343.0),
            (10, 2.890_611_4 * 36.0 / 343.0),
            (11, -0.457_045_8 * 3.0 * (144.0 - 13.0) / 343.0),
            (12, 0.373_176_34 * 6.0 * (72.0 - 12.0 - 27.0) / 343.0),
            (13, -0.457_045_8 * 2.0 * (144.0 - 13.0) / 343.0),
            (14, 1.445_305_7 * 6.0 * -5.0 / 343.0),
            (15, -0.590_043_6 * 2.0 * (4.0 - 27.0) / 343.0),
        ];
        for (index, value) in expected {
            let mut coefficients = [0.0; 48];
            coefficients[3 * index + 1] = 1.0;
            let color = evaluate(3, &coefficients, direction);
            let expected = Vec3::new(0.5, (0.5 + value as f32).max(0.0), 0.5);
            assert!(color.abs_diff_eq(expected, 1e-6), "function {index}: {color} for {expected}");
        }
    }

    #[test]
    fn turned_coefficients_show_the_same_along_turned_directions() {
        let mirror = DMat3::from_diagonal(glam::DVec3::new(1.0, -1.0, 1.0));
        let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.3);
        // Half a turn about x, between the axes of .ply and of glTF.
        let half = DMat3::from_rotation_x(PI);
        for turn in [turn, mirror, turn * mirror, half] {
            for degree in 0..=3 {
                let n = 3 * n_coefficients(degree);
                let before: Vec<f32> = (0..2 * n).map(|i| (i as f32 * 1.3).sin() * 0.2).collect();
                let mut after = before.clone();
                rotate(turn, degree, &mut after);
                for direction in [Vec3::X, Vec3::new(0.6, -0.48, 0.64), Vec3::new(-0.28, 0.0, 0.96)] {
                    let turned = (turn * direction.as_dvec3()).as_vec3();
                    for (a, b) in before.chunks(n).zip(after.chunks(n)) {
                        let (a, b) = (evaluate(degree, a, direction), evaluate(degree, b, turned));
                        assert!(a.abs_diff_eq(b, 3e-6), "degree {degree}: {b} for {a}");
                    }
                }
            }
        }
    }

    #[test]
    fn dc_and_color_are_inverse() {
        let color = [0.1, 0.5, 1.2];
        let back = color_from_dc(dc_from_color(color));
        assert!(color.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
