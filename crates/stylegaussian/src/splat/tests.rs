//! Hand-worked pictures, and the identities between rendering and its weights.

use glam::{Affine3A, Quat, UVec2, Vec2, Vec3};

use super::*;
use crate::scene::ScreenFilter;

mod cast;
mod iso;

/// A camera at the origin that looks along +z, with a focal length of 10 px and 9 x 9 pixels. The center of
/// pixel (4, 4) lies on the axis.
fn camera() -> Camera {
    Camera {
        view_from_world: Affine3A::IDENTITY,
        focal: Vec2::splat(10.0),
        center: Vec2::splat(4.5),
        size: UVec2::splat(9),
        near: Camera::NEAR,
    }
}

/// A scene of Gaussians given as (mean, scales, opacity), unrotated.
fn scene(gaussians: &[(Vec3, Vec3, f32)]) -> Scene {
    Scene {
        means: gaussians.iter().map(|g| g.0).collect(),
        scales: gaussians.iter().map(|g| g.1).collect(),
        opacities: gaussians.iter().map(|g| g.2).collect(),
        rotations: vec![Quat::IDENTITY; gaussians.len()],
        order: (0..gaussians.len() as u32).collect(),
        n_source: gaussians.len(),
        ..Default::default()
    }
}

fn check(what: &str, found: f32, expected: f32) {
    assert!((found - expected).abs() < 1e-5, "{what}: found {found}, expected {expected}");
}

/// Pseudo-random numbers in 0..1 (a linear congruential generator).
fn randoms(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// Overlapping splats of all shapes and opacities, some of them outside the picture or behind the camera.
fn random_scene(n: usize) -> Scene {
    let mut random = randoms(7);
    let mut scene = Scene::default();
    for i in 0..n {
        scene.means.push(Vec3::new(4.0 * random() - 2.0, 4.0 * random() - 2.0, 5.0 * random() - 0.5));
        scene.scales.push(0.01 + 0.3 * Vec3::new(random(), random(), random()).powf(3.0));
        let axis = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
        scene.rotations.push(Quat::from_axis_angle(axis.normalize(), 6.0 * random()));
        scene.opacities.push(random());
        scene.order.push(i as u32);
    }
    scene
}

fn random_camera() -> Camera {
    Camera::look_at(
        Vec3::new(0.3, -0.2, -1.5),
        Vec3::new(0.0, 0.1, 2.0),
        Vec3::NEG_Y,
        1.0,
        UVec2::new(53, 37),
    )
}

/// Footprint variance (10 * 0.2 / 2)^2 + 0.3 = 1.3 px^2 on both axes.
#[test]
fn one_splat_at_the_center() {
    let view = render(
        &scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 0.5)]),
        Colors::Rgb(&[[1.0, 0.5, -0.25]]),
        &camera(),
    );
    let center = 4 * 9 + 4;
    check("alpha", view.alpha[center], 0.5);
    check("red", view.color[center][0], 0.5);
    check("green", view.color[center][1], 0.25);
    check("blue is not clamped", view.color[center][2], -0.125);
    check("depth", view.depth[center], 1.0);
    let beside = 0.5 * (-0.5f32 / 1.3).exp();
    check("one pixel right", view.alpha[center + 1], beside);
    check("one pixel down", view.alpha[center + 9], beside);
    check("diagonal", view.alpha[center + 10], 0.5 * (-1.0f32 / 1.3).exp());
}

/// q = 2 ln(255 * 0.5) = 9.696: at variance 1.3 the footprint ends 3.55 px from the center.
#[test]
fn the_footprint_ends_where_alpha_reaches_one_in_255() {
    let view =
        render(&scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 0.5)]), Colors::Captured, &camera());
    check("3 px", view.alpha[4 * 9 + 7], 0.5 * (-4.5f32 / 1.3).exp());
    assert_eq!(view.alpha[4 * 9 + 8], 0.0, "4 px away");
    assert!(view.alpha[6 * 9 + 6] > 0.0, "2.83 px away");
    assert_eq!(view.alpha[7 * 9 + 7], 0.0, "4.24 px away");
}

