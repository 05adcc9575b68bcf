//! Scenes of rays from known spots, whose Gaussians grow with the distance, as training makes them.

use crate::random::Random;

use super::*;

/// Something that rays hit: the distance along the ray from an eye, or infinity.
type Hit = dyn Fn(Vec3, Vec3) -> f32;

/// The planes of a box on a floor, seen from within, up to this height: a room, or walls under an empty sky.
fn walls(half: Vec3, height: f32) -> impl Fn(Vec3, Vec3) -> f32 {
    move |eye, ray| {
        let mut nearest = f32::INFINITY;
        for axis in 0..3 {
            let side = match axis {
                1 if ray.y < 0.0 => 0.0,
                _ => half[axis].copysign(ray[axis]),
            };
            let t = (side - eye[axis]) / ray[axis];
            let y = eye.y + t * ray.y;
            if t > 0.0 && t.is_finite() && (-1e-3..=height).contains(&y) {
                nearest = nearest.min(t);
            }
        }
        nearest
    }
}

/// A ball.
fn ball(center: Vec3, radius: f32) -> impl Fn(Vec3, Vec3) -> f32 {
    move |eye, ray| {
        let along = (center - eye).dot(ray);
        let inside = along * along - (center - eye).length_squared() + radius * radius;
        if inside > 0.0 && along > 0.0 { along - inside.sqrt() } else { f32::INFINITY }
    }
}

/// Gaussians where rays from the eyes meet something, each about a fiftieth of the distance large.
fn of_rays(n: usize, eyes: &dyn Fn(&mut Random) -> (Vec3, Vec3), hits: &[&Hit]) -> Scene {
    let mut random = Random::new(7);
    let mut scene = Scene { up: Some(Vec3::Y), ..Scene::default() };
    while scene.len() < n {
        let (eye, ray) = eyes(&mut random);
        let t = hits.iter().map(|hit| hit(eye, ray)).fold(f32::INFINITY, f32::min);
        // A sky is empty.
        if t < 1e3 {
            scene.means.push(eye + t * (1.0 + 0.01 * random.normal()) * ray);
            scene.rotations.push(Quat::IDENTITY);
            scene.scales.push(Vec3::splat(0.02 * t * (0.2 * random.normal()).exp()));
            scene.opacities.push(0.9);
            scene.order.push(scene.order.len() as u32);
            scene.n_source += 1;
        }
    }
    scene
}

fn any_direction(random: &mut Random) -> Vec3 {
    Vec3::new(random.normal(), random.normal(), random.normal()).normalize_or(Vec3::X)
}

/// Pictures all around, from steps around `at`.
fn standing(at: Vec3) -> impl Fn(&mut Random) -> (Vec3, Vec3) {
    move |random| {
        let step = Vec3::new(random.normal(), 0.0, random.normal());
        (at + 0.3 * step, any_direction(random))
    }
}

#[track_caller]
fn check_within(what: &str, scene: &Scene, at: Vec3, within: f32) {
    for cameras in [choose_views(scene, 6, SIZE), orbit(scene, 4, SIZE)] {
        for camera in &cameras {
            let eye = camera.position();
            assert!(eye.distance(at) < within, "{what}: eye at {eye} instead of {at}");
            assert!(picture_up(camera).y > 0.8, "{what}: tilted");
            let alpha = render(scene, Colors::Captured, camera).alpha;
            assert!(alpha.iter().sum::<f32>() > 0.3 * alpha.len() as f32, "{what}: little to see");
        }
    }
    let framing = framing(scene).unwrap();
    assert_eq!(framing.n_left_out, 0, "{what}");
    let eye = framing.eye.unwrap();
    assert!(eye.at.distance(at) < within && eye.room > 0.0, "{what}: {eye:?} instead of {at}");
}

#[test]
fn captures_from_within_are_seen_from_there() {
    let at = Vec3::new(0.5, 1.6, -0.4);
    // A closed room shows the same from outside, and a place under an empty sky does not surround its viewer.
    let room = of_rays(4000, &standing(at), &[&walls(Vec3::new(4.0, 2.6, 3.0), 2.61)]);
    check_within("a room", &room, at, 1.0);
    let courtyard = of_rays(6000, &standing(at), &[&walls(Vec3::new(12.0, 1e9, 15.0), 8.0)]);
    check_within("a courtyard", &courtyard, at, 2.0);
    // The floor near the eye is so dense that it would be framed.
    let square = of_rays(6000, &standing(at), &[&walls(Vec3::new(50.0, 1e9, 70.0), 12.0)]);
    check_within("a square", &square, at, 2.0);
    let small = scaled(&square, 1e-3);
    check_within("a square in kilometers", &small, 1e-3 * at, 2e-3);
    let shuffled: Vec<u32> = (0..square.len()).map(|i| (i * 7919 % square.len()) as u32).collect();
    assert_eq!(choose_views(&square.subset(&shuffled), 6, SIZE), choose_views(&square, 6, SIZE));
}

/// Pictures from all around a thing, which see what is behind it as well.
#[test]
fn a_thing_in_a_place_is_seen_from_outside() {
    let middle = Vec3::new(0.0, 1.0, 0.0);
    let circling = |random: &mut Random| {
        let (sin, cos) = (std::f32::consts::TAU * random.uniform()).sin_cos();
        let eye = Vec3::new(3.0 * cos, 1.6, 3.0 * sin);
        (eye, ((middle - eye).normalize() + 0.3 * any_direction(random)).normalize())
    };
    let (around, thing) = (walls(Vec3::new(25.0, 1e9, 30.0), 8.0), ball(middle, 0.8));
    for (what, hits) in [("outdoors", &[&around as &Hit, &thing][..]), ("alone", &[&thing as &Hit][..])] {
        let scene = of_rays(6000, &circling, hits);
        assert_eq!(surveyed(&scene).eye, None, "{what}");
        assert_eq!(framing(&scene).unwrap().eye, None, "{what}");
        for camera in orbit(&scene, 4, SIZE) {
            assert!(camera.position().distance(middle) > 1.5, "{what}: eye at {}", camera.position());
            let view = camera.view_from_world.transform_point3(middle);
            let off = (camera.focal * view.truncate() / view.z).abs();
            assert!(off.max_element() < 8.0, "{what}: off the middle by {off}");
        }
    }
    for scene in [box_on_a_floor(), room()] {
        assert_eq!(surveyed(&scene).eye, None);
    }
}
