//! Color transfer by mean and covariance: a painting's palette without its strokes. Baking and training start
//! from it.

use std::f32::consts::TAU;

use crate::{random::Random, splat::RenderedImage, symmetric::eigen};
use glam::{DMat3, DQuat, DVec3, EulerRot, Vec3};

/// Added to the variances of colors: the square of a display's step. Without it, the covariance of a gray scene
/// or painting could not be inverted.
const VARIANCE_FLOOR: f64 = 1.0 / (255.0 * 255.0);

/// Mean and covariance of colors.
#[derive(Clone, Copy, Debug)]
pub struct ColorMoments {
    mean: DVec3,
    /// With [`VARIANCE_FLOOR`] on its diagonal.
    covariance: DMat3,
}

impl ColorMoments {
    fn new(colors: impl Iterator<Item = DVec3>) -> Self {
        Self::weighted(colors.map(|color| (color, 1.0)))
    }

    fn weighted(colors: impl Iterator<Item = (DVec3, f64)>) -> Self {
        let (mut n, mut sum, mut products) = (0.0, DVec3::ZERO, DMat3::ZERO);
        for (color, weight) in colors {
            n += weight;
            sum += color * weight;
            products += outer(color) * weight;
        }
        // Without any weight the sums are 0, and so are the moments.
        let n = if n > 0.0 { n } else { 1.0 };
        let mean = sum / n;
        let floor = DMat3::from_diagonal(DVec3::splat(VARIANCE_FLOOR));
        // One pass in f64: colors are within 0..1 or near it, so cancellation costs few of 16 digits, and the
        // floor covers the rest.
        Self { mean, covariance: products * (1.0 / n) - outer(mean) + floor }
    }

    /// Moments of the pixels of an image `[H * W * 3]`, such as a painting's.
    pub fn of_rgb(rgb: &[f32]) -> Self {
        Self::new(rgb.chunks_exact(3).map(|p| vector([p[0], p[1], p[2]])))
    }

    /// Moments of premultiplied pixels with their coverage. Only pixels covered to more than half count.
    pub fn of_pixels(pixels: impl Iterator<Item = ([f32; 3], f32)>) -> Self {
        let covered = pixels.filter(|(_, alpha)| *alpha > 0.5);
        Self::new(covered.map(|(color, alpha)| vector(color.map(|channel| channel / alpha))))
    }

    /// Moments of colors, each with its weight. Weights are 0 or more.
    pub fn of_weighted(colors: impl Iterator<Item = (Vec3, f32)>) -> Self {
        Self::weighted(colors.map(|(color, weight)| (color.as_dvec3(), f64::from(weight))))
    }

    /// Moments of a mixture, by weights of which at least one is above 0.
    pub fn mixed<'a>(parts: impl Iterator<Item = (&'a Self, f64)> + Clone) -> Self {
        let total: f64 = parts.clone().map(|(_, weight)| weight).sum();
        let (mut mean, mut products) = (DVec3::ZERO, DMat3::ZERO);
        for (part, weight) in parts {
            mean += part.mean * (weight / total);
            products += (part.covariance + outer(part.mean)) * (weight / total);
        }
        Self { mean, covariance: products - outer(mean) }
    }

    /// Moments of a random palette: a mean away from the ends of the range, and deviations along three random
    /// axes. The largest possible deviation is near that of black and white stripes.
    pub fn random(random: &mut Random) -> Self {
        let mut between = |low: f32, high: f32| f64::from(low + (high - low) * random.uniform());
        let mean = DVec3::new(between(0.15, 0.85), between(0.15, 0.85), between(0.15, 0.85));
        let largest = between(0.12, 0.4);
        let deviations = DVec3::new(largest, largest * between(0.2, 0.9), largest * between(0.05, 0.5));
        let axes = DMat3::from_quat(DQuat::from_euler(
            EulerRot::XYZ,
            between(0.0, TAU),
            between(0.0, TAU),
            between(0.0, TAU),
        ));
        let covariance = axes * DMat3::from_diagonal(deviations * deviations) * axes.transpose();
        Self { mean, covariance: covariance + DMat3::from_diagonal(DVec3::splat(VARIANCE_FLOOR)) }
    }

    /// Standard deviation of the colors' scalar product with `direction`: of luminance, if those are its
    /// weights. Above 0.
    pub fn deviation_along(&self, direction: Vec3) -> f32 {
        let direction = direction.as_dvec3();
        direction.dot(self.covariance * direction).sqrt() as f32
    }

    /// Moments of several views.
    pub fn of_views(views: &[RenderedImage]) -> Self {
        Self::of_pixels(
            views.iter().flat_map(|view| view.color.iter().copied().zip(view.alpha.iter().copied())),
        )
    }
}

/// An affine map of colors.
pub struct Recoloring {
    gain: DMat3,
    shift: DVec3,
}

impl Recoloring {
    /// The map from colors of one mean and covariance to another that moves colors least: the optimal transport
    /// between two normal distributions.
    pub fn new(from: &ColorMoments, to: &ColorMoments) -> Self {
        let root = of_eigenvalues(from.covariance, f64::sqrt);
        let inverse = of_eigenvalues(from.covariance, |value| 1.0 / value.sqrt());
        // Rounding must not turn an eigenvalue of 1e-10 below 0.
        let gain =
            inverse * of_eigenvalues(root * to.covariance * root, |value| value.max(0.0).sqrt()) * inverse;
        Self { gain, shift: to.mean - gain * from.mean }
    }

