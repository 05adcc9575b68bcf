//! Worlds of any scale: the same things in other units give the same pictures.

use crate::{random::Random, splat::Colors};

use super::*;

const SCALES: [f32; 6] = [1e-4, 1e-3, 0.01, 0.1, 100.0, 1e4];

/// The same camera in a world that is scaled, before what it sees there.
fn scaled_camera(camera: &Camera, scene: &Scene, factor: f32) -> Camera {
    let mut scaled = camera.clone();
    scaled.view_from_world.translation *= factor;
    scaled.near_among(&scene.means)
}

/// Alpha of a picture.
fn alpha(scene: &Scene, camera: &Camera) -> Vec<f32> {
    render(scene, Colors::Captured, camera).alpha
}

/// The mean difference between two pictures.
fn difference(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32
}

#[test]
fn cameras_see_the_same_in_every_unit() {
    let scene = box_on_a_floor();
    let eyes = [Vec3::new(2.0, 2.0, 5.0), Vec3::new(0.9, 0.7, 1.1)];
    for eye in eyes {
        let camera = Camera::look_at(eye, Vec3::Y * 0.5, Vec3::Y, 0.8, SIZE).near_among(&scene.means);
        let expected = alpha(&scene, &camera);
        assert!(expected.iter().sum::<f32>() > 100.0);
        for factor in SCALES {
            let scene = scaled(&scene, factor);
            let camera = scaled_camera(&camera, &scene, factor);
            let found = difference(&alpha(&scene, &camera), &expected);
            assert!(found < 1e-3, "{factor}, from {eye}: {found}");
        }
    }
}

#[test]
fn chosen_cameras_see_the_same_in_every_unit() {
    let scene = box_on_a_floor();
    let cameras = orbit(&scene, 2, SIZE);
    for factor in SCALES {
        let scaled = scaled(&scene, factor);
        for (found, camera) in orbit(&scaled, 2, SIZE).iter().zip(&cameras) {
            let moved = found.position().distance(factor * camera.position()) / factor;
            assert!(moved < 1e-3, "{factor}: {moved} away");
            let difference = difference(&alpha(&scaled, found), &alpha(&scene, camera));
            assert!(difference < 1e-3, "{factor}: {difference}");
        }
    }
}

/// A half-transparent ball on the ground, denser in its middle, and a background far away. The gaps in the ball
/// are nearly wide enough to stand in.
fn ball_on_the_ground() -> Scene {
    let mut random = Random::new(9);
    let mut scene = Scene { up: Some(Vec3::Y), ..Scene::default() };
    for _ in 0..4000 {
        add_ball(&mut scene, 0.2 * 5.0_f32.powf(random.uniform()) * direction(&mut random), 0.04);
    }
    for _ in 0..1700 {
        let (distance, angle) = (6.0 * random.uniform().sqrt(), std::f32::consts::TAU * random.uniform());
        add_ball(&mut scene, Vec3::new(distance * angle.cos(), -1.0, distance * angle.sin()), 0.12);
    }
    for _ in 0..300 {
        let distance = 5.0 * 20.0_f32.powf(random.uniform());
        let mean = distance * direction(&mut random);
        add_ball(&mut scene, mean.with_y(mean.y.abs()), 0.06 * distance);
    }
    scene
}

#[test]
fn cameras_stand_at_the_same_places_in_every_unit() {
    let scene = ball_on_the_ground();
    let choose = |scene: &Scene| [orbit(scene, 3, SIZE), choose_views(scene, 4, SIZE)].concat();
    let cameras = choose(&scene);
    for camera in &cameras {
        assert!(camera.position().length() > 1.5, "within the ball: {}", camera.position());
    }
    for factor in [1e-3, 0.1, 10.0, 1e3] {
        let found = choose(&scaled(&scene, factor));
        assert_eq!(found.len(), cameras.len());
        for (found, camera) in found.iter().zip(&cameras) {
            let moved = found.position().distance(factor * camera.position()) / factor;
            // Roundings may move the box by a Gaussian.
            assert!(moved < 0.02, "{factor}: {moved} away from {}", camera.position());
            assert!((found.near / (factor * camera.near) - 1.0).abs() < 0.02, "{factor}: {}", found.near);
        }
    }
}

#[test]
fn rooms_of_any_scale_are_seen_from_within() {
    // A fifth of the room is about as large as the unit.
    for factor in [1e-4, 0.2, 1e4] {
        let scene = scaled(&room(), factor);
        for camera in orbit(&scene, 3, SIZE) {
            let eye = camera.position() / factor;
            assert!(eye.cmpgt(Vec3::ZERO).all() && eye.cmplt(Vec3::new(8.0, 3.0, 6.0)).all(), "{eye}");
            let covered = alpha(&scene, &camera).iter().sum::<f32>() / SIZE.element_product() as f32;
            assert!(covered > 0.9, "{factor}: {covered}");
        }
    }
}

/// One, two and three Gaussians, and many in one point: of any size, they are seen.
#[test]
fn a_few_gaussians_of_any_size_are_seen() {
    for size in [1e-4, 1e-2, 1.0, 1e4] {
        for means in [
            vec![Vec3::ZERO],
            vec![Vec3::ZERO, Vec3::X],
            vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            vec![Vec3::ONE; 100],
        ] {
            let n = means.len();
            let scene = Scene {
                means: means.iter().map(|&mean| size * mean).collect(),
                rotations: vec![Quat::IDENTITY; n],
                scales: vec![Vec3::splat(0.3 * size); n],
                opacities: vec![0.9; n],
                order: (0..n as u32).collect(),
                n_source: n,
                ..Scene::default()
            };
            for camera in orbit(&scene, 2, SIZE).into_iter().chain(choose_views(&scene, 1, SIZE)) {
                let covered = alpha(&scene, &camera).iter().sum::<f32>() / SIZE.element_product() as f32;
                assert!(covered > 0.05, "{n} of size {size}: {covered}");
            }
        }
    }
}
