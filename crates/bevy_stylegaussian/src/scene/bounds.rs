//! The box that frustum culling tests. It encloses whole splats, not only their means.

use bevy::{
    camera::primitives::Aabb,
    math::{Mat3, Vec3},
};
use stylegaussian::{Scene, splat::MIN_ALPHA};

/// The box around all visible splats, or `None` if there are none.
///
/// A splat of opacity o ends at r standard deviations, where its alpha o exp(-r^2 / 2) falls to [`MIN_ALPHA`] (1/255):
/// r = sqrt(2 ln(255 o)), at most 3.33.
pub(super) fn bounds(scene: &Scene) -> Option<Aabb> {
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (i, &mean) in scene.means.iter().enumerate() {
        let opacity = scene.opacities[i];
        if opacity < MIN_ALPHA || !mean.is_finite() {
            continue;
        }
        let n_deviations = (2.0 * (opacity / MIN_ALPHA).ln()).sqrt();
        // The ellipsoid R S u, |u| = 1, reaches as far along an axis as that row of R S is long.
        let axes = Mat3::from_quat(scene.rotations[i]) * Mat3::from_diagonal(scene.scales[i]);
        let rows = axes.transpose();
        let extents =
            n_deviations * Vec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
        if extents.is_finite() {
            min = min.min(mean - extents);
            max = max.max(mean + extents);
        }
    }
    (min.x <= max.x).then(|| Aabb::from_min_max(min, max))
}

#[cfg(test)]
mod tests {
    use bevy::math::Quat;

    use super::*;

    /// A needle along its own x, turned to the world's y, at (1, 2, 3).
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
        let aabb = bounds(&scene).unwrap();
        let check = |found: Vec3, expected: Vec3| assert!((found - expected).length() < 1e-4, "{found}");
        check(aabb.center.into(), Vec3::new(1.0, 2.0, 3.0));
        check(aabb.half_extents.into(), Vec3::new(1.0, 4.0, 0.5));
        assert!(bounds(&Scene::default()).is_none());
    }
}
