use glam::{Affine3A, Quat, UVec2, Vec2};

use super::*;
use crate::{
    Camera,
    random::Random,
    splat::{Colors, render},
};

/// `n` flat Gaussians on a unit sphere, in stripes. Opacities are below 1 and differ.
fn sphere(n: usize, opacity: f32) -> Scene {
    let mut random = Random::new(7);
    let mut scene = Scene { n_source: n, order: (0..n as u32).collect(), ..Scene::default() };
    let mut rgb = Vec::new();
    for _ in 0..n {
        let mean = Vec3::new(random.normal(), random.normal(), random.normal()).normalize();
        scene.means.push(mean);
        scene.rotations.push(Quat::from_rotation_arc(Vec3::Z, mean));
        // The sphere has an area of 4 pi: disks of this radius cover it.
        let size = (1.0 + random.uniform()) * (4.0 / n as f32).sqrt();
        scene.scales.push(size * Vec3::new(1.0, 0.7, 0.05));
        scene.opacities.push(opacity * (0.5 + 0.5 * random.uniform()));
        rgb.push([0.5 + 0.4 * (6.0 * mean.x).sin(), 0.4, 0.5 + 0.3 * mean.y]);
    }
    scene.set_colors(&rgb);
    scene
}

fn merged(scene: &Scene, n: usize) -> Scene {
    let merged = merge(scene, n, &Work::default()).unwrap();
    merged.validate().unwrap();
    merged
}

/// As if all were seen as they are alone.
fn merged_by_depth(scene: &Scene, n: usize) -> Scene {
    let weights: Vec<f64> = (0..scene.len()).map(|i| depth(scene, i)).collect();
    let merged = merge_by(scene, &weights, n, &Work::default()).unwrap();
    merged.validate().unwrap();
    merged
}

/// Depth, mean and second moments about 0 of all Gaussians, by the definition.
fn moments(scene: &Scene) -> (f64, DVec3, DMat3) {
    let mut sums = (0.0, DVec3::ZERO, DMat3::ZERO);
    for i in 0..scene.len() {
        let s = scene.scales[i].as_dvec3();
        let area = ((s.x * s.y).powi(2) + (s.y * s.z).powi(2) + (s.z * s.x).powi(2)) / 3.0;
        let (w, m) = (opacity::depth(f64::from(scene.opacities[i])) * area.sqrt(), scene.means[i].as_dvec3());
        sums.0 += w;
        sums.1 += w * m;
        sums.2 += w * (covariance(scene, i) + outer(m));
    }
    (sums.0, sums.1 / sums.0, sums.2 * (1.0 / sums.0))
}

#[test]
fn moments_of_the_mixture_are_kept() {
    // So faint that no opacity ends at 1.
    let scene = sphere(1000, 0.02);
    let (depth, mean, second) = moments(&scene);
    for n in [500, 100, 7, 1] {
        let level = merged_by_depth(&scene, n);
        assert_eq!(level.len(), n);
        let found = moments(&level);
        // The last ones are as wide as the sphere, so that they keep the depth even at a low opacity.
        assert!((found.0 / depth - 1.0).abs() < 1e-5, "{n}: {} and {depth}", found.0);
        assert!((found.1 - mean).length() < 1e-5, "{n}");
        assert!(found.2.abs_diff_eq(second, 1e-5), "{n}: {} and {second}", found.2);
    }
}

#[test]
fn two_balls_by_hand() {
    let mut scene = Scene {
        means: vec![Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0)],
        rotations: vec![Quat::IDENTITY; 2],
        scales: vec![Vec3::ONE, Vec3::ONE],
        opacities: vec![0.6, 0.2],
        order: vec![0, 1],
        n_source: 2,
        mask: Some(Mask::new(2)),
        ..Scene::default()
    };
    scene.set_colors(&[[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]);
    scene.mask.as_mut().unwrap().weights = vec![[200, 0, 0, 0], [0, 0, 0, 8]];
    scene.features = Some(Features {
        values: vec![4.0, 0.0, 0.0, 8.0],
        n_latent: 2,
        basis: vec![0.0; 2],
        offset: vec![0.0],
        extra: vec![1.0, 5.0],
        n_extra: 1,
        encoder: None,
    });
    let one = merge_by(&scene, &[3.0, 1.0], 1, &Work::default()).unwrap();
    one.validate().unwrap();
    assert!((one.means[0] - Vec3::X).length() < 1e-6);
    // Along x, 1 + 3 / 16 of 4^2.
    assert!(covariance(&one, 0).abs_diff_eq(DMat3::from_diagonal(DVec3::new(4.0, 1.0, 1.0)), 1e-5));
    // Areas are 1, and A^2 is (4 + 1 + 4) / 3 afterwards. Li2(0.6) = 0.72758631, Li2(0.2) = 0.21100377.
    let found = opacity::depth(f64::from(one.opacities[0]));
    assert!((found - (0.727_586_31 + 0.211_003_77) / 3_f64.sqrt()).abs() < 1e-6, "{found}");
    let color = Vec3::from(one.base_colors()[0]);
    assert!((color - Vec3::new(0.75, 0.25, 0.5)).length() < 1e-6, "{color}");
    let features = one.features.unwrap();
    assert_eq!((features.values, features.extra), (vec![3.0, 2.0], vec![2.0]));
    assert_eq!(one.mask.unwrap().weights, [[150, 0, 0, 2]]);
    assert_eq!((one.order, one.n_source), (vec![0], 1));
}