#[test]
fn an_opaque_splat_reaches_beyond_three_sigma() {
    let far_out = scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 1.0)]);
    let sigma = 1.3f32.sqrt();
    let mut camera = camera();
    camera.center.x -= 3.2 * sigma;
    let view = render(&far_out, Colors::Captured, &camera);
    check("3.2 sigma", view.alpha[4 * 9 + 4], (-0.5f32 * 3.2 * 3.2).exp());
}

#[test]
fn the_nearer_of_two_splats_hides_the_farther() {
    let (near, far) = (Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.0, 0.0, 4.0));
    let both = scene(&[(far, Vec3::splat(0.2), 0.8), (near, Vec3::splat(0.1), 0.5)]);
    let view = render(&both, Colors::Rgb(&[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), &camera());
    let center = 4 * 9 + 4;
    check("near", view.color[center][0], 0.5);
    check("far", view.color[center][1], 0.4);
    check("alpha", view.alpha[center], 0.9);
    check("depth", view.depth[center], 0.5 * 1.0 + 0.4 * 4.0);
}

#[test]
fn equal_depths_blend_in_scene_order() {
    let g = (Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 0.5);
    let weights = blend_weights(&scene(&[g, g, g]), &camera());
    let center: Vec<_> = weights.pixel(4 * 9 + 4).collect();
    assert_eq!(center, [(0, 0.5), (1, 0.25), (2, 0.125)]);
}

/// Alpha is capped at 0.99. A second capped splat would leave 1e-4 * (1 - rounding), so the pixel stops before
/// it.
#[test]
fn alpha_is_capped_and_a_pixel_stops_before_it_is_full() {
    let at = |z: f32| (Vec3::new(0.0, 0.0, z), Vec3::splat(0.2), 1.0);
    let one = render(&scene(&[at(2.0)]), Colors::Captured, &camera());
    check("one opaque splat", one.alpha[4 * 9 + 4], 0.99);

    let half = (Vec3::new(0.0, 0.0, 2.5), Vec3::splat(0.2), 0.5);
    let behind = (Vec3::new(0.0, 0.0, 4.0), Vec3::splat(0.2), 0.25);
    // Transmittance: 0.01, 0.005; the third would leave 0.00005, so it and the fourth are not drawn.
    let weights = blend_weights(&scene(&[at(2.0), half, at(3.0), behind]), &camera());
    let center: Vec<_> = weights.pixel(4 * 9 + 4).collect();
    assert_eq!(center.iter().map(|entry| entry.0).collect::<Vec<_>>(), [0, 1]);
    check("what passed the first", center[1].1, 0.005);
}

#[test]
fn near_hidden_and_faint_gaussians_are_not_drawn() {
    // 1/255 is 0.00392.
    for (z, opacity, drawn) in
        [(0.2, 1.0, false), (0.2001, 1.0, true), (-2.0, 1.0, false), (2.0, 0.0039, false), (2.0, 0.004, true)]
    {
        let view = render(
            &scene(&[(Vec3::new(0.0, 0.0, z), Vec3::splat(0.01), opacity)]),
            Colors::Captured,
            &camera(),
        );
        assert_eq!(view.alpha[4 * 9 + 4] > 0.0, drawn, "z {z}, opacity {opacity}");
    }
}

/// Scales (0.4, 0.1) turned by 30 degrees about the view axis at z = 2 with focal 10: standard deviations 2 px
/// and 0.5 px, so the covariance is R diag(4, 0.25) R^T + 0.3 = (3.3625, 1.6238; 1.6238, 1.4875), determinant
/// 2.365.
#[test]
fn a_turned_anisotropic_splat_matches_the_hand_calculation() {
    let mut turned = scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::new(0.4, 0.1, 0.3), 0.9)]);
    turned.rotations[0] = Quat::from_rotation_z(30f32.to_radians());
    let view = render(&turned, Colors::Captured, &camera());
    let (a, b, c) = (3.3625, 3.75 * 0.75f32.sqrt() * 0.5, 1.4875);
    let det = a * c - b * b;
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1), (2, 1), (-2, -1), (1, -1)] {
        let (x, y) = (dx as f32, dy as f32);
        let q = (c * x * x - 2.0 * b * x * y + a * y * y) / det;
        let found = view.alpha[((4 + dy) * 9 + 4 + dx) as usize];
        check(&format!("({dx}, {dy})"), found, 0.9 * (-0.5 * q).exp());
    }
}

