//! Scenes of known shape: positions of cameras, and the parts that they must see.

use std::sync::{Arc, OnceLock};

use crate::{
    random::Random,
    splat::{Colors, render},
};
use glam::{Quat, Vec3};

use super::*;

mod surroundings;
mod within;
mod worlds;

const SIZE: UVec2 = UVec2::new(48, 32);

/// Flat Gaussians on the rectangle `corner` + [0, 1] x `u` + [0, 1] x `v`, `n` by `n` of them.
fn add_rectangle(scene: &mut Scene, corner: Vec3, u: Vec3, v: Vec3, n: usize) {
    let facing = Quat::from_rotation_arc(Vec3::Z, u.cross(v).normalize());
    for i in 0..n * n {
        let (s, t) = (((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32);
        scene.means.push(corner + s * u + t * v);
        scene.rotations.push(facing);
        let sigma = 0.6 * u.length().max(v.length()) / n as f32;
        scene.scales.push(Vec3::new(sigma, sigma, 0.05 * sigma));
        scene.opacities.push(0.95);
        scene.order.push(scene.order.len() as u32);
        scene.n_source += 1;
    }
}

/// The six sides of a box.
fn add_box(scene: &mut Scene, low: Vec3, high: Vec3, n: usize) {
    let Vec3 { x, y, z } = high - low;
    let (x, y, z) = (x * Vec3::X, y * Vec3::Y, z * Vec3::Z);
    for (corner, u, v) in [(low, x, y), (low, y, z), (low, z, x)] {
        add_rectangle(scene, corner, u, v, n);
        add_rectangle(scene, high, -u, -v, n);
    }
}

/// A box on a floor, y up: unit cube on 4 x 4.
fn box_on_a_floor() -> Scene {
    let mut scene = Scene::default();
    add_box(&mut scene, Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 1.0, 0.5), 12);
    add_rectangle(&mut scene, Vec3::new(-2.0, 0.0, -2.0), 4.0 * Vec3::X, 4.0 * Vec3::Z, 24);
    scene
}

/// A point of the unit sphere.
fn direction(random: &mut Random) -> Vec3 {
    let around = Vec3::new(random.normal(), random.normal(), random.normal());
    around.normalize_or(Vec3::X)
}

/// Adds a round Gaussian.
fn add_ball(scene: &mut Scene, mean: Vec3, scale: f32) {
    scene.means.push(mean);
    scene.rotations.push(Quat::IDENTITY);
    scene.scales.push(Vec3::splat(scale));
    scene.opacities.push(0.8);
    scene.order.push(scene.order.len() as u32);
    scene.n_source += 1;
}

/// A room of 8 x 3 x 6 with furniture finer than the walls. Its file gives y as up, because floor and ceiling
/// are alike.
fn room() -> Scene {
    let mut scene = Scene { up: Some(Vec3::Y), ..Scene::default() };
    add_box(&mut scene, Vec3::ZERO, Vec3::new(8.0, 3.0, 6.0), 24);
    for (x, z) in [(1.0, 1.0), (6.5, 1.2), (3.5, 4.8), (6.0, 4.5)] {
        let corner = Vec3::new(x, 0.0, z);
        add_box(&mut scene, corner, corner + Vec3::new(0.8, 0.9, 0.7), 12);
    }
    scene
}

fn turned(scene: &Scene, rotation: Quat) -> Scene {
    Scene {
        means: scene.means.iter().map(|&mean| rotation * mean).collect(),
        rotations: scene.rotations.iter().map(|&from| rotation * from).collect(),
        ..scene.clone()
    }
}

fn scaled(scene: &Scene, factor: f32) -> Scene {
    Scene {
        means: scene.means.iter().map(|&mean| factor * mean).collect(),
        scales: scene.scales.iter().map(|&scales| factor * scales).collect(),
        ..scene.clone()
    }
}

fn surveyed(scene: &Scene) -> Survey {
    let survey = Survey::new(scene, N_STAND_IN, &Work::default());
    survey.expect("nobody cancels it").expect("something to see")
}

/// The world direction that points up in the picture.
fn picture_up(camera: &Camera) -> Vec3 {
    -Vec3::from(camera.view_from_world.inverse().matrix3.y_axis)
}

/// The share of the Gaussians whose means lie within some camera's picture.
fn share_framed(scene: &Scene, cameras: &[Camera]) -> f32 {
    let is_framed = |&mean: &Vec3| {
        cameras.iter().any(|camera| {
            let view = camera.view_from_world.transform_point3(mean);
            let pixel = camera.focal * view.truncate() / view.z + camera.center;
            view.z > 0.2 && pixel.cmpge(glam::Vec2::ZERO).all() && pixel.cmple(SIZE.as_vec2()).all()
        })
    };
    scene.means.iter().filter(|mean| is_framed(mean)).count() as f32 / scene.len() as f32
}

#[test]
fn a_framing_that_nobody_waits_for_goes_no_further() {
    let scene = box_on_a_floor();
    // Canceled before it begins, and at each share that it tells.
    for (before, stop) in [(-1.0, 0.0), (0.0, 0.2), (0.2, 0.5), (0.5, 0.7), (0.7, 0.9)] {
        let own = Arc::new(OnceLock::<Work>::new());
        let known = Arc::clone(&own);
        let telling = Work::telling(move |share| {
            if share > before {
                known.get().unwrap().cancel();
            }
        });
        let work = own.get_or_init(|| telling);
        if before < 0.0 {
            work.cancel();
        }
        assert_eq!(framing_if_wanted(&scene, work), Err(Canceled), "{stop}");
        assert_eq!(work.done(), stop);
    }
    assert_eq!(framing_if_wanted(&scene, &Work::default()), Ok(framing(&scene)));
}

#[test]
fn an_object_is_seen_from_outside_and_above_its_floor_too() {
    let scene = box_on_a_floor();
    let cameras = choose_views(&scene, 12, SIZE);
    assert_eq!(cameras.len(), 12);
    for camera in &cameras {
        assert_eq!(camera.size, SIZE);
        assert!(camera.position().length() > 2.5, "eye at {}", camera.position());
        assert!(picture_up(camera).y > 0.3, "tilted: {}", picture_up(camera));
        let covered = render(&scene, Colors::Captured, camera).alpha.iter().sum::<f32>() / (48.0 * 32.0);
        assert!(covered > 0.1, "an empty picture from {}", camera.position());
    }
    assert!(share_framed(&scene, &cameras) > 0.98);
    // Overviews and closer looks alternate.
    assert!(cameras[1].focal.x > 1.5 * cameras[0].focal.x);
}

#[test]
fn a_place_is_seen_from_within() {
    let scene = room();
    let inside = |camera: &Camera| {
        let eye = camera.position();
        eye.cmpgt(Vec3::ZERO).all() && eye.cmplt(Vec3::new(8.0, 3.0, 6.0)).all()
    };
    for cameras in [choose_views(&scene, 24, SIZE), orbit(&scene, 6, SIZE)] {
        for camera in &cameras {
            assert!(inside(camera), "eye at {}", camera.position());
            assert!(picture_up(camera).y > 0.8, "tilted: {}", picture_up(camera));
            let alpha = render(&scene, Colors::Captured, camera).alpha;
            assert!(alpha.iter().sum::<f32>() > 0.9 * alpha.len() as f32, "a hole in the wall?");
        }
    }
    assert!(share_framed(&scene, &choose_views(&scene, 24, SIZE)) > 0.9);
}

/// The sky of Scaniverse: 10,000 opaque Gaussians at 240 times the scene's radius, large enough to close the
/// sphere.
fn add_sky(scene: &mut Scene, middle: Vec3, radius: f32) {
    let (n, distance) = (10_000, 240.0 * radius);
    for i in 0..n {
        // Even by the golden angle: each band of equal height has an equal area.
        let y = 1.0 - (2 * i + 1) as f32 / n as f32;
        let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
        let direction = Vec3::new(cos, 0.0, sin) * (1.0 - y * y).sqrt() + y * Vec3::Y;
        scene.means.push(middle + distance * direction);
        scene.rotations.push(Quat::from_rotation_arc(Vec3::Z, direction));
        scene.scales.push(Vec3::new(0.02, 0.02, 1e-4) * distance);
        scene.opacities.push(253.0 / 255.0);
        scene.order.push(scene.order.len() as u32);
        scene.n_source += 1;
    }
}

#[test]
fn a_sky_far_away_changes_no_view() {
    for (plain, middle, radius) in
        [(box_on_a_floor(), Vec3::Y * 0.5, 2.9), (room(), Vec3::new(4.0, 1.5, 3.0), 5.0)]
    {
        let mut under_sky = plain.clone();
        add_sky(&mut under_sky, middle, radius);
        assert_eq!(choose_views(&under_sky, 8, SIZE), choose_views(&plain, 8, SIZE));
        assert_eq!(orbit(&under_sky, 4, SIZE), orbit(&plain, 4, SIZE));
        // The box is that of the scene itself, and there is no other without a sky.
        assert_eq!(bounds_without_backdrop(&under_sky), plain.bounds());
        assert_eq!(bounds_without_backdrop(&plain), None);
        // Strays, as most captures have.
        let mut with_strays = plain.clone();
        with_strays.means[0] = Vec3::splat(1e6);
        let [a, b] = [&with_strays, &plain].map(|scene| surveyed(scene).radius);
        assert!((a / b - 1.0).abs() < 0.05, "radius {a} instead of {b}");
        let (min, max) = bounds_without_backdrop(&with_strays).expect("a stray is far away");
        let (whole_min, whole_max) = plain.bounds().unwrap();
        assert!(whole_min.cmple(min).all() && max.cmple(whole_max).all(), "{min} {max}");
    }
}

/// Tiny and huge scenes work too, although their overviews would lie within the near plane or far out.
#[test]
fn the_unit_of_length_does_not_matter() {
    for factor in [1e-3, 0.05, 30.0] {
        let scene = scaled(&box_on_a_floor(), factor);
        for camera in choose_views(&scene, 4, SIZE) {
            let covered = render(&scene, Colors::Captured, &camera).alpha.iter().sum::<f32>() / (48.0 * 32.0);
            assert!(covered > 0.1, "scaled by {factor}: an empty picture from {}", camera.position());
        }
    }
}

#[test]
fn up_is_told_or_guessed() {
    let scene = box_on_a_floor();
    let check = |what: &str, scene: &Scene, expected: Vec3| {
        let found = surveyed(scene).up;
        assert!(found.dot(expected) > 0.99, "{what}: {found}");
    };
    check("y up", &scene, Vec3::Y);
    check("y down", &turned(&scene, Quat::from_rotation_x(std::f32::consts::PI)), Vec3::NEG_Y);
    check("z up", &turned(&scene, Quat::from_rotation_x(std::f32::consts::FRAC_PI_2)), Vec3::Z);
    let tilt = Quat::from_rotation_x(std::f32::consts::PI - 0.2);
    check("tilted by 11 degrees", &turned(&scene, tilt), tilt * Vec3::Y);
    check("told", &Scene { up: Some(2.0 * Vec3::X), ..scene.clone() }, Vec3::X);

    let mut poster = Scene::default();
    add_rectangle(&mut poster, Vec3::ZERO, 3.0 * Vec3::X, 2.0 * Vec3::Y, 20);
    check("a poster stands, y down", &poster, Vec3::NEG_Y);
    // Random normals are no surface, and neither is one huge Gaussian of a sky among them.
    for seed in 0..5 {
        let mut random = Random::new(seed);
        let mut noise = scene.clone();
        noise.rotations.fill_with(|| {
            let [x, y, z, w] = [(); 4].map(|()| random.normal());
            Quat::from_xyzw(x, y, z, w).normalize()
        });
        let up = |scene: &Scene| surveyed(scene).up;
        assert_eq!(up(&noise), Vec3::NEG_Y, "random normals");
        noise.scales[0] = Vec3::new(20.0, 20.0, 0.1);
        assert_eq!(up(&noise), Vec3::NEG_Y, "random normals and a sky");
    }
    // Without any normals, the convention decides.
    let round = Scene { scales: vec![Vec3::splat(0.1); scene.len()], ..scene.clone() };
    check("no surface", &round, Vec3::NEG_Y);
}

#[test]
fn an_orbit_goes_around_at_one_distance() {
    let cameras = orbit(&box_on_a_floor(), 8, SIZE);
    assert_eq!(cameras.len(), 8);
    let mut around = Vec3::ZERO;
    for (camera, next) in cameras.iter().zip(cameras.iter().cycle().skip(1)) {
        assert_eq!(camera.focal, cameras[0].focal);
        assert!((camera.position().length() - cameras[0].position().length()).abs() < 0.1);
        around += camera.position().cross(next.position());
    }
    assert!(around.y > 0.0, "counter-clockwise from above");
}

#[test]
fn an_orbit_cuts_nothing_off() {
    let mut random = Random::new(1);
    let mut ball = Scene::default();
    for i in 0..5000 {
        let at = Vec3::from([(); 3].map(|()| random.normal())).normalize();
        ball.means.push(at);
        ball.rotations.push(Quat::IDENTITY);
        ball.scales.push(Vec3::splat(0.03));
        ball.opacities.push(0.9);
        ball.order.push(i);
    }
    ball.n_source = ball.len();
    for camera in orbit(&ball, 8, SIZE) {
        let is_shown = |mean: &Vec3| {
            let view = camera.view_from_world.transform_point3(*mean);
            // To two deviations.
            let at = (view.truncate().abs() + 0.06) / view.z * camera.focal;
            at.cmple(0.5 * SIZE.as_vec2()).all()
        };
        assert!(ball.means.iter().all(is_shown));
    }
}

#[test]
fn one_scene_one_choice() {
    let scene = box_on_a_floor();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let alone = pool.install(|| choose_views(&scene, 6, SIZE));
    assert_eq!(alone, choose_views(&scene, 6, SIZE));
    // The first views do not depend on how many follow.
    assert_eq!(alone[..4], choose_views(&scene, 4, SIZE));
}

/// The same Gaussians in another order, more than the stand-in holds.
#[test]
fn the_order_in_the_file_does_not_matter() {
    let mut scene = Scene::default();
    add_box(&mut scene, Vec3::splat(-1.0), Vec3::splat(1.0), 100);
    assert!(scene.len() > 40_000, "{}", scene.len());
    let n = scene.len();
    let shuffled: Vec<u32> = (0..n).map(|i| (i * 7919 % n) as u32).collect();
    let [one, other] = [&scene, &scene.subset(&shuffled)].map(|scene| choose_views(scene, 4, SIZE));
    assert_eq!(one, other);
}

#[test]
fn nothing_and_next_to_nothing() {
    assert!(choose_views(&Scene::default(), 5, SIZE).is_empty());
    assert!(orbit(&Scene::default(), 5, SIZE).is_empty());
    let invisible = Scene { opacities: vec![0.0; box_on_a_floor().len()], ..box_on_a_floor() };
    assert!(choose_views(&invisible, 5, SIZE).is_empty());
    let one = box_on_a_floor().subset(&[0]);
    for cameras in [choose_views(&one, 3, SIZE), orbit(&one, 3, UVec2::ZERO)] {
        assert_eq!(cameras.len(), 3);
        assert!(
            cameras.iter().all(|c| c.view_from_world.is_finite() && c.focal.is_finite() && c.focal.x > 0.0)
        );
    }
    assert!(choose_views(&one, 0, SIZE).is_empty());
}
