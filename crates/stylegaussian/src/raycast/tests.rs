//! Rays by hand, and against all Gaussians of random scenes.

use glam::Quat;

use super::*;
use crate::random::Random;

fn scene(gaussians: &[(Vec3, Quat, Vec3, f32)]) -> Scene {
    Scene {
        means: gaussians.iter().map(|g| g.0).collect(),
        rotations: gaussians.iter().map(|g| g.1).collect(),
        scales: gaussians.iter().map(|g| g.2).collect(),
        opacities: gaussians.iter().map(|g| g.3).collect(),
        order: (0..gaussians.len() as u32).collect(),
        n_source: gaussians.len(),
        ..Scene::default()
    }
}

fn direction(random: &mut Random) -> Vec3 {
    Vec3::from_array([(); 3].map(|()| 2.0 * random.uniform() - 1.0)).normalize_or(Vec3::X)
}

fn random_scene(n: usize, random: &mut Random) -> Scene {
    let gaussians: Vec<_> = (0..n)
        .map(|_| {
            let mean = 2.0 * direction(random) * random.uniform();
            let rotation = Quat::from_axis_angle(direction(random), 6.0 * random.uniform());
            let scales = Vec3::from_array([(); 3].map(|()| 0.3 * random.uniform().powi(2)));
            (mean, rotation, scales, random.uniform())
        })
        .collect();
    scene(&gaussians)
}

fn index(scene: &Scene) -> RayIndex {
    RayIndex::new(scene, &Work::default()).unwrap()
}

/// The twin: every Gaussian, one after the other.
fn brute_force(scene: &Scene, ray: Ray) -> Option<Hit> {
    let index = index(scene);
    let all = index.gaussians.iter().enumerate();
    let mut crossings: Vec<_> =
        all.filter_map(|(i, gaussian)| gaussian.crossing(ray, i as u32, gaussian.opacity)).collect();
    crossings.sort_by_key(|&crossing| Nearest(crossing));
    let mut blend = Blend::default();
    crossings.into_iter().any(|crossing| blend.add(crossing)).then(|| blend.hit(ray, &index))
}

#[test]
fn rays_hit_what_all_gaussians_give() {
    let mut random = Random::new(21);
    let mut counts = [0; 2];
    for n in [1, 7, 8, 9, 300, 5000] {
        let scene = random_scene(n, &mut random);
        let index = index(&scene);
        for _ in 0..40 {
            let origin = 3.0 * direction(&mut random);
            let aim = direction(&mut random) - origin;
            // Along an axis too, where boxes are met at their sides.
            let direction = if random.uniform() < 0.2 { Vec3::Y } else { aim * random.uniform() };
            let ray = Ray { origin, direction };
            let (found, expected) = (index.cast(ray), brute_force(&scene, ray));
            assert_eq!(found, expected, "{n} Gaussians, {ray:?}");
            counts[usize::from(found.is_some())] += 1;
        }
    }
    assert!(counts[0] > 20 && counts[1] > 20, "{counts:?}");
}

/// Two faint sheets before a dense one. 1 - 0.7^2 = 0.51, so the second one is hit, and the normal is that of
/// the sheets.
#[test]
fn half_of_the_light_decides() {
    let sheet =
        |z: f32, opacity: f32| (Vec3::new(0.0, 0.0, z), Quat::IDENTITY, Vec3::new(1.0, 1.0, 0.01), opacity);
    let sheets = scene(&[sheet(2.0, 0.95), sheet(0.0, 0.3), sheet(1.0, 0.3)]);
    let ray = Ray { origin: Vec3::new(0.0, 0.0, -1.0), direction: Vec3::Z };
    let hit = index(&sheets).cast(ray).unwrap();
    assert!((hit.distance - 2.0).abs() < 1e-5 && (hit.position.z - 1.0).abs() < 1e-5, "{hit:?}");
    assert!(hit.normal.abs_diff_eq(Vec3::NEG_Z, 1e-5), "{hit:?}");
    assert_eq!(hit.gaussian, 1, "0.3 before 0.7 times 0.3");
    // In units of the direction's length.
    let far = index(&sheets).cast(Ray { direction: Vec3::Z * 0.5, ..ray }).unwrap();
    assert!((far.distance - 4.0).abs() < 1e-5, "{far:?}");
    // From the other side, and away from it.
    let back = Ray { origin: Vec3::new(0.0, 0.0, 5.0), direction: Vec3::NEG_Z };
    assert_eq!(index(&sheets).cast(back).unwrap().gaussian, 0);
    assert_eq!(index(&sheets).cast(Ray { direction: Vec3::Z, ..back }), None);
}

/// A share of the opacity is the opacity.
#[test]
fn shares_are_opacities() {
    let mut random = Random::new(23);
    let scene = random_scene(500, &mut random);
    let shares: Vec<f32> = (0..scene.len()).map(|_| (1.5 * random.uniform() - 0.5).max(0.0)).collect();
    let mut faded = scene.clone();
    faded.opacities.iter_mut().zip(&shares).for_each(|(opacity, share)| *opacity *= share);
    let mut n_hits = 0;
    for _ in 0..100 {
        let origin = 3.0 * direction(&mut random);
        let ray = Ray { origin, direction: direction(&mut random) - origin };
        let found = index(&scene).cast_through(ray, |i| shares[i]);
        let expected = index(&faded).cast(ray);
        assert_eq!(found.map(|hit| hit.gaussian), expected.map(|hit| hit.gaussian));
        assert_eq!(found.map(|hit| hit.position), expected.map(|hit| hit.position));
        n_hits += usize::from(found.is_some());
    }
    assert!((10..90).contains(&n_hits), "{n_hits}");
}

#[test]
fn an_index_that_is_canceled_is_none() {
    let work = Work::default();
    work.cancel();
    let scene = random_scene(10, &mut Random::new(23));
    assert_eq!(RayIndex::new(&scene, &work).err(), Some(Canceled));
}

#[test]
fn rays_and_scenes_may_be_anything() {
    let mut random = Random::new(22);
    let mut odd = random_scene(20, &mut random);
    (odd.means[0].x, odd.scales[1].y, odd.opacities[2]) = (f32::NAN, f32::INFINITY, f32::NAN);
    (odd.rotations[3], odd.scales[4]) = (Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), Vec3::ZERO);
    let (odd, empty) = (index(&odd), index(&Scene::default()));
    for value in [0.0, 1.0, f32::MAX, f32::MIN_POSITIVE, f32::INFINITY, f32::NAN] {
        for direction in [Vec3::splat(value), Vec3::X * value, Vec3::new(1.0, value, 0.0)] {
            let ray = Ray { origin: Vec3::ZERO, direction };
            let _ = odd.cast(ray);
            let _ = odd.cast(Ray { origin: direction, direction: Vec3::X });
            assert_eq!(empty.cast(ray), None);
        }
    }
}
