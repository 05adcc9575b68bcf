//! Boxes of known scenes, with and without surroundings.

use super::*;
use crate::{frame::Frame, random::Random};

fn scene(means: impl Iterator<Item = Vec3>) -> Scene {
    Scene { means: means.collect(), ..Scene::default() }
}

#[test]
fn a_share_on_either_side_does_not_count() {
    // x = 0, 1, ..., 99; y falls while x grows; z is the same for all.
    let hundred = scene((0..100).map(|i| Vec3::new(i as f32, -2.0 * i as f32, 7.0)));
    let expected = [Vec3::new(3.0, -192.0, 7.0), Vec3::new(96.0, -6.0, 7.0)];
    assert_eq!(hundred.bulk(0.03), Some(expected));
    let all = [Vec3::new(0.0, -198.0, 7.0), Vec3::new(99.0, 0.0, 7.0)];
    assert_eq!(hundred.bulk(0.0), Some(all));
    assert_eq!(hundred.bulk(0.009), Some(all), "less than one Gaussian");
}

#[test]
fn strays_change_nothing() {
    let strays = [Vec3::splat(1e6), Vec3::new(-1e9, 5.0, f32::MAX)];
    let scene = scene((0..198).map(|i| Vec3::splat(i as f32)).chain(strays));
    // Two of 200 lie on either side: along x a stray and a Gaussian, along z both strays behind.
    let [min, max] = scene.bulk(0.01).unwrap();
    assert_eq!((min.x, max.x), (1.0, 196.0));
    assert_eq!((min.z, max.z), (2.0, 197.0));
}

#[test]
fn a_large_scene_is_measured_by_a_sample() {
    // x = 0, 1, ..., 49,999, in the order of a step of 7,919, which is prime.
    let n = 50_000_u32;
    let large = scene((0..n).map(|i| Vec3::splat((i * 7919 % n) as f32)));
    let [min, max] = large.bulk(0.02).unwrap();
    assert!((min.x - 1000.0).abs() < 50.0 && (max.x - 48_999.0).abs() < 50.0, "{min} {max}");
}

#[test]
fn few_gaussians_are_their_own_bulk() {
    assert_eq!(Scene::default().bulk(0.03), None);
    assert_eq!(scene([Vec3::X].into_iter()).bulk(0.03), Some([Vec3::X; 2]));
    assert_eq!(scene([Vec3::X, Vec3::ZERO].into_iter()).bulk(0.03), Some([Vec3::ZERO, Vec3::X]));
}

#[test]
fn mass_decides_and_not_the_number() {
    let means = [0.0, 1.0, 2.0, 3.0].map(Vec3::splat);
    let of = |masses: [f32; 4]| bulk_of(&means, &masses, 0.25).map(|[min, max]| [min.x, max.x]);
    // A quarter of the mass is 2.
    assert_eq!(of([3.0, 1.0, 1.0, 3.0]), Some([0.0, 3.0]));
    assert_eq!(of([1.0, 1.0, 5.0, 1.0]), Some([2.0, 2.0]));
    assert_eq!(of([0.0; 4]), Some([0.0, 3.0]), "without mass, the whole box");
}

/// Points of a sphere of radius 1 about `center`.
fn sphere(n: usize, center: Vec3, random: &mut Random) -> Vec<Vec3> {
    let point = |random: &mut Random| Vec3::new(random.normal(), random.normal(), random.normal());
    (0..n).map(|_| center + point(random).normalize_or(Vec3::X)).collect()
}

/// The box without regard to surroundings.
fn plain(scene: &Scene, outside: f64) -> Option<[Vec3; 2]> {
    bulk_of(&scene.means, &vec![1.0; scene.len()], outside)
}