    /// Maps a color.
    pub fn color(&self, color: [f32; 3]) -> [f32; 3] {
        self.premultiplied(color, 1.0)
    }

    /// Maps a premultiplied color.
    pub fn premultiplied(&self, color: [f32; 3], alpha: f32) -> [f32; 3] {
        (self.gain * vector(color) + self.shift * f64::from(alpha)).as_vec3().to_array()
    }

    /// Maps a view as if every Gaussian's color were mapped. This is exact, because rendering is linear in
    /// color.
    pub fn view(&self, view: &RenderedImage) -> RenderedImage {
        let pixel = |(color, alpha): (&[f32; 3], &f32)| self.premultiplied(*color, *alpha);
        RenderedImage { color: view.color.iter().zip(&view.alpha).map(pixel).collect(), ..view.clone() }
    }
}

fn vector(color: [f32; 3]) -> DVec3 {
    DVec3::from_array(color.map(f64::from))
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// A symmetric matrix with each eigenvalue replaced by `f` of it: `f64::sqrt` gives the square root.
///
/// Colors of a gray scene or painting have one large variance and two at [`VARIANCE_FLOOR`], and products of
/// two such covariances have eigenvalues from 1 to 1e-10. Inverses by determinants do not find the small ones:
/// a determinant of 1e-20 is the difference of products of 1e-3, and may get the wrong sign.
fn of_eigenvalues(matrix: DMat3, f: impl Fn(f64) -> f64) -> DMat3 {
    let (values, axes) = eigen(matrix);
    axes * DMat3::from_diagonal(values.to_array().map(f).into()) * axes.transpose()
}

#[cfg(test)]
mod tests {
    use glam::UVec2;

    use super::*;

    #[test]
    fn a_square_root_squares_to_the_matrix() {
        let matrix = DMat3::from_cols_array(&[2.0, 0.3, 0.1, 0.3, 1.0, -0.2, 0.1, -0.2, 0.5]);
        let root = of_eigenvalues(matrix, f64::sqrt);
        assert!((root * root).abs_diff_eq(matrix, 1e-12));
        assert!((of_eigenvalues(matrix, |value| 1.0 / value) * matrix).abs_diff_eq(DMat3::IDENTITY, 1e-12));
    }

    #[test]
    fn deviations_along_a_direction() {
        // Red is 0 or 1, green always 0.5.
        let moments = ColorMoments::of_rgb(&[0.0, 0.5, 0.0, 1.0, 0.5, 0.0]);
        assert!((moments.deviation_along(Vec3::X) - 0.5).abs() < 1e-3);
        assert!((moments.deviation_along(Vec3::new(0.5, 9.0, 0.0)) - 0.25).abs() < 0.05);
    }

    /// From grays to other grays, dark stays dark. Both covariances are as near to singular as can be.
    #[test]
    fn grays_keep_their_order() {
        let mut random = Random::new(3);
        for deviation in [0.2_f32, 0.5, 1.0, 2.0, 4.0] {
            let gray = |value: f32| [value, value + 1e-4, value];
            let shades = |spread: f32| -> Vec<f32> {
                (0..500).flat_map(|i| gray(0.5 + spread * ((i * 37 % 500) as f32 / 500.0 - 0.5))).collect()
            };
            let spread = deviation * (1.0 + 0.1 * random.uniform());
            let map =
                Recoloring::new(&ColorMoments::of_rgb(&shades(spread)), &ColorMoments::of_rgb(&shades(1.0)));
            let slope = (map.color(gray(1.0))[1] - map.color(gray(0.0))[1]) * spread;
            assert!((slope - 1.0).abs() < 1e-2, "deviation {deviation}: {slope}");
        }
    }

    #[test]
    fn recolored_views_have_the_paintings_moments() {
        let color = |i: usize| [(i % 7) as f32 / 7.0, (i % 5) as f32 / 9.0, (i % 3) as f32 / 3.0];
        let n = 105;
        let view = RenderedImage {
            size: UVec2::new(n as u32, 1),
            color: (0..n).map(color).collect(),
            alpha: vec![1.0; n],
            depth: vec![0.0; n],
        };
        let rgb: Vec<f32> =
            (0..n).flat_map(|i| [(i % 4) as f32 / 4.0, (i % 9) as f32 / 20.0, 0.25]).collect();
        let to = ColorMoments::of_rgb(&rgb);
        let recoloring = Recoloring::new(&ColorMoments::of_views(std::slice::from_ref(&view)), &to);
        let recolored = ColorMoments::of_views(&[recoloring.view(&view)]);
        assert!(recolored.mean.abs_diff_eq(to.mean, 1e-6));
        // The floor is added once more to the measured covariance.
        assert!(recolored.covariance.abs_diff_eq(to.covariance, 2.0 * VARIANCE_FLOOR));
        assert_eq!(recoloring.color(view.color[3]), recoloring.view(&view).color[3]);
    }
}
