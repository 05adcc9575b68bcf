//! Gradients against finite differences.

use stylegaussian::random::Random;

use super::{
    content, matching, range,
    shapes::{OVER, ShapeAim, contrast, of_picture},
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
fn content_and_range() {
    let reference = values(18, 2);
    check(&values(18, 1), |x, grad| content(x, &reference, CHANNELS, &CELLS, 1.0, grad));
    check(&values(18, 1), |x, grad| range(x, &CELLS, 1.0, grad));
}

#[test]
fn shapes_of_several_pixels() {
    // Two pixels in each of the first two of three shapes.
    let (recolored, aim) = (values(34 * 3, 7), ShapeAim::new(0.4, 0.3, 0.2));
    check(&values(34 * 3, 6), |x, grad| aim.loss([x, &recolored], 34, &[0, 3, 20, 31], 1.0, grad));
}

#[test]
fn detail_within_a_shape_is_free() {
    let gray = vec![0.5; 16 * 16 * 3];
    let pixels: Vec<u32> = (0..256).collect();
    let loss = |rgb: &[f32], grad: &mut [f32]| {
        // A tolerance of 0.1. Gray is the middle, and stays.
        ShapeAim::new(0.5, 0.2, 0.2).loss([rgb, &gray], 16, &pixels, 1.0, grad)
    };
    let checkered: Vec<f32> = (0..256).flat_map(|i| [((i + i / 16) % 2) as f32; 3]).collect();
    let mut grad = vec![0.0; gray.len()];
    assert_eq!(loss(&checkered, &mut grad), 0.0);
    assert!(grad.iter().all(|value| *value == 0.0));
    // Within the tolerance of brightness.
    assert_eq!(loss(&vec![0.55; gray.len()], &mut grad), 0.0);
    // 0.2 brighter is 0.1 beyond it.
    let found = loss(&vec![0.7; gray.len()], &mut grad);
    assert!((found - 0.01).abs() < 1e-6, "{found}");
    // Another hue as bright is not free.
    let found = loss(&[0.7, 0.4, 0.4].repeat(256), &mut grad);
    assert!((found - 0.02).abs() < 1e-6, "{found}");
    assert_eq!(ShapeAim::new(0.5, 0.2, 0.2).loss([&[], &[]], 0, &[], 1.0, &mut []), 0.0);
}

#[test]
fn shapes_have_the_contrast_of_the_paintings() {
    // Two shapes of a deviation of 0.1 around 0.4, and a painting's with one of 0.15.
    let (left, right): (Vec<f32>, Vec<f32>) = (vec![0.3; 16 * 3], vec![0.5; 16 * 3]);
    let recolored = [left, right].concat().repeat(16);
    let deviation = contrast([of_picture(&recolored, 32)].into_iter());
    assert!((deviation - 0.1).abs() < 1e-6, "{deviation}");
    let aim = ShapeAim::new(0.4, 0.15, deviation);
    let pixels: Vec<u32> = (0..512).collect();
    let loss = |rgb: &[f32]| aim.loss([rgb, &recolored], 32, &pixels, 1.0, &mut vec![0.0; rgb.len()]);
    let with_contrast =
        |factor: f32| -> Vec<f32> { recolored.iter().map(|v| 0.4 + factor * (v - 0.4)).collect() };
    assert!(loss(&with_contrast(1.5 * OVER)) < 1e-9);
    assert!(loss(&recolored) < loss(&with_contrast(0.5)));
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
    let keys = matching::normalized(&values(15, 5), CHANNELS);
    check(&values(18, 4), |x, grad| matching::matching(x, CHANNELS, &CELLS, &keys, 1.0, grad));
}

#[test]
fn matching_finds_the_nearest_direction() {
    let keys = matching::normalized(&[1.0, 0.0, 0.0, 0.0, 3.0, 4.0], 3);
    // Along the second key, and of another length: no distance. (4, 0, 3) has the cosine 0.8 with the first key and
    // 0.48 with the second.
    let distance = |row: &[f32]| matching::matching(row, 3, &[0], &keys, 1.0, &mut [0.0; 3]);
    assert!(distance(&[0.0, 6.0, 8.0]).abs() < 1e-5);
    assert!((distance(&[4.0, 0.0, 3.0]) - 0.2).abs() < 1e-5);
    // No feature at all has no direction, and no NaN.
    assert!((distance(&[0.0; 3]) - 1.0).abs() < 1e-5);
}
