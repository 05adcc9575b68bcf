//! Cores in shadow maps, worked out by hand and from the alphas of single splats.

use glam::Mat3;

use super::*;
use crate::mask::MaskUse;

/// Splats ahead at z 2 and 4: a faint one before an opaque one. Of opacity 0.8, alpha is above 0.5 up to sqrt(2
/// ln 1.6) = 0.970 deviations from the center, and above 0.3 up to 1.401; of 0.4, above 0.3 up to 0.759.
#[test]
fn a_splat_casts_a_shadow_where_its_alpha_is_above_the_threshold() {
    let scene = scene(&[
        (Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 0.4),
        (Vec3::new(0.0, 0.0, 4.0), Vec3::splat(0.8), 0.8),
    ]);
    let at = |x: usize, threshold: f32| cast(&scene, &camera(), threshold, None)[4 * 9 + x];
    let near = |found: f32, expected: f32| assert!((found - expected).abs() < 1e-3, "{found}, {expected}");
    near(at(4, 0.5), 4.0 + 0.970 * 0.8);
    near(at(4, 0.3), 2.0 + 0.759 * 0.2);
    // The far one has deviations of 0.8 10 / 4 = 2 pixels, with the low-pass 2.07: for 0.5 it ends between 2
    // and 3 pixels from the middle.
    near(at(6, 0.5), 4.0 + 0.970 * 0.8);
    assert_eq!(at(7, 0.5), f32::INFINITY);
    near(at(6, 0.3), 4.0 + 1.401 * 0.8);
    assert_eq!(at(4, f32::NAN), at(4, CAST_THRESHOLD));
    assert_eq!(at(4, 7.0), f32::INFINITY, "the largest alpha of a splat is 0.99");
    let mask = Visibility { weights: &[[0; 4], [255; 4]], channel: 0, is: MaskUse::Hide };
    assert_eq!(cast(&scene, &camera(), 0.5, Some(&mask))[4 * 9 + 4], f32::INFINITY);
}

/// Each pixel against the blend weights of scenes of one splat each, which are its alphas, and whole
/// covariances.
#[test]
fn cores_agree_with_alphas() {
    let (scene, camera) = (random_scene(400), random_camera());
    let mut expected = vec![f32::INFINITY; (camera.size.x * camera.size.y) as usize];
    for i in 0..scene.len() {
        let one = Scene {
            means: vec![scene.means[i]],
            rotations: vec![scene.rotations[i]],
            scales: vec![scene.scales[i]],
            opacities: vec![scene.opacities[i]],
            order: vec![0],
            ..Scene::default()
        };
        let weights = blend_weights(&one, &camera);
        // The variance along the axis, from the whole covariance.
        let axes = Mat3::from_quat(one.rotations[0]) * Mat3::from_diagonal(one.scales[0]);
        let axis = Vec3::from(camera.view_from_world.matrix3.row(2));
        let variance = axis.dot(axes * axes.transpose() * axis);
        let mean = camera.view_from_world.transform_point3(one.means[0]).z;
        let depth = mean + (2.0 * (one.opacities[0] / 0.4).ln() * variance).max(0.0).sqrt();
        for (pixel, expected) in expected.iter_mut().enumerate() {
            if weights.pixel(pixel).any(|(_, alpha)| alpha >= 0.4) {
                *expected = expected.min(depth);
            }
        }
    }
    // The other filter changes nothing.
    for filter in [ScreenFilter::Classic, ScreenFilter::Antialiased] {
        let found = cast(&Scene { filter, ..scene.clone() }, &camera, 0.4, None);
        // Rounding may decide at the edge of a core.
        let is_wrong = |found: f32, expected: f32| (found.min(1e6) - expected.min(1e6)).abs() > 1e-3;
        let n_wrong =
            found.iter().zip(&expected).filter(|(found, expected)| is_wrong(**found, **expected)).count();
        assert!(n_wrong < 3, "{n_wrong} pixels differ");
        assert!(found.iter().filter(|depth| depth.is_finite()).count() > 50);
    }
}
