//! Cores in shadow maps, worked out by hand and from the alphas of single splats.

use super::*;
use crate::mask::MaskUse;

/// Splats ahead at z 2 and 4: a faint one before an opaque one. Of opacity 0.8, alpha is above 0.5 up to sqrt(2
/// ln 1.6) = 0.97 deviations from the center, and above 0.3 up to 1.40.
#[test]
fn a_splat_casts_a_shadow_where_its_alpha_is_above_the_threshold() {
    let scene = scene(&[
        (Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 0.4),
        (Vec3::new(0.0, 0.0, 4.0), Vec3::splat(0.8), 0.8),
    ]);
    let at = |x: usize, threshold: f32| cast(&scene, &camera(), threshold, None)[4 * 9 + x];
    assert_eq!([0.5, 0.3].map(|threshold| at(4, threshold)), [4.0, 2.0], "in the middle");
    // The far one has deviations of 0.8 10 / 4 = 2 pixels, with the low-pass 2.07: it ends between 2 and 3 pixels
    // from the middle for 0.5.
    assert_eq!([at(6, 0.5), at(7, 0.5)], [4.0, f32::INFINITY]);
    assert_eq!(at(6, 0.3), 4.0);
    assert_eq!(at(4, f32::NAN), at(4, CAST_THRESHOLD));
    assert_eq!(at(4, 7.0), f32::INFINITY, "the largest alpha of a splat is 0.99");
    let mask = Visibility { weights: &[[0; 4], [255; 4]], channel: 0, is: MaskUse::Hide };
    assert_eq!(cast(&scene, &camera(), 0.5, Some(&mask))[4 * 9 + 4], f32::INFINITY);
}

/// Each pixel against the blend weights of scenes of one splat each, which are its alphas.
#[test]
fn cores_agree_with_alphas() {
    let (scene, camera) = (random_scene(150), random_camera());
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
        let depth = camera.view_from_world.transform_point3(one.means[0]).z;
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
        let n_wrong = found.iter().zip(&expected).filter(|(found, expected)| found != expected).count();
        assert!(n_wrong < 3, "{n_wrong} pixels differ");
        assert!(found.iter().filter(|depth| depth.is_finite()).count() > 300);
    }
}