/// The splat of the test above: standard deviations 2 px and 0.5 px, determinant 4 * 0.25 = 1 before the
/// low-pass and 4.3 * 0.55 = 2.365 after it.
#[test]
fn an_antialiased_splat_keeps_its_sum() {
    let mut turned = scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::new(0.4, 0.1, 0.3), 0.9)]);
    turned.rotations[0] = Quat::from_rotation_z(30f32.to_radians());
    turned.filter = ScreenFilter::Antialiased;
    let view = render(&turned, Colors::Captured, &camera());
    check("center", view.alpha[4 * 9 + 4], 0.9 / 2.365f32.sqrt());
    // The weights are the same.
    let weights = blend_weights(&turned, &camera());
    assert_eq!(weights.pixel(4 * 9 + 4).next(), Some((0, view.alpha[4 * 9 + 4])));
}

/// A round splat of s px^2 has a factor of s / (s + 0.3): 0.01 / 0.31 leaves 0.032 of an opaque one, 0.001 /
/// 0.301 leaves 0.0033, under 1/255. Without area nothing is left. The sum over the picture is 2 pi s, whatever
/// the distance.
#[test]
fn antialiased_specks_fade() {
    let at = |variance: f32| {
        let mut speck = scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::splat(variance.sqrt() / 5.0), 1.0)]);
        let classic = render(&speck, Colors::Captured, &camera());
        speck.filter = ScreenFilter::Antialiased;
        let view = render(&speck, Colors::Captured, &camera());
        (classic.alpha[4 * 9 + 4], view.alpha[4 * 9 + 4], view.alpha.iter().sum::<f32>())
    };
    check("a speck", at(0.01).1, 0.01 / 0.31);
    check("a faint speck", at(0.001).1, 0.0);
    check("no area", at(0.0).1, 0.0);
    check("no area, classic", at(0.0).0, 0.99);
    // Cut at 1/255, and summed at whole pixels: close to the integral only.
    let (_, _, sum) = at(0.25);
    assert!((sum / (std::f32::consts::TAU * 0.25) - 1.0).abs() < 0.05, "{sum}");
}

/// Off the axis, depth extent leaks into x: J's first row is f / z (1, 0, -x / z). At (1, 0, 2), scales (0, 0,
/// 0.2): standard deviation 10 / 2 * 0.5 * 0.2 = 0.5 px in x.
#[test]
fn perspective_skews_off_axis_splats() {
    let mut camera = camera();
    camera.center.x = -0.5;
    let view = render(
        &scene(&[(Vec3::new(1.0, 0.0, 2.0), Vec3::new(0.0, 0.0, 0.2), 0.5)]),
        Colors::Captured,
        &camera,
    );
    check("center", view.alpha[4 * 9 + 4], 0.5);
    check("in x", view.alpha[4 * 9 + 5], 0.5 * (-0.5f32 / 0.55).exp());
    check("in y", view.alpha[5 * 9 + 4], 0.5 * (-0.5f32 / 0.3).exp());
}

/// Beyond 1.3 times the half field of view (tan = 9 / 20), the Jacobian keeps the slope of that limit: 0.585,
/// not 1.
#[test]
fn the_jacobian_is_clamped_outside_the_picture() {
    let mut camera = camera();
    camera.center.x = -5.5;
    let view = render(
        &scene(&[(Vec3::new(2.0, 0.0, 2.0), Vec3::new(0.0, 0.0, 0.4), 0.5)]),
        Colors::Captured,
        &camera,
    );
    let sigma = 10.0 / 2.0 * 0.585 * 0.4f32;
    check("in x", view.alpha[4 * 9 + 5], 0.5 * (-0.5 / (sigma * sigma + 0.3)).exp());
}

