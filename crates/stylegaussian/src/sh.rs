//! Spherical harmonics, degrees 0 to 3.

use glam::Vec3;

const C0: f32 = 0.282_094_79;
const C1: f32 = 0.488_602_51;
const C2: [f32; 5] = [1.092_548_4, -1.092_548_4, 0.315_391_57, -1.092_548_4, 0.546_274_2];
const C3: [f32; 7] =
    [-0.590_043_6, 2.890_611_4, -0.457_045_8, 0.373_176_33, -0.457_045_8, 1.445_305_7, -0.590_043_6];

/// The color seen along unit vector `direction` (from the camera to the Gaussian): 0.5 + sum_k c_k Y_k, clamped at 0
/// from below. `coefficients` are `[(degree + 1)^2, 3]`, RGB innermost.
pub fn evaluate(degree: u8, coefficients: &[f32], direction: Vec3) -> Vec3 {
    let basis = basis(direction);
    let n = (usize::from(degree) + 1).pow(2);
    let mut color = Vec3::splat(0.5);
    for (y, c) in basis[..n].iter().zip(coefficients.chunks_exact(3)) {
        color += *y * Vec3::from_slice(c);
    }
    color.max(Vec3::ZERO)
}

fn basis(direction: Vec3) -> [f32; 16] {
    let Vec3 { x, y, z } = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2.0 * zz - xx - yy),
        C2[3] * x * z,
        C2[4] * (xx - yy),
        C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * x * (4.0 * zz - xx - yy),
        C3[5] * z * (xx - yy),
        C3[6] * x * (xx - 3.0 * yy),
    ]
}
