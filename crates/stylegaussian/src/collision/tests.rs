//! Voxels by hand and on random scenes, and boxes that cover them.

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

fn random_vec(random: &mut Random) -> Vec3 {
    Vec3::from_array([(); 3].map(|()| 2.0 * random.uniform() - 1.0))
}

fn random_scene(n: usize, random: &mut Random) -> Scene {
    let gaussians: Vec<_> = (0..n)
        .map(|_| {
            let rotation =
                Quat::from_axis_angle(random_vec(random).normalize_or(Vec3::X), 6.0 * random.uniform());
            let scales = Vec3::from_array([(); 3].map(|()| 0.2 * random.uniform().powi(2)));
            (2.0 * random_vec(random), rotation, scales, random.uniform())
        })
        .collect();
    scene(&gaussians)
}

const SETTINGS: VoxelSettings = VoxelSettings { size: 0.13, bounds: None, least_group: 1 };

#[test]
fn solid_gaussians_are_in_boxes_and_empty_space_is_free() {
    let mut random = Random::new(31);
    for n in [1, 10, 200] {
        let scene = random_scene(n, &mut random);
        let voxels = Voxels::new(&scene, &SETTINGS).unwrap();
        let boxes = voxels.boxes();
        let slack = Vec3::splat(1e-4);
        for (mean, opacity) in
            scene.means.iter().zip(&scene.opacities).filter(|(_, opacity)| **opacity >= 0.5)
        {
            let is_in = |b: &CollisionBox| mean.cmpge(b.min - slack).all() && mean.cmple(b.max + slack).all();
            assert!(voxels.contains(*mean) && boxes.iter().any(is_in), "{mean} of opacity {opacity}");
        }
        // Farther from every Gaussian than it is drawn, by the diagonal of a voxel.
        let mut n_empty = 0;
        for _ in 0..2000 {
            let point = 2.2 * random_vec(&mut random);
            let is_far = (0..scene.len()).all(|i| {
                // 3.33 standard deviations: alpha of an opaque Gaussian falls to 1/255.
                let reach = 3.33 * scene.scales[i].max_element().max(0.1 * SETTINGS.size);
                scene.means[i].distance(point) > reach + SETTINGS.size * 3.0_f32.sqrt()
            });
            if is_far {
                n_empty += 1;
                assert!(!voxels.contains(point), "{point} is far from everything");
            }
        }
        assert!(n == 200 || n_empty > 500, "{n_empty} of {n}");
    }
}

/// Each voxel asks each Gaussian: without lists of layers, and without the box around a Gaussian.
#[test]
fn voxels_are_those_of_all_gaussians() {
    let scene = random_scene(100, &mut Random::new(32));
    let voxels = Voxels::new(&scene, &SETTINGS).unwrap();
    let footprints: Vec<_> = (0..scene.len()).filter_map(|i| Footprint::new(&scene, i, &voxels)).collect();
    let is_occupied = |index: usize| {
        let at = voxels.place(index);
        let light: f32 = footprints.iter().map(|footprint| 1.0 - footprint.alpha(at)).product();
        light <= OCCUPIED
    };
    let expected: Vec<_> = (0..voxels.occupied.len()).map(is_occupied).collect();
    let n_occupied = expected.iter().filter(|occupied| **occupied).count();
    assert!(n_occupied > 100 && n_occupied < expected.len() / 2, "{n_occupied} of {}", expected.len());
    assert!(voxels.occupied == expected, "other voxels are occupied");
}

/// No point of a voxel, sampled finely, has a higher alpha than the voxel but for rounding, however a Gaussian
/// is stretched and turned.
#[test]
fn no_point_of_a_voxel_has_a_higher_alpha() {
    const SAMPLES: usize = 9;
    let mut random = Random::new(36);
    let scene = random_scene(60, &mut random);
    let voxels = Voxels::new(&scene, &SETTINGS).unwrap();
    let (mut n_voxels, mut most_missed) = (0, 0.0_f32);
    for footprint in (0..scene.len()).filter_map(|i| Footprint::new(&scene, i, &voxels)) {
        for index in voxels.indices(footprint.begin, footprint.end) {
            let at = voxels.place(index);
            let sampled = (0..SAMPLES.pow(3)).map(|i| {
                let cell = [i % SAMPLES, i / SAMPLES % SAMPLES, i / SAMPLES.pow(2)].map(|i| i as f32);
                footprint.alpha_at(at.as_vec3() + Vec3::from_array(cell) / (SAMPLES - 1) as f32)
            });
            most_missed = most_missed.max(sampled.fold(0.0, f32::max) - footprint.alpha(at));
            n_voxels += 1;
        }
    }
    assert!(n_voxels > 1000 && most_missed < 1e-3, "{most_missed} in {n_voxels} voxels");
}

