//! Things with floaters, ground and backgrounds around them: the thing fills the picture as if it were alone.

use crate::{random::Random, splat::Colors};

use super::*;

/// The number of Gaussians that must be added so that they are this share of all.
fn n_of(scene: &Scene, share: f32) -> usize {
    (share / (1.0 - share) * scene.len() as f32).round() as usize
}

/// A cube of 1,014 Gaussians, 1 wide.
fn cube() -> Scene {
    let mut scene = Scene { up: Some(Vec3::Y), ..Scene::default() };
    add_box(&mut scene, Vec3::splat(-0.5), Vec3::splat(0.5), 13);
    scene
}

/// A cube on a floor of three times its width, as dense as the cube.
fn cube_on_a_floor() -> Scene {
    let mut scene = cube();
    add_rectangle(&mut scene, Vec3::new(-1.5, -0.5, -1.5), 3.0 * Vec3::X, 3.0 * Vec3::Z, 39);
    scene
}

/// Floaters at 10 to 100 times the size, each 20 times as large as a Gaussian of the cube.
fn with_floaters(mut scene: Scene, share: f32) -> Scene {
    let mut random = Random::new(3);
    for _ in 0..n_of(&scene, share) {
        let mean = 10.0_f32.powf(1.0 + random.uniform()) * direction(&mut random);
        add_ball(&mut scene, mean, 0.5);
    }
    scene
}

/// A dome at 10 to 60 times the size.
fn under_a_dome(mut scene: Scene, share: f32) -> Scene {
    let mut random = Random::new(4);
    for _ in 0..n_of(&scene, share) {
        let distance = 10.0 * 6.0_f32.powf(random.uniform());
        let mean = distance * direction(&mut random);
        add_ball(&mut scene, mean.with_y(mean.y.abs()), 0.05 * distance);
    }
    scene
}

/// The mean share of the pictures that the first `n` Gaussians fill.
fn filled(scene: &Scene, n: usize, cameras: &[Camera]) -> f32 {
    let colors: Vec<[f32; 3]> = (0..scene.len()).map(|i| [f32::from(u8::from(i < n)); 3]).collect();
    let filled = |camera: &Camera| {
        let picture = render(scene, Colors::Rgb(&colors), camera);
        picture.color.iter().map(|color| color[0]).sum::<f32>() / picture.color.len() as f32
    };
    cameras.iter().map(filled).sum::<f32>() / cameras.len() as f32
}

#[test]
fn surroundings_do_not_shrink_the_thing() {
    let (alone, on_a_floor) = (cube(), cube_on_a_floor());
    let n = alone.len();
    for (what, plain, scene) in [
        ("1 % floaters", &alone, with_floaters(alone.clone(), 0.01)),
        ("3 % floaters", &alone, with_floaters(alone.clone(), 0.03)),
        ("10 % floaters", &alone, with_floaters(alone.clone(), 0.1)),
        ("a dome of 5 %", &on_a_floor, under_a_dome(on_a_floor.clone(), 0.05)),
        ("a dome of 20 %", &on_a_floor, under_a_dome(on_a_floor.clone(), 0.2)),
        ("a dome of 50 %", &on_a_floor, under_a_dome(on_a_floor.clone(), 0.5)),
    ] {
        let [expected, found] = [plain, &scene].map(|scene| filled(scene, n, &orbit(scene, 3, SIZE)));
        assert!(expected > 0.05 && found > 0.5 * expected, "{what}: {found} instead of {expected}");
        // All floaters are left out, whether the thing's own share of the mass is enough or not.
        let framing = framing(&scene).unwrap();
        assert!(framing.frame.radius < 3.0 && framing.frame.center.length() < 0.5, "{what}: {framing:?}");
    }
}