/// The ratio of the peak to the difference of two pictures, in dB.
fn psnr(scene: &Scene, other: &Scene) -> f64 {
    let camera = Camera {
        view_from_world: Affine3A::from_translation(Vec3::new(0.0, 0.0, 4.0)),
        focal: Vec2::splat(64.0),
        center: Vec2::splat(24.0),
        size: UVec2::splat(48),
        near: 0.2,
    };
    let [a, b] = [scene, other].map(|scene| render(scene, Colors::Captured, &camera).color);
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    let sum: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (sum / a.as_flattened().len() as f64).log10()
}

#[test]
fn a_quarter_looks_like_all_from_afar() {
    let scene = sphere(8000, 0.9);
    let level = merged(&scene, 2000);
    let every_fourth = scene.subset(&(0..8000).step_by(4).collect::<Vec<_>>());
    let (kept, dropped) = (psnr(&scene, &level), psnr(&scene, &every_fourth));
    assert!(kept > 30.0 && kept > dropped + 6.0, "{kept} dB merged, {dropped} dB left out");
}

/// Dark Gaussians under an opaque bright surface, near enough to be merged with it.
#[test]
fn what_is_within_gives_the_outside_no_color() {
    let mut scene = sphere(8000, 1.0);
    let mut rgb = vec![[0.9, 0.8, 0.7]; 8000];
    for i in (0..8000).step_by(2) {
        scene.means[i] *= 0.97;
        rgb[i] = [0.0; 3];
    }
    scene.opacities.fill(0.95);
    scene.set_colors(&rgb);
    let all: Vec<f64> = (0..8000).map(|i| depth(&scene, i)).collect();
    let [seen, depth] = [merged(&scene, 2000), merge_by(&scene, &all, 2000, &Work::default()).unwrap()];
    let [seen, depth] = [seen, depth].map(|level| psnr(&scene, &level));
    assert!(seen > depth + 3.0, "{seen} dB, {depth} dB by depth alone");
}

#[test]
fn what_stays_alone_stays_as_it_is() {
    let mut scene = sphere(64, 0.5);
    // Far from all others, and large: no pair with it is cheap.
    scene.means[9] = Vec3::splat(50.0);
    scene.scales[9] = Vec3::new(3.0, 2.0, 1.0);
    let level = merged(&scene, 16);
    let at = level.means.iter().position(|&mean| mean == Vec3::splat(50.0)).unwrap();
    assert_eq!((level.scales[at], level.rotations[at]), (scene.scales[9], scene.rotations[9]));
    let all = merged(&scene, 1000);
    assert_eq!((all.means, all.scales, all.opacities), (scene.means, scene.scales, scene.opacities));
}

#[test]
fn degenerate_gaussians_become_some_gaussian() {
    let mut scene = sphere(200, 0.9);
    for i in 0..200 {
        match i % 5 {
            0 => scene.opacities[i] = 0.0,
            1 => scene.scales[i] = Vec3::ZERO,
            2 => scene.scales[i] = Vec3::new(0.0, 0.1, 0.0),
            3 => scene.means[i] = scene.means[3],
            _ => scene.scales[i] *= 1e18,
        }
    }
    for n in [0, 1, 3, 50, 199] {
        let level = merged(&scene, n);
        assert_eq!(level.len(), n.max(1));
        let finite = |i: usize| level.means[i].is_finite() && level.scales[i].is_finite();
        assert!((0..level.len()).all(|i| finite(i) && level.rotations[i].is_normalized()), "{n}");
        assert!(level.opacities.iter().all(|opacity| (0.0..=1.0).contains(opacity)), "{n}");
    }
    // Readers let no such number in, but nothing may panic.
    scene.means[0] = Vec3::NAN;
    scene.scales[1] = Vec3::INFINITY;
    assert_eq!(merged(&scene, 10).len(), 10);
    assert_eq!(merged(&Scene::default(), 10).len(), 0);
}

#[test]
fn distances_that_fall_along_the_curve_take_few_rounds() {
    // Each is nearer to the next than to the one before, so all choose the next one.
    let n = 20_000;
    let scene = Scene {
        means: (0..n).map(|i| Vec3::new(1.0 - (1.0 - i as f32 / n as f32).powi(2), 0.0, 0.0)).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::splat(0.1); n],
        opacities: vec![0.5; n],
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    let groups: Vec<Group> = (0..n)
        .map(|i| Group {
            mean: scene.means[i].as_dvec3(),
            covariance: covariance(&scene, i),
            weight: light(&scene, i),
            depth: depth(&scene, i),
            color: Vec3::ZERO,
            opacity: 0.5,
            is_single: true,
        })
        .collect();
    let (next, _) = round(&groups, 1, 0);
    assert!(next.len() <= n - n / LEAST_PAIRED, "{}", next.len());
}

#[test]
fn any_number_of_threads_gives_the_same_level() {
    let scene = sphere(3000, 0.9);
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let level = pool.install(|| merged(&scene, 700));
        (level.means, level.scales, level.opacities, level.sh.unwrap().coefficients)
    };
    assert_eq!(of(1), of(3));
    let work = Work::default();
    work.cancel();
    assert!(merge(&scene, 10, &work).is_err());
}
