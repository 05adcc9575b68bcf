//! Iso depths, worked out by hand and from blend weights.

use super::*;

/// Light behind three splats of opacity 0.3 ahead: 0.7, 0.49, 0.343. Less than half of it passes the second,
/// and less than 0.7 and a bit the first.
#[test]
fn iso_depth_is_that_of_the_splat_behind_which_light_falls_under_the_threshold() {
    let at = |z: f32| (Vec3::new(0.0, 0.0, z), Vec3::splat(0.2), 0.3);
    let scene = scene(&[at(4.0), at(2.0), at(3.0)]);
    let center = |threshold: f32| iso_depth(&scene, &camera(), threshold, None)[4 * 9 + 4];
    assert_eq!([0.71, 0.5, 0.4, 0.3].map(center), [2.0, 3.0, 4.0, f32::INFINITY]);
    assert_eq!(center(f32::NAN), center(ISO_THRESHOLD));
    assert_eq!(center(7.0), 2.0, "at 1, the first splat counts");
    let corner = iso_depth(&scene, &camera(), ISO_THRESHOLD, None)[0];
    assert_eq!(corner, f32::INFINITY, "no splat reaches the corner");
}

/// Iso depths against sums of blend weights, an independent form, at pixels of cut tiles too.
#[test]
fn iso_depth_agrees_with_blend_weights() {
    let (scene, camera) = (random_scene(600), random_camera());
    let weights = blend_weights(&scene, &camera);
    let depths = iso_depth(&scene, &camera, 0.6, None);
    let mut n_found = 0;
    for (pixel, &found) in depths.iter().enumerate() {
        let mut light = 1.0_f32;
        let crossing = weights.pixel(pixel).find(|(_, weight)| {
            light -= weight;
            light < 0.6
        });
        let depth = |(i, _): (usize, f32)| camera.view_from_world.transform_point3(scene.means[i]).z;
        assert_eq!(found, crossing.map_or(f32::INFINITY, depth), "pixel {pixel}");
        n_found += usize::from(found.is_finite());
    }
    assert!(n_found > 500, "only {n_found} pixels have a depth");
}