#[test]
fn spherical_harmonics_color_by_direction() {
    let mut seen = scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 0.5)]);
    let mut coefficients = vec![0.0; 12];
    coefficients[0] = 1.0; // red, constant
    coefficients[6 + 1] = 1.0; // green, z
    coefficients[2] = -10.0; // blue, constant: clamped at 0
    seen.sh = Some(crate::scene::Sh { degree: 1, coefficients });
    let color = render(&seen, Colors::Captured, &camera()).color[4 * 9 + 4];
    check("red", color[0], 0.5 * (0.5 + 0.282_094_8));
    check("green", color[1], 0.5 * (0.5 + 0.488_602_5));
    check("blue", color[2], 0.0);
}

/// Every pixel by the definition, in f64, without tiles or footprints.
#[test]
fn tiles_change_nothing() {
    let (scene, camera) = (random_scene(300), random_camera());
    let weights = blend_weights(&scene, &camera);
    assert!(weights.weights.len() > 5_000, "{} entries", weights.weights.len());
    let mut order: Vec<usize> = (0..scene.len()).collect();
    let z = |i: usize| camera.view_from_world.transform_point3(scene.means[i]).z;
    order.sort_by(|&i, &j| z(i).total_cmp(&z(j)));
    let alphas = plain::Alphas::new(&scene, &camera);
    for pixel in 0..53 * 37 {
        let (mut transmittance, mut expected) = (1.0, vec![0.0; scene.len()]);
        for &i in &order {
            let alpha = alphas.alpha(i, pixel % 53, pixel / 53);
            if transmittance * (1.0 - alpha) < 1e-4 {
                break;
            }
            expected[i] = transmittance * alpha;
            transmittance *= 1.0 - alpha;
        }
        for (i, weight) in weights.pixel(pixel) {
            expected[i] -= f64::from(weight);
        }
        let error = expected.iter().fold(0.0f64, |worst, e| worst.max(e.abs()));
        // An alpha close to 1/255 may be above it in f32 and below it in f64, which makes a whole entry of
        // 1/255 appear.
        assert!(error < 1.0 / 250.0, "pixel {pixel}: {error}");
        let total: f64 = expected.iter().map(|e| e.abs()).sum();
        assert!(total < 1.0 / 100.0, "pixel {pixel}: {total}");
    }
}

#[test]
fn applying_the_weights_is_rendering() {
    let (scene, camera) = (random_scene(2_000), random_camera());
    let mut random = randoms(3);
    let colors: Vec<[f32; 3]> = (0..scene.len()).map(|_| [random(), random(), random()]).collect();
    let view = render(&scene, Colors::Rgb(&colors), &camera);
    let weights = blend_weights(&scene, &camera);
    let color = weights.apply(colors.as_flattened(), 3);
    for (found, expected) in color.iter().zip(view.color.as_flattened()) {
        check("color", *found, *expected);
    }
    for (found, expected) in weights.alpha().iter().zip(&view.alpha) {
        check("alpha", *found, *expected);
    }
    assert_eq!(weights.starts.len(), 53 * 37 + 1);
    assert_eq!(*weights.starts.last().unwrap() as usize, weights.weights.len());
    assert!(weights.weights.iter().all(|&w| w > 0.0));
}

