//! Compares the CPU kernels with the composed operations, and recorded gradients with finite differences.

use burn::tensor::Shape;
use glam::UVec2;
use stylegaussian::random::Random;

use super::*;

fn tensor(random: &mut Random, shape: [usize; 2]) -> FloatTensor<Flex> {
    let values: Vec<f32> = (0..shape[0] * shape[1]).map(|_| random.normal()).collect();
    FloatTensor::<Flex>::from_data(TensorData::new(values, shape))
}

fn check_close(what: &str, a: FloatTensor<Flex>, b: FloatTensor<Flex>) {
    assert_eq!(a.shape(), b.shape(), "{what}");
    let [a, b] = [a, b].map(|tensor| tensor.to_contiguous());
    for (i, (a, b)) in a.storage::<f32>().iter().zip(b.storage::<f32>()).enumerate() {
        assert!((a - b).abs() < 1e-4, "{what}[{i}]: the CPU kernel gives {a}, the composed operation {b}");
    }
}

#[test]
fn kernels_match_composed_operations() {
    let mut random = Random::new(1);
    let (n_in, n_out, k, d_in, d_out) = (50, 30, 3, 7, 5);
    let neighbors = (0..n_out * k).map(|_| random.below(n_in) as u32).collect();
    let windows = Arc::new(Windows::new(neighbors, k, n_in));
    let x = tensor(&mut random, [n_in, d_in]);
    let weight = tensor(&mut random, [d_out, k * d_in]);
    let bias = tensor(&mut random, [1, d_out]).reshape(Shape::new([d_out]));
    let grad = tensor(&mut random, [n_out, d_out]);
    check_close(
        "windows_conv",
        Flex::windows_conv(x.clone(), weight.clone(), bias.clone(), windows.clone()),
        composed::windows_conv::<Flex>(x.clone(), weight.clone(), bias, &windows),
    );
    check_close(
        "windows_conv_backward_input",
        Flex::windows_conv_backward_input(weight.clone(), grad.clone(), windows.clone()),
        composed::windows_conv_backward_input::<Flex>(weight, grad.clone(), &windows),
    );
    check_close(
        "windows_conv_backward_weight",
        Flex::windows_conv_backward_weight(x.clone(), grad.clone(), windows.clone()),
        composed::windows_conv_backward_weight::<Flex>(x, grad, &windows),
    );
}

#[test]
fn picture_kernels_match_composed_operations() {
    let mut random = Random::new(4);
    let (size, n_channels) = ([5, 3], 4);
    let x = tensor(&mut random, [15, n_channels]);
    let y = Flex::max_pool(x.clone(), size);
    check_close("max_pool", y.clone(), composed::max_pool::<Flex>(x.clone(), size));
    let grad = tensor(&mut random, [6, n_channels]);
    check_close(
        "max_pool_backward",
        Flex::max_pool_backward(x.clone(), y.clone(), grad.clone(), size),
        composed::max_pool_backward::<Flex>(x.clone(), y, grad, size),
    );
    let shares: Arc<Vec<f32>> = Arc::new((1..=15).map(|i| i as f32 / 120.0).collect());
    let statistics = Flex::row_statistics(x.clone(), shares.clone());
    check_close("row_statistics", statistics.clone(), composed::row_statistics::<Flex>(x.clone(), &shares));
    let grad = tensor(&mut random, [2, n_channels]);
    check_close(
        "row_statistics_backward",
        Flex::row_statistics_backward(x.clone(), statistics.clone(), grad.clone(), shares.clone()),
        composed::row_statistics_backward::<Flex>(x, statistics, grad, &shares),
    );
}

#[test]
fn segments_of_any_length_add_up() {
    let mut random = Random::new(8);
    // None, one, a full round, one more, and two rounds of rounds.
    let lengths = [0, 1, 8, 9, 0, 130];
    let to: Vec<u32> = lengths
        .iter()
        .enumerate()
        .flat_map(|(target, &n)| std::iter::repeat_n(target as u32, n))
        .rev()
        .collect();
    let from: Vec<u32> = to.iter().map(|_| random.below(20) as u32).collect();
    let factors: Vec<f32> = to.iter().map(|_| random.normal()).collect();
    let source = tensor(&mut random, [20, 3]);
    let mut expected = vec![0.0_f32; lengths.len() * 3];
    for ((&to, &from), factor) in to.iter().zip(&from).zip(&factors) {
        for channel in 0..3 {
            expected[to as usize * 3 + channel] +=
                factor * source.storage::<f32>()[from as usize * 3 + channel];
        }
    }
    let expected = FloatTensor::<Flex>::from_data(TensorData::new(expected, [lengths.len(), 3]));
    let segments = composed::Segments::new(&to, from.into_iter().zip(factors), lengths.len());
    check_close("segment_sums", expected, composed::segment_sums::<Flex>(source, segments.clone()));
    // Parts of the targets: at most two padded segments, but the longest alone.
    let parts = segments.split(16);
    assert_eq!(parts.iter().map(composed::Segments::n_targets).collect::<Vec<_>>(), [2, 1, 1, 1, 1]);
}

