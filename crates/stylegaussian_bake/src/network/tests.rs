//! The networks against finite differences, and against the encoder.

use stylegaussian::{random::Random, work::Work};
use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{Encoder, Image, chain::Chain};

use super::{LossNetwork, Size, bank};

fn random_values(n: usize, scale: f32, random: &mut Random) -> Vec<f32> {
    (0..n).map(|_| scale * random.normal()).collect()
}

/// Gradients of random sums of some values, against finite differences.
fn check_gradients(chain: &Chain, size: Size, watched: &[usize]) {
    let (sizes, mut random) = (chain.sizes(size), Random::new(3));
    let rgb: Vec<f32> = (0..size.n_pixels() * 3).map(|_| random.uniform()).collect();
    let values = chain.forward(&sizes, &rgb);
    let directions: Vec<Vec<f32>> =
        watched.iter().map(|&value| random_values(values.rows(value).len(), 1.0, &mut random)).collect();
    let loss = |rgb: &[f32]| -> f64 {
        let values = chain.forward(&sizes, rgb);
        let dot = |(value, direction): (&usize, &Vec<f32>)| -> f64 {
            values.rows(*value).iter().zip(direction).map(|(a, b)| f64::from(a * b)).sum()
        };
        watched.iter().zip(&directions).map(dot).sum()
    };
    let mut grads = vec![None; chain.last() + 1];
    for (value, direction) in watched.iter().zip(&directions) {
        grads[*value] = Some(direction.clone());
    }
    let grad = chain.backward(&sizes, &values, grads).unwrap();
    // Small, so that few ReLUs and maxima switch in between; those that do may spoil a few.
    let step = 1e-3;
    let wrong = (0..rgb.len()).filter(|&i| {
        let moved = |by: f32| {
            let mut rgb = rgb.clone();
            rgb[i] += by;
            loss(&rgb)
        };
        let expected = (moved(step) - moved(-step)) / f64::from(2.0 * step);
        (expected - f64::from(grad[i])).abs() > 0.02 * (1.0 + expected.abs())
    });
    let wrong = wrong.count();
    assert!(wrong <= rgb.len() / 30, "{wrong} of {}", rgb.len());
}

#[test]
fn gradients_of_filters_match_finite_differences() {
    let chain = bank::filters_after(1);
    check_gradients(&chain, Size { width: 8, height: 6 }, &[chain.last()]);
}

#[test]
fn filters_see_both_signs() {
    let chain = bank::filters_after(0);
    let size = Size { width: 4, height: 4 };
    // Dark left, bright right.
    let rgb: Vec<f32> = (0..16).flat_map(|pixel| [if pixel % 4 < 2 { 0.0 } else { 1.0 }; 3]).collect();
    let values = chain.forward(&chain.sizes(size), &rgb);
    let (last, n) = (values.rows(chain.last()), chain.channels(chain.last()));
    let at = |pixel: usize, channel: usize| last[pixel * n + channel];
    // Luminance, and how far it is above and below a quarter, at gains of 6.
    for (pixel, expected) in [(4, [0.0, 0.0, 0.0, 1.5]), (7, [6.0, 4.5, 0.0, 0.0])] {
        let found = [at(pixel, 0), at(pixel, 1), at(pixel, n / 2), at(pixel, n / 2 + 1)];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4, "{pixel}: {found} for {expected}");
        }
    }
    // An edge from dark to bright, and not from bright to dark.
    assert!(at(5, 4) > 1.0 && at(5, n / 2 + 4) == 0.0);
}

#[test]
fn the_default_network_ends_with_the_encoder() {
    let network = LossNetwork::distilled(ENCODER_NAME, ENCODER).unwrap();
    let (width, height) = (40, 36);
    let mut random = Random::new(4);
    let rgb: Vec<f32> = (0..width * height * 3).map(|_| random.uniform()).collect();
    let sizes = network.sizes(Size { width, height });
    let features = network.forward(&sizes, &rgb, &Work::default()).unwrap();
    // The layers of the filters follow the encoder's.
    let layer = network.layers().iter().rfind(|layer| layer.matching > 0.0).unwrap();
    let encoder = Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec()).unwrap();
    let expected =
        encoder.encode(&Image { width: width as u32, height: height as u32, rgb, alpha: None }).unwrap();
    assert_eq!(sizes.size(layer), Size { width: 10, height: 9 });
    for (a, b) in features.rows(layer).iter().zip(&expected.values) {
        assert!((a - b).abs() < 1e-3 * (1.0 + b.abs()), "{a} for {b}");
    }
}

#[test]
fn another_network_is_refused() {
    let filters = bank::filters_after(1).to_bytes(None, &[]);
    for (bytes, found) in [(&filters[..], "no layers at half and quarter size"), (&[0xff; 64], "found")] {
        let error = LossNetwork::distilled("other.safetensors", bytes).err().unwrap().to_string();
        assert!(error.starts_with("other.safetensors: ") && error.contains(found), "{error}");
    }
}