/// Most Gaussians outside of a picture are left out before their shape is known. None of those that reach into
/// it may be.
#[test]
fn what_reaches_into_the_picture_is_projected() {
    let (scene, whole) = (random_scene(2_000), random_camera());
    let (corner, size) = (UVec2::new(31, 4), UVec2::new(13, 21));
    let crop = Camera { center: whole.center - corner.as_vec2(), size, ..whole };
    let splats = project(&scene, &crop, None);
    let alphas = plain::Alphas::new(&scene, &crop);
    let alpha = |i| (0..13 * 21).map(|pixel| alphas.alpha(i, pixel % 13, pixel / 13)).fold(0.0, f64::max);
    // An alpha close to 1/255 may be below it in f32.
    let seen: Vec<usize> = (0..scene.len()).filter(|&i| alpha(i) > 0.004).collect();
    for &i in &seen {
        assert!(splats.iter().any(|splat| splat.gaussian as usize == i), "Gaussian {i} is missing");
    }
    assert!((100..1_000).contains(&seen.len()), "{} are seen", seen.len());
}

#[test]
fn weights_from_a_least_one_on_are_some_of_all() {
    let (scene, camera) = (random_scene(2_000), random_camera());
    let all = blend_weights(&scene, &camera);
    for least in [1e-3, 0.05] {
        let found = blend_weights_from(&scene, &camera, least);
        let n_pixels = found.starts.len() - 1;
        for pixel in 0..n_pixels {
            let expected: Vec<_> = all.pixel(pixel).filter(|(_, weight)| *weight >= least).collect();
            assert_eq!(found.pixel(pixel).collect::<Vec<_>>(), expected, "pixel {pixel} from {least} on");
        }
        assert!((1..all.weights.len()).contains(&found.weights.len()), "{least}");
    }
}

/// d loss / d color of each Gaussian, loss = sum_p g_p . picture_p, against central differences of `render`.
#[test]
fn the_gradient_matches_finite_differences() {
    let (scene, camera) = (random_scene(60), random_camera());
    let mut random = randoms(5);
    let mut colors: Vec<[f32; 3]> = (0..scene.len()).map(|_| [random(), random(), random()]).collect();
    let gradient: Vec<f32> = (0..53 * 37 * 3).map(|_| random() - 0.5).collect();
    let found = blend_weights(&scene, &camera).apply_transposed(&gradient, 3);
    let loss = |colors: &[[f32; 3]]| -> f64 {
        let view = render(&scene, Colors::Rgb(colors), &camera);
        let terms = view.color.as_flattened().iter().zip(&gradient);
        terms.map(|(c, g)| f64::from(*c) * f64::from(*g)).sum()
    };
    assert!(found.iter().filter(|g| g.abs() > 0.1).count() > 20, "most Gaussians are seen");
    for i in 0..colors.len() {
        for channel in 0..3 {
            let kept = colors[i][channel];
            let step = 0.5; // the render is linear in color: a large step only helps
            colors[i][channel] = kept + step;
            let above = loss(&colors);
            colors[i][channel] = kept - step;
            let below = loss(&colors);
            colors[i][channel] = kept;
            let expected = (above - below) / (2.0 * f64::from(step));
            let error = (f64::from(found[i * 3 + channel]) - expected).abs();
            assert!(error < 1e-4 * (1.0 + expected.abs()), "Gaussian {i}, channel {channel}: {error}");
        }
    }
}

#[test]
fn apply_transposed_is_the_adjoint_and_ignores_the_number_of_threads() {
    let (scene, camera) = (random_scene(2_000), random_camera());
    let weights = blend_weights(&scene, &camera);
    let mut random = randoms(9);
    let values: Vec<f32> = (0..scene.len() * 5).map(|_| random()).collect();
    let gradient: Vec<f32> = (0..53 * 37 * 5).map(|_| random()).collect();
    let dot = |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(x, y)| f64::from(x * y)).sum() };
    let back = weights.apply_transposed(&gradient, 5);
    let (left, right) = (dot(&weights.apply(&values, 5), &gradient), dot(&values, &back));
    assert!((left - right).abs() < 1e-5 * left.abs(), "{left} {right}");
    for n in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        assert_eq!(pool.install(|| weights.apply_transposed(&gradient, 5)), back, "{n} threads");
    }
}