/// Compares a convolution with ReLU with the plain one. The latter's gradients are checked below.
#[test]
fn a_rectified_convolution_is_the_plain_one_and_a_relu() {
    let device = burn::tensor::Device::flex().autodiff();
    let mut random = Random::new(5);
    let windows = Arc::new(Windows::new(vec![0, 1, 2, 2, 1, 0], 2, 3));
    let mut values = |shape: [usize; 2]| {
        let values: Vec<f32> = (0..shape[0] * shape[1]).map(|_| random.normal()).collect();
        Tensor::<2>::from_data(TensorData::new(values, shape), &device)
    };
    let (x, weight, bias, direction) = (values([3, 2]), values([3, 4]), values([1, 3]), values([3, 3]));
    let run = |rectified: bool| {
        let x = x.clone().require_grad();
        let bias = bias.clone().reshape([3]);
        let y = match rectified {
            true => windows_conv_relu(x.clone(), weight.clone(), bias, &windows),
            false => burn::tensor::activation::relu(windows_conv(x.clone(), weight.clone(), bias, &windows)),
        };
        let grads = (y.clone() * direction.clone()).sum().backward();
        let values = |tensor: Tensor<2>| tensor.into_data().try_to_vec::<f32>().unwrap();
        (values(y), values(x.grad(&grads).unwrap()))
    };
    let (rectified, plain) = (run(true), run(false));
    assert!(rectified.0.contains(&0.0) && rectified.0.iter().any(|y| *y > 0.0), "{:?}", rectified.0);
    let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(close(&rectified.0, &plain.0) && close(&rectified.1, &plain.1), "{rectified:?} {plain:?}");
}

#[test]
fn splat_matches_composed_operations() {
    let mut random = Random::new(2);
    let weights = Arc::new(BlendWeights {
        size: UVec2::new(2, 2),
        n_gaussians: 3,
        starts: vec![0, 2, 2, 3, 5],
        indices: vec![0, 2, 1, 2, 0],
        weights: vec![0.5, 0.25, 0.75, 0.1, 0.9],
    });
    let (colors, grad) = (tensor(&mut random, [3, 3]), tensor(&mut random, [4, 3]));
    check_close(
        "splat",
        Flex::splat(colors.clone(), weights.clone()),
        composed::splat::<Flex>(colors, &weights),
    );
    check_close(
        "splat_backward",
        Flex::splat_backward(grad.clone(), weights.clone()),
        composed::splat_backward::<Flex>(grad, &weights),
    );
}

/// Compares recorded gradients with finite differences of a loss that is linear in each argument.
#[test]
fn recorded_gradients_match_finite_differences() {
    let device = burn::tensor::Device::flex().autodiff();
    let mut random = Random::new(3);
    let windows = Arc::new(Windows::new(vec![0, 1, 2, 2, 1, 0], 2, 3));
    let mut values = |n: usize| (0..n).map(|_| random.normal()).collect::<Vec<f32>>();
    let (x, weight, bias) = (values(6), values(12), values(3));
    let direction = values(9);
    let loss = |[x, weight, bias]: [&[f32]; 3], grads: bool| {
        let tensor = |values: &[f32], shape: [usize; 2]| {
            Tensor::<2>::from_data(TensorData::new(values.to_vec(), shape), &device).require_grad()
        };
        let (x, weight, bias) = (tensor(x, [3, 2]), tensor(weight, [3, 4]), tensor(bias, [1, 3]));
        let y = windows_conv(x.clone(), weight.clone(), bias.clone().reshape([3]), &windows);
        let loss = (y * Tensor::from_data(TensorData::new(direction.clone(), [3, 3]), &device)).sum();
        let recorded: Vec<Vec<f32>> = match grads {
            true => {
                let grads = loss.backward();
                let grad =
                    |tensor: &Tensor<2>| tensor.grad(&grads).unwrap().into_data().try_to_vec().unwrap();
                vec![grad(&x), grad(&weight), grad(&bias)]
            }
            false => Vec::new(),
        };
        (loss.into_scalar::<f32>(), recorded)
    };
    let arguments = [x, weight, bias];
    let view = |arguments: &[Vec<f32>; 3]| loss([&arguments[0], &arguments[1], &arguments[2]], false).0;
    let (base, grads) = loss([&arguments[0], &arguments[1], &arguments[2]], true);
    for which in 0..3 {
        for i in 0..arguments[which].len() {
            let mut moved = arguments.clone();
            moved[which][i] += 0.5;
            let difference = (view(&moved) - base) / 0.5;
            assert!((difference - grads[which][i]).abs() < 1e-4, "argument {which}[{i}]");
        }
    }
}
