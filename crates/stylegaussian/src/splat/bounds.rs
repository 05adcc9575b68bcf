//! The box around all that is drawn of a scene.

use glam::{Mat3, Vec3};

use super::alpha::{MIN_ALPHA, cutoff};
use crate::scene::Scene;

impl Scene {
    /// The smallest and the largest corner of the box around all that is drawn, in scene units, or `None` if
    /// nothing is.
    ///
    /// Each Gaussian counts out to where its alpha falls to [`MIN_ALPHA`], which is at most 3.33 standard
    /// deviations from its mean. [`bounds`](Self::bounds) has the box around the means alone. The low-pass
    /// filter of [`render`](super::render) widens splats by another pixel or two, which no box in scene units
    /// can hold.
    pub fn splat_bounds(&self) -> Option<[Vec3; 2]> {
        let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (i, &mean) in self.means.iter().enumerate() {
            let opacity = self.opacities[i];
            // A NaN opacity passes here, and is dropped with its extents.
            if opacity < MIN_ALPHA || !mean.is_finite() {
                continue;
            }
            let n_deviations = cutoff(opacity).sqrt();
            // The ellipsoid R S u, |u| = 1, reaches as far along an axis as that row of R S is long.
            let axes = Mat3::from_quat(self.rotations[i]) * Mat3::from_diagonal(self.scales[i]);
            let rows = axes.transpose();
            let extents =
                n_deviations * Vec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
            if extents.is_finite() {
                min = min.min(mean - extents);
                max = max.max(mean + extents);
            }
        }
        (min.x <= max.x).then_some([min, max])
    }
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;

    /// A needle along its local x, turned to the world's y, at (1, 2, 3).
    #[test]
    fn a_needle_reaches_as_far_as_its_alpha() {
        let scene = Scene {
            means: vec![Vec3::new(1.0, 2.0, 3.0), Vec3::splat(100.0)],
            rotations: vec![Quat::from_rotation_z(std::f32::consts::FRAC_PI_2), Quat::IDENTITY],
            scales: vec![Vec3::new(2.0, 0.5, 0.25), Vec3::ONE],
            // ln(255 * e^2 / 255) = 2: two standard deviations. The other Gaussian is never seen.
            opacities: vec![2.0_f32.exp() / 255.0, 0.003],
            ..Scene::default()
        };
        let [min, max] = scene.splat_bounds().unwrap();
        let check = |found: Vec3, expected: Vec3| assert!((found - expected).length() < 1e-4, "{found}");
        check(min, Vec3::new(0.0, -2.0, 2.5));
        check(max, Vec3::new(2.0, 6.0, 3.5));
        assert!(Scene::default().splat_bounds().is_none());
    }

    /// Gaussians that are not finite are never drawn, and one alone leaves no box.
    #[test]
    fn wild_gaussians_do_not_count() {
        let wild = [
            (Vec3::new(f32::NAN, 0.0, 0.0), Vec3::ONE, 1.0),
            (Vec3::ZERO, Vec3::splat(f32::INFINITY), 1.0),
            (Vec3::ZERO, Vec3::ONE, f32::NAN),
        ];
        for (mean, scale, opacity) in wild {
            let scene = Scene {
                means: vec![mean],
                rotations: vec![Quat::IDENTITY],
                scales: vec![scale],
                opacities: vec![opacity],
                ..Scene::default()
            };
            assert_eq!(scene.splat_bounds(), None, "{mean} {scale} {opacity}");
        }
    }
}