#[test]
fn empty_scenes_and_empty_pictures_are_fine() {
    let empty = Scene::default();
    assert!(render(&empty, Colors::Captured, &camera()).alpha.iter().all(|&a| a == 0.0));
    assert!(blend_weights(&empty, &camera()).apply_transposed(&[1.0; 81 * 2], 2).is_empty());
    let one = scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 0.5)]);
    for size in [UVec2::new(0, 5), UVec2::new(5, 0)] {
        let nothing = Camera { size, ..camera() };
        assert!(render(&one, Colors::Captured, &nothing).alpha.is_empty());
        assert_eq!(blend_weights(&one, &nothing).starts, [0]);
    }
}

/// Gaussians that overflow in single precision must vanish and not spread NaN over the picture.
#[test]
fn overflowing_gaussians_leave_no_nan() {
    let wild = [
        (Vec3::new(0.0, 0.0, 2.0), Vec3::splat(1e30), 0.5),
        (Vec3::new(1e30, -1e30, 1e30), Vec3::splat(1e30), 0.5),
        (Vec3::new(f32::NAN, 0.0, 2.0), Vec3::ONE, 0.5),
        (Vec3::new(0.0, 0.0, 2.0), Vec3::splat(f32::INFINITY), f32::NAN),
        (Vec3::new(0.0, 0.0, 2.0), Vec3::new(1e9, 1e-9, 0.0), 0.5),
    ];
    let view = render(&scene(&wild), Colors::Captured, &camera());
    assert!(view.alpha.iter().all(|a| (0.0..=1.0).contains(a)), "{:?}", view.alpha);
    assert!(view.color.as_flattened().iter().all(|c| c.is_finite()));
}

/// The footprint by its textbook formula, in f64.
mod plain {
    use glam::{DMat2, DMat3, DVec2, DVec3};

    use crate::{camera::Camera, scene::Scene};

    /// Center, inverse covariance and opacity of every Gaussian's footprint, or `None` if it is culled.
    pub struct Alphas(Vec<Option<(DVec2, DMat2, f64)>>);

    impl Alphas {
        pub fn new(scene: &Scene, camera: &Camera) -> Self {
            Self((0..scene.len()).map(|i| footprint(scene, camera, i)).collect())
        }

        pub fn alpha(&self, i: usize, x: usize, y: usize) -> f64 {
            let Some((center, conic, opacity)) = self.0[i] else { return 0.0 };
            let d = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - center;
            let alpha = (opacity * (-0.5 * d.dot(conic * d)).exp()).min(0.99);
            if alpha < 1.0 / 255.0 { 0.0 } else { alpha }
        }
    }

    fn footprint(scene: &Scene, camera: &Camera, i: usize) -> Option<(DVec2, DMat2, f64)> {
        let view_from_world = camera.view_from_world;
        let mean = view_from_world.transform_point3(scene.means[i]).as_dvec3();
        if mean.z <= 0.2 {
            return None;
        }
        let focal = camera.focal.as_dvec2();
        let limit = 1.3 * camera.size.as_dvec2() / (2.0 * focal);
        let ray = DVec2::new(mean.x, mean.y) / mean.z;
        let clamped = ray.clamp(-limit, limit);
        let j = DMat3::from_cols(
            DVec3::new(focal.x / mean.z, 0.0, 0.0),
            DVec3::new(0.0, focal.y / mean.z, 0.0),
            DVec3::new(-focal.x * clamped.x / mean.z, -focal.y * clamped.y / mean.z, 0.0),
        );
        let rotation = DMat3::from_quat(scene.rotations[i].as_dquat());
        let scales = DMat3::from_diagonal(scene.scales[i].as_dvec3());
        let m = j * glam::Mat3::from(view_from_world.matrix3).as_dmat3() * rotation * scales;
        let covariance = m * m.transpose();
        let covariance = DMat2::from_cols(
            DVec2::new(covariance.x_axis.x + 0.3, covariance.x_axis.y),
            DVec2::new(covariance.y_axis.x, covariance.y_axis.y + 0.3),
        );
        let center = focal * ray + camera.center.as_dvec2();
        Some((center, covariance.inverse(), f64::from(scene.opacities[i])))
    }
}