/// Also the closer looks, and in any order of the Gaussians.
#[test]
fn views_of_a_thing_with_surroundings_show_it() {
    let plain = cube_on_a_floor();
    let n = cube().len();
    let scene = under_a_dome(plain.clone(), 0.3);
    let cameras = choose_views(&scene, 6, SIZE);
    let expected = filled(&plain, n, &choose_views(&plain, 6, SIZE));
    let found = filled(&scene, n, &cameras);
    assert!(found > 0.5 * expected, "{found} instead of {expected}");
    let shuffled: Vec<u32> = (0..scene.len()).map(|i| (i * 7919 % scene.len()) as u32).collect();
    assert_eq!(choose_views(&scene.subset(&shuffled), 6, SIZE), cameras);
    // The count has all that is far, and next to nothing of the thing.
    let (n_left_out, n_far) = (framing(&scene).unwrap().n_left_out, scene.len() - plain.len());
    assert!((n_far..n_far + 40).contains(&n_left_out), "{n_left_out} of {n_far}");
}

#[test]
fn scenes_without_surroundings_are_framed_whole() {
    for scene in [cube(), cube_on_a_floor(), box_on_a_floor(), room()] {
        let survey = surveyed(&scene);
        assert_eq!(survey.framed, Framed::All);
        assert_eq!(framing(&scene).unwrap().n_left_out, 0);
    }
}

#[test]
fn a_scene_can_tell_what_to_frame() {
    let frame = Frame { center: Vec3::new(0.5, 0.5, 0.5), radius: 0.25 };
    let scene = Scene { frame: Some(frame), ..with_floaters(cube(), 0.1) };
    let cameras = orbit(&scene, 4, SIZE);
    for camera in &cameras {
        // The ball touches the sides of a lens of 0.42 radians.
        let distance = camera.position().distance(frame.center);
        assert!((distance / (0.25 / 0.42_f32.sin()) - 1.0).abs() < 1e-4, "{distance}");
        assert!((camera.focal.y / (16.0 / 0.42_f32.tan()) - 1.0).abs() < 1e-4, "{}", camera.focal);
    }
    let told = framing(&scene).unwrap();
    assert_eq!(told.frame, frame);
    let n_outside = scene.means.iter().filter(|mean| mean.distance(frame.center) > 0.25).count();
    assert_eq!(told.n_left_out, n_outside);
    // Views of nothing can be asked for.
    let nothing = Scene { frame: Some(Frame { center: Vec3::splat(1e3), radius: 1.0 }), ..scene };
    assert_eq!(orbit(&nothing, 2, SIZE).len(), 2);
    assert_eq!(choose_views(&nothing, 2, SIZE).len(), 2);
}

/// Sizes grow from the thing over the floor to the dome, as around the spot of a capture from within.
#[test]
fn a_small_thing_under_a_dome_is_seen_from_outside() {
    const RADIUS: f32 = 0.5;
    for (n, n_on_floor) in [(8000, 11_400), (3000, 11_400), (3000, 10_000)] {
        let mut random = Random::new(9);
        let mut thing = Scene { up: Some(Vec3::Y), ..Scene::default() };
        for _ in 0..n {
            let size = 0.02 * (0.2 * random.normal()).exp();
            add_ball(&mut thing, RADIUS * direction(&mut random), size);
        }
        for _ in 0..n_on_floor {
            let at = 6.0 * Vec3::new(2.0 * random.uniform() - 1.0, 0.0, 2.0 * random.uniform() - 1.0);
            add_ball(&mut thing, at.with_y(-RADIUS), 0.07 * (0.2 * random.normal()).exp());
        }
        let scene = under_a_dome(thing, 0.15);
        assert_eq!(framing(&scene).unwrap().eye, None, "{n}");
        for camera in orbit(&scene, 4, SIZE) {
            let distance = camera.position().length();
            assert!(distance > 2.0 * RADIUS, "{n}: eye at {}", camera.position());
            let view = camera.view_from_world.transform_point3(Vec3::ZERO);
            let off = (camera.focal * view.truncate() / view.z).abs().max_element();
            assert!(view.z > 0.0 && off < 0.25 * SIZE.x as f32, "{n}: off the middle by {off}");
        }
    }
}