#[test]
fn surroundings_are_left_out() {
    let mut random = Random::new(1);
    let thing = sphere(2000, Vec3::Y, &mut random);
    for share in [0.05, 0.1, 0.3, 0.5, 0.7] {
        // Four fifths of the distances are from 20 to 100 times the size.
        let n = (share / (1.0 - share) * 2000.0) as usize;
        let far = sphere(n, Vec3::ZERO, &mut random).into_iter();
        let far: Vec<Vec3> = far.map(|at| 100.0 * random.uniform().max(0.1) * at).collect();
        let scene = scene(thing.iter().copied().chain(far));
        for outside in [0.01, 0.03] {
            let [low, high] = scene.bulk(outside).unwrap();
            assert!(low.abs_diff_eq(Vec3::new(-1.0, 0.0, -1.0), 0.15), "{share}: {low}");
            assert!(high.abs_diff_eq(Vec3::new(1.0, 2.0, 1.0), 0.15), "{share}: {high}");
        }
    }
}

#[test]
fn scenes_without_surroundings_have_the_box_of_all() {
    let mut random = Random::new(2);
    let two: Vec<Vec3> = (sphere(1000, Vec3::ZERO, &mut random).into_iter())
        .chain(sphere(1000, 40.0 * Vec3::X, &mut random))
        .collect();
    let blob = || Vec3::new(random.normal(), random.normal(), random.normal());
    let blob: Vec<Vec3> = std::iter::repeat_with(blob).take(2000).collect();
    let wall = (0..2500).map(|i| Vec3::new((i % 50) as f32, (i / 50) as f32, 0.0));
    for (what, scene) in [
        ("two things", scene(two.into_iter())),
        ("a blob", scene(blob.into_iter())),
        ("a wall", scene(wall)),
        ("one point", scene((0..500).map(|_| Vec3::ONE))),
        ("a line", scene((0..500).map(|i| Vec3::X * i as f32))),
        ("three", scene([Vec3::ZERO, Vec3::X, 1e3 * Vec3::Y].into_iter())),
    ] {
        for outside in [0.01, 0.03] {
            assert_eq!(scene.bulk(outside), plain(&scene, outside), "{what}");
        }
    }
}

/// A tenth of the Gaussians in one point is no thing.
#[test]
fn doubled_gaussians_are_no_thing() {
    let mut random = Random::new(5);
    let points = sphere(1800, Vec3::ZERO, &mut random).into_iter().chain([Vec3::X; 200]);
    let scene = scene(points);
    assert_eq!(scene.bulk(0.03), plain(&scene, 0.03));
}

#[test]
fn neither_order_nor_unit_matters() {
    let mut random = Random::new(3);
    let mut means = sphere(30_000, Vec3::ZERO, &mut random);
    means.extend((0..3000).map(|_| 50.0 * Vec3::new(random.normal(), random.normal(), random.normal())));
    let plain = scene(means.iter().copied());
    let shuffled = scene(random.permutation(means.len()).into_iter().map(|i| means[i]));
    let bulk = plain.bulk(0.03).unwrap();
    assert!(radius(bulk) < 2.0, "{bulk:?}");
    assert_eq!(shuffled.bulk(0.03), Some(bulk));
    for factor in [1e-4, 1e4] {
        let [low, high] = scene(means.iter().map(|mean| factor * mean)).bulk(0.03).unwrap();
        // Another sample, since the hashes are others.
        let [low, high] = [low / factor, high / factor];
        assert!(low.abs_diff_eq(bulk[0], 0.05) && high.abs_diff_eq(bulk[1], 0.05), "{low} {high}");
    }
}

#[test]
fn a_frame_is_its_own_bulk() {
    let frame = Frame { center: Vec3::X, radius: 3.0_f32.sqrt() };
    let scene = Scene { frame: Some(frame), ..scene((0..100).map(|i| Vec3::splat(i as f32))) };
    let [low, high] = scene.bulk(0.03).unwrap();
    assert!(low.abs_diff_eq(Vec3::new(0.0, -1.0, -1.0), 1e-6), "{low}");
    assert!(high.abs_diff_eq(Vec3::new(2.0, 1.0, 1.0), 1e-6), "{high}");
}
