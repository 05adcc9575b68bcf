//! Gradients against finite differences.

use stylegaussian::random::Random;

use super::{
    matching, range,
    shapes::{OVER, SLOPE_WEIGHT, ShapeAim, contrast, of_picture},
    statistics,
};

const CHANNELS: usize = 3;
const CELLS: [u32; 4] = [0, 2, 3, 5];

fn values(n: usize, seed: u64) -> Vec<f32> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.normal()).collect()
}

/// Compares the gradient that `loss(x, gradient)` adds with central differences of its value.
fn check(x: &[f32], loss: impl Fn(&[f32], &mut [f32]) -> f32) {
    let mut grad = vec![0.0; x.len()];
    loss(x, &mut grad);
    assert!(grad.iter().any(|value| value.abs() > 1e-3), "a gradient of nothing but zeros");
    let step = 1e-2;
    for i in 0..x.len() {
        let moved = |by: f32| {
            let mut x = x.to_vec();
            x[i] += by;
            loss(&x, &mut vec![0.0; grad.len()])
        };
        let expected = (moved(step) - moved(-step)) / (2.0 * step);
        assert!((grad[i] - expected).abs() < 2e-3, "[{i}]: {} for {expected}", grad[i]);
    }
}

#[test]
fn colors_beyond_the_range() {
    check(&values(18, 1), |x, grad| range(x, &CELLS, 1.0, grad));
}

#[test]
fn shapes_of_several_pixels() {
    // Two pixels in each of the first two of three shapes.
    let (recolored, aim) = (values(34 * 3, 7), ShapeAim::new(0.3, 0.2));
    check(&values(34 * 3, 6), |x, grad| aim.loss([x, &recolored], 34, &[0, 3, 20, 31], 1.0, grad));
}

#[test]
fn detail_within_a_shape_is_free() {
    let gray = vec![0.5; 16 * 16 * 3];
    let pixels: Vec<u32> = (0..256).collect();
    let aim = ShapeAim::new(0.2, 0.2);
    let loss = |rgb: &[f32], grad: &mut [f32]| aim.loss([rgb, &gray], 16, &pixels, 1.0, grad);
    let checkered: Vec<f32> = (0..256).flat_map(|i| [((i + i / 16) % 2) as f32; 3]).collect();
    let mut grad = vec![0.0; gray.len()];
    assert_eq!(loss(&checkered, &mut grad), 0.0);
    assert!(grad.iter().all(|value| *value == 0.0));
    // Within the tolerance of brightness.
    assert_eq!(loss(&vec![0.7; gray.len()], &mut grad), 0.0);
    // 0.35 brighter is 0.1 beyond it.
    let found = loss(&vec![0.85; gray.len()], &mut grad);
    assert!((found - 0.01).abs() < 1e-6, "{found}");
    // Another hue as bright is not free.
    let found = loss(&[0.7, 0.4, 0.4].repeat(256), &mut grad);
    assert!((found - 0.02).abs() < 1e-6, "{found}");
    assert_eq!(aim.loss([&[], &[]], 0, &[], 1.0, &mut []), 0.0);
}

#[test]
fn shapes_have_the_contrast_of_the_painting() {
    // Two by two shapes, dark ones left and bright ones right: a deviation of 0.1, as the painting's.
    let pixels: Vec<u32> = (0..1024).collect();
    let picture = |color: fn(bool, bool) -> f32| -> Vec<f32> {
        pixels.iter().flat_map(|pixel| [color(pixel % 32 >= 16, pixel / 32 >= 16); 3]).collect()
    };
    let recolored = picture(|right, _| if right { 0.5 } else { 0.3 });
    let deviation = contrast([of_picture(&recolored, 32)].into_iter());
    assert!((deviation - 0.1).abs() < 1e-6, "{deviation}");
    let aim = ShapeAim::new(0.1, deviation);
    let loss = |rgb: &[f32]| aim.loss([rgb, &recolored], 32, &pixels, 1.0, &mut vec![0.0; rgb.len()]);
    let missing = |slope: f32| SLOPE_WEIGHT * (0.1 * (OVER - slope)).powi(2);
    for (found, expected) in [
        (loss(&recolored), missing(1.0)),
        (loss(&picture(|_, _| 0.4)), missing(0.0)),
        (loss(&picture(|right, _| if right { 0.55 } else { 0.25 })), 0.0),
        // Light and dark across it is free.
        (loss(&picture(|right, low| if right { 0.55 } else { 0.25 } + if low { 0.1 } else { -0.1 })), 0.0),
    ] {
        assert!((found - expected).abs() < 1e-6, "{found} and {expected}");
    }
    // A cell that is cut off is none.
    assert_eq!(of_picture(&vec![0.5; 40 * 20 * 3], 40), [0.5; 2]);
    assert_eq!(of_picture(&[], 0), [0.0; 0]);
}

#[test]
fn statistics_of_the_crop_itself() {
    let target = statistics::Target { mean: vec![0.5, -0.2, 1.0], deviation: vec![0.3, 1.5, 0.8] };
    check(&values(18, 3), |x, grad| {
        let moments = statistics::Moments::of(x, CHANNELS, CELLS.iter().map(|&cell| cell as usize));
        statistics::statistics(x, &CELLS, &moments, &target, 1.0, grad)
    });
}

#[test]
fn matching_with_the_nearest() {
    let keys = matching::Keys::new(values(15, 5), CHANNELS);
    check(&values(18, 4), |x, grad| matching::matching(x, &CELLS, &keys, 1.0, grad));
}

/// More channels than directions that are compared, in which the keys have fewer.
#[test]
fn matching_in_fewer_directions_finds_the_nearest() {
    const WIDE: usize = 100;
    let (basis, weights) = (values(8 * WIDE, 8), values(40 * 8, 9));
    let key = |weights: &[f32], c: usize| {
        weights.iter().enumerate().map(|(i, weight)| weight * basis[i * WIDE + c]).sum::<f32>()
    };
    let rows: Vec<f32> = weights
        .chunks_exact(8)
        .flat_map(|weights| (0..WIDE).map(|c| key(weights, c)).collect::<Vec<_>>())
        .collect();
    let query = values(WIDE, 10);
    let cosine = |row: &[f32]| {
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        dot(row, &query) / (dot(row, row) * dot(&query, &query)).sqrt()
    };
    let nearest = rows.chunks_exact(WIDE).map(cosine).fold(f32::MIN, f32::max);
    let found = matching::matching(&query, &[0], &matching::Keys::new(rows, WIDE), 1.0, &mut [0.0; WIDE]);
    assert!((found - (1.0 - nearest)).abs() < 1e-5, "{found} for {}", 1.0 - nearest);
}

#[test]
fn matching_finds_the_nearest_direction() {
    let keys = matching::Keys::new(vec![1.0, 0.0, 0.0, 0.0, 3.0, 4.0], 3);
    // Along the second key, and of another length: no distance. (4, 0, 3) has the cosine 0.8 with the first key
    // and 0.48 with the second.
    let distance = |row: &[f32]| matching::matching(row, &[0], &keys, 1.0, &mut [0.0; 3]);
    assert!(distance(&[0.0, 6.0, 8.0]).abs() < 1e-5);
    assert!((distance(&[4.0, 0.0, 3.0]) - 0.2).abs() < 1e-5);
    // No feature at all has no direction, and no NaN.
    assert!((distance(&[0.0; 3]) - 1.0).abs() < 1e-5);
}
