//! The networks against finite differences, and against the engine that runs encoders.

use stylegaussian::random::Random;
use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{
    Encoder, Image,
    onnx::{ChainWriter, Convolution},
};

use super::{LossNetwork, Size, bank, chain::Chain, onnx};

fn random_values(n: usize, scale: f32, random: &mut Random) -> Vec<f32> {
    (0..n).map(|_| scale * random.normal()).collect()
}

/// A chain with every operation that the reader knows, on 3 channels.
fn small_graph() -> Vec<u8> {
    let mut random = Random::new(1);
    let mut convolution = |out: usize, inputs: usize, side: usize| Convolution {
        shape: [out, inputs, side, side],
        weight: random_values(out * inputs * side * side, 0.4, &mut random),
        bias: random_values(out, 0.1, &mut random),
    };
    let (first, second, third) = (convolution(4, 3, 3), convolution(4, 4, 3), convolution(5, 4, 2));
    let start = ChainWriter::new(3).reflect().convolution(&first, 0).relu();
    let place = start.here();
    let pooled = start.convolution(&second, 1).relu().add_from(&place).max_pool(true);
    pooled.reflect_by(0, 1).strided_convolution(&third, 2).relu().finish()
}

#[test]
fn a_chain_gives_what_the_engine_gives() {
    let bytes = small_graph();
    let chain = onnx::read(&bytes).unwrap();
    // Odd sides: max-pooling keeps the last line.
    let size = Size { width: 13, height: 11 };
    let mut random = Random::new(2);
    let rgb: Vec<f32> = (0..size.n_pixels() * 3).map(|_| random.uniform()).collect();
    let values = chain.forward(&chain.sizes(size), &rgb);
    let encoder = Encoder::from_onnx("small", bytes).unwrap();
    let expected = encoder.encode(&Image { width: 13, height: 11, rgb }).unwrap();
    let found = &values.0[values.0.len() - 1];
    assert_eq!(found.len(), expected.values.len());
    for (i, (a, b)) in found.iter().zip(&expected.values).enumerate() {
        assert!((a - b).abs() < 1e-4, "[{i}]: {a} for {b}");
    }
}

/// Gradients of random sums of some values, against finite differences.
fn check_gradients(chain: &Chain, size: Size, watched: &[usize]) {
    let (sizes, mut random) = (chain.sizes(size), Random::new(3));
    let rgb: Vec<f32> = (0..size.n_pixels() * 3).map(|_| random.uniform()).collect();
    let values = chain.forward(&sizes, &rgb);
    let directions: Vec<Vec<f32>> =
        watched.iter().map(|&value| random_values(values.0[value].len(), 1.0, &mut random)).collect();
    let loss = |rgb: &[f32]| -> f64 {
        let values = chain.forward(&sizes, rgb);
        let dot = |(value, direction): (&usize, &Vec<f32>)| -> f64 {
            values.0[*value].iter().zip(direction).map(|(a, b)| f64::from(a * b)).sum()
        };
        watched.iter().zip(&directions).map(dot).sum()
    };
    let mut grads = vec![None; values.0.len()];
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
fn gradients_match_finite_differences() {
    let chain = onnx::read(&small_graph()).unwrap();
    // Two values: the gradient flows through all operations, and sums where it meets itself.
    check_gradients(&chain, Size { width: 6, height: 5 }, &[1, chain.operations.len()]);
}

#[test]
fn gradients_of_filters_match_finite_differences() {
    let chain = bank::filters_after(1);
    check_gradients(&chain, Size { width: 8, height: 6 }, &[chain.operations.len()]);
}

#[test]
fn filters_see_both_signs() {
    let chain = bank::filters_after(0);
    let size = Size { width: 4, height: 4 };
    // Dark left, bright right.
    let rgb: Vec<f32> = (0..16).flat_map(|pixel| [if pixel % 4 < 2 { 0.0 } else { 1.0 }; 3]).collect();
    let values = chain.forward(&chain.sizes(size), &rgb);
    let (last, n) = (values.0.last().unwrap(), chain.channels(chain.operations.len()));
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
    let features = network.forward(&sizes, &rgb);
    // The layers of the filters follow the encoder's.
    let layer = network.layers().iter().rfind(|layer| layer.matching > 0.0).unwrap();
    let encoder = Encoder::from_onnx(ENCODER_NAME, ENCODER.to_vec()).unwrap();
    let expected = encoder.encode(&Image { width: width as u32, height: height as u32, rgb }).unwrap();
    assert_eq!(sizes.size(layer), Size { width: 10, height: 9 });
    for (a, b) in features.rows(layer).iter().zip(&expected.values) {
        assert!((a - b).abs() < 1e-3 * (1.0 + b.abs()), "{a} for {b}");
    }
}

#[test]
fn broken_graphs_are_refused() {
    let bytes = small_graph();
    for end in (0..bytes.len()).step_by(97) {
        assert!(onnx::read(&bytes[..end]).is_err(), "{end} of {} bytes", bytes.len());
    }
    assert!(onnx::read(&[0xff; 64]).is_err());
    let error = LossNetwork::distilled("small.onnx", &bytes).err().map(|error| error.to_string());
    assert!(error.is_none_or(|error| error.starts_with("small.onnx: ")));
}

/// The reader makes no chain without operations.
#[test]
fn channels_follow_convolutions() {
    let chain: Chain = onnx::read(&small_graph()).unwrap();
    let channels: Vec<usize> = (0..=chain.operations.len()).map(|value| chain.channels(value)).collect();
    assert_eq!(channels, [3, 4, 4, 4, 4, 5]);
}