#[test]
fn boxes_cover_the_occupied_voxels_once() {
    let mut random = Random::new(33);
    for density in [0.0, 0.1, 0.6, 0.95, 1.0] {
        let counts = UVec3::new(9, 7, 5);
        let occupied: Vec<bool> = (0..9 * 7 * 5).map(|_| random.uniform() <= density).collect();
        let voxels = Voxels { origin: Vec3::ONE, size: 0.5, counts, occupied };
        let mut covered = vec![0; voxels.occupied.len()];
        let boxes = voxels.merged();
        for [begin, end] in &boxes {
            voxels.indices(*begin, *end).for_each(|i| covered[i] += 1);
        }
        let expected: Vec<_> = voxels.occupied.iter().map(|occupied| usize::from(*occupied)).collect();
        assert_eq!(covered, expected, "density {density}");
        if density == 1.0 {
            let whole = CollisionBox { min: Vec3::ONE, max: Vec3::new(5.5, 4.5, 3.5) };
            assert_eq!(voxels.boxes(), [whole]);
        }
    }
}

/// A floor of 5x5 voxels and one voxel above it: the floor is one box, and the floater goes if groups need two.
#[test]
fn floaters_are_removed() {
    let ball = |at: Vec3| (at, Quat::IDENTITY, Vec3::splat(1e-3), 0.9);
    let mut gaussians: Vec<_> =
        (0..25).map(|i| ball(Vec3::new((i % 5) as f32, 0.0, (i / 5) as f32))).collect();
    gaussians.push(ball(Vec3::new(2.0, 3.0, 2.0)));
    let bounds = Some([Vec3::splat(-0.5), Vec3::new(4.4, 4.4, 4.4)]);
    let settings = VoxelSettings { size: 1.0, bounds, least_group: 1 };
    let scene = scene(&gaussians);
    let floor = CollisionBox { min: Vec3::splat(-0.5), max: Vec3::new(4.5, 0.5, 4.5) };
    let floater = CollisionBox { min: Vec3::new(1.5, 2.5, 1.5), max: Vec3::new(2.5, 3.5, 2.5) };
    let mut boxes = Voxels::new(&scene, &settings).unwrap().boxes();
    boxes.sort_by(|a, b| a.min.y.total_cmp(&b.min.y));
    // Greedy boxes begin at the least z, where the floor is a strip that then grows along z.
    assert_eq!(boxes, [floor, floater]);
    let without = Voxels::new(&scene, &VoxelSettings { least_group: 2, ..settings }).unwrap();
    assert_eq!(without.boxes(), [floor]);
    assert!(without.contains(Vec3::ZERO) && !without.contains(Vec3::new(2.0, 3.0, 2.0)));
}

/// 1 - 0.7^2 = 0.51: two faint Gaussians are one solid thing, one is not.
#[test]
fn faint_gaussians_add_up() {
    let faint = (Vec3::splat(0.5), Quat::IDENTITY, Vec3::splat(1e-3), 0.3);
    let settings = VoxelSettings { size: 1.0, bounds: Some([Vec3::ZERO, Vec3::splat(0.9)]), least_group: 1 };
    let n_boxes = |n: usize| Voxels::new(&scene(&vec![faint; n]), &settings).unwrap().boxes().len();
    assert_eq!((n_boxes(1), n_boxes(2)), (0, 1));
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let scene = random_scene(300, &mut Random::new(34));
    let with = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| Voxels::new(&scene, &SETTINGS).unwrap())
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn bad_settings_and_scenes_are_errors_or_empty() {
    let scene = random_scene(20, &mut Random::new(35));
    for size in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(
            Voxels::new(&scene, &VoxelSettings { size, ..SETTINGS }),
            Err(CollisionError::Size(_))
        ));
    }
    let error = Voxels::new(&scene, &VoxelSettings { size: 1e-6, ..SETTINGS }).unwrap_err();
    assert!(error.to_string().contains("choose larger voxels"), "{error}");
    for corner in [Vec3::NAN, Vec3::INFINITY, Vec3::splat(-5.0)] {
        let bounds = Some([Vec3::ZERO, corner]);
        let found = Voxels::new(&scene, &VoxelSettings { bounds, ..SETTINGS });
        assert!(matches!(found, Err(CollisionError::Bounds(..))), "{corner}");
    }
    let mut odd = scene.clone();
    (odd.means[0].x, odd.scales[1].y, odd.opacities[2]) = (f32::NAN, f32::INFINITY, f32::NAN);
    (odd.rotations[3], odd.scales[4], odd.scales[5]) =
        (Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), Vec3::ZERO, Vec3::splat(1e30));
    assert!(Voxels::new(&odd, &SETTINGS).is_ok());
    assert!(Voxels::new(&Scene::default(), &SETTINGS).unwrap().boxes().is_empty());
}
