//! The equations by integration, and scenes of which it is known what must be split.

use glam::Quat;

use crate::scene::Features;

use super::*;

/// A wall of opaque Gaussians of 0.02 across, and one before it that is 0.3 wide and turned, and one behind it
/// that is as large. From everywhere some of them are hidden.
fn scene() -> Scene {
    let mut scene = Scene { up: Some(Vec3::Y), ..Scene::default() };
    let mut add = |mean: Vec3, rotation: Quat, scales: Vec3, opacity: f32| {
        scene.means.push(mean);
        scene.rotations.push(rotation);
        scene.scales.push(scales);
        scene.opacities.push(opacity);
    };
    for i in 0..60 * 60 {
        let (x, y) = ((i % 60) as f32 / 30.0 - 1.0, (i / 60) as f32 / 30.0 - 1.0);
        add(Vec3::new(x, y, 0.0), Quat::IDENTITY, Vec3::new(0.02, 0.02, 0.001), 0.95);
    }
    add(Vec3::new(0.1, 0.2, 0.3), Quat::from_rotation_z(0.5), Vec3::new(0.3, 0.02, 0.01), 0.8);
    // Fainter than any pixel shows.
    add(Vec3::new(0.5, 0.0, 0.3), Quat::IDENTITY, Vec3::splat(0.3), 0.001);
    let n = scene.len();
    // Not the indices themselves, and with gaps.
    scene.order = (0..n as u32).map(|i| 3 * i + 1).collect();
    scene.n_source = 3 * n;
    scene.set_colors(&(0..n).map(|i| [(i % 60) as f32 / 60.0, 0.5, i as f32 / n as f32]).collect::<Vec<_>>());
    scene.features = Some(Features {
        values: (0..n).map(|i| i as f32).collect(),
        n_latent: 1,
        basis: vec![1.0; 2],
        offset: vec![0.0; 2],
        extra: Vec::new(),
        n_extra: 0,
        encoder: None,
    });
    scene
}

/// Mass, mean, both variances and the covariance of what `alpha` draws, by a sum over a grid out to 8
/// deviations.
fn moments(alpha: impl Fn(f64, f64) -> f64) -> [f64; 5] {
    let steps = || (-80..=80).map(|i| f64::from(i) / 10.0);
    let mut sums = [0.0; 5];
    for (x, y) in steps().flat_map(|x| steps().map(move |y| (x, y))) {
        for (sum, power) in sums.iter_mut().zip([1.0, x, x * x, y * y, x * y]) {
            *sum += 0.01 * power * alpha(x, y);
        }
    }
    sums
}

#[test]
fn halves_keep_the_moments_of_the_drawn_alpha() {
    let opacities = [0.004, 0.1, 0.5, 0.9, 1.0];
    for (o, d) in [0.5, 0.7].iter().flat_map(|&d| opacities.map(|o| (o, d))) {
        let Halves { along, across, opacity } = Halves::of(o, d);
        let [p, q, opacity] = [along, across, opacity].map(f64::from);
        assert!((0.0..=1.0).contains(&opacity), "opacity {opacity} of half of {o}");
        let part = |x: f64, y: f64| opacity * (-0.5 * ((x / p).powi(2) + (y / q).powi(2))).exp();
        let whole = moments(|x, y| o * (-0.5 * (x * x + y * y)).exp());
        let halves = moments(|x, y| 1.0 - (1.0 - part(x - d, y)) * (1.0 - part(x + d, y)));
        for (found, expected) in halves.iter().zip(whole) {
            assert!(
                (found - expected).abs() < 1e-5 * whole[0],
                "of {o} at {d}: {halves:?}, expected {whole:?}"
            );
        }
    }
}

#[test]
fn only_what_looks_large_is_split_and_its_parts_know_their_source() {
    let original = scene();
    let (large, faint) = (original.len() - 2, original.len() - 1);
    let mut scene = original.clone();
    // The wall's Gaussians are 0.02 of 2 units that fill at least half of a view, or less of one through a long
    // lens: 0.02 x 512 / 0.6 = 17 pixels at most.
    let n_added =
        split(&mut scene, SplitOptions { largest: 20.0, fidelity: 30.0, ..SplitOptions::default() });
    scene.validate().unwrap();
    assert_eq!(scene.len(), original.len() + n_added);
    let parts = |i: usize| -> Vec<usize> {
        (0..scene.len()).filter(|&part| scene.order[part] == original.order[i]).collect()
    };
    let of_large = parts(large);
    assert!(of_large.len() >= 8, "{} parts", of_large.len());
    assert_eq!(parts(faint).len(), 1);
    assert!(n_added < of_large.len() + 10, "{n_added} added, {} of the large one", of_large.len());
    let features = &scene.features.as_ref().unwrap().values;
    let middle: Vec3 = of_large.iter().map(|&i| scene.means[i]).sum::<Vec3>() / of_large.len() as f32;
    assert!(middle.distance(original.means[large]) < 0.02, "{middle}");
    for i in of_large {
        assert_eq!(features[i], large as f32);
        assert_eq!(scene.base_colors()[i], original.base_colors()[large]);
        assert!(scene.scales[i].x < 0.16 && scene.scales[i].y > 0.015, "{}", scene.scales[i]);
    }
}

#[test]
fn the_picture_stays() {
    let original = scene();
    let mut split_scene = original.clone();
    split(&mut split_scene, SplitOptions { largest: 20.0, ..SplitOptions::default() });
    let camera = Camera::look_at(Vec3::new(0.4, 0.3, 3.0), Vec3::ZERO, Vec3::Y, 0.8, UVec2::splat(128));
    let change = picture_change(&original, &split_scene, &camera);
    assert!(change > 0.0 && change < 1e-4, "{} dB", -10.0 * change.log10());
    // What cannot be kept is not split.
    let mut kept = original.clone();
    assert_eq!(
        split(&mut kept, SplitOptions { largest: 20.0, fidelity: 200.0, ..SplitOptions::default() }),
        0
    );
    assert_eq!(kept.len(), original.len());
}

/// Splitting a bright Gaussian changes the picture, and splitting the gray wall before the gray background does
/// not.
#[test]
fn one_that_must_not_change_does_not_keep_the_others_whole() {
    let mut scene = scene();
    let large = scene.len() - 2;
    scene.set_colors(&(0..scene.len()).map(|i| [if i == large { 1.0 } else { 0.5 }; 3]).collect::<Vec<_>>());
    let (before, source) = (scene.len(), scene.order[large]);
    let n_added = split(&mut scene, SplitOptions { largest: 0.1, fidelity: 60.0, ..SplitOptions::default() });
    assert!(n_added > before / 4, "{n_added} of {before}");
    assert_eq!(scene.order.iter().filter(|&&order| order == source).count(), 1);
}

#[test]
fn the_factor_bounds_the_count_and_small_scenes_are_fine() {
    for factor in [0.0, 1.0, 1.25, f64::NAN] {
        let mut scene = scene();
        let before = scene.len();
        split(&mut scene, SplitOptions { factor, largest: 0.1, fidelity: 0.0 });
        let most = if factor > 1.0 { before * 5 / 4 } else { before };
        assert_eq!(scene.len(), most, "factor {factor}");
    }
    let mut one = scene().subset(&[3600]);
    assert_eq!(
        split(&mut one, SplitOptions { factor: f64::INFINITY, fidelity: 0.0, ..SplitOptions::default() }),
        15
    );
    assert_eq!(split(&mut Scene::default(), SplitOptions::default()), 0);
}
