//! Blocks, parts and precisions of the style pass against its CPU twin, `stylegaussian::fold::stylize`.

mod random;

use random::Random;
use stylegaussian::{Activation, Decoder, Scene, fold, slices::SLICE};
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::{DeviceError, DeviceOptions, HeadlessDevice},
    style::{
        FoldedLayers, GpuDecoder, Precision, StyleBytes, StyleInputs, StyleOptions, StylePass, StyleProgress,
        StyleScene, StyleSceneError, WorkMeter,
    },
};

const LEAKY: Activation = Activation::LeakyRelu { slope: 0.2 };
const PAPER: [usize; 5] = [256, 128, 64, 32, 3];

fn device() -> Option<HeadlessDevice> {
    match pollster::block_on(HeadlessDevice::request(DeviceOptions::default())) {
        Ok(device) => Some(device),
        Err(DeviceError::NoAdapter(_)) => {
            eprintln!("SKIPPED: no GPU adapter");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// A scene on the GPU with the weights of one style, and the colors that the CPU computes.
struct Case {
    scene: StyleScene,
    weights: GpuDecoder,
    expected: Vec<[f32; 3]>,
}

fn case(gpu: &HeadlessDevice, scene: &Scene, decoder: &Decoder, options: StyleOptions) -> Case {
    let features = scene.features.as_ref().unwrap();
    let map = fold::transfer(features, &[(&Random(7).style(features), 1.0)], 0.1).unwrap();
    let inputs = StyleInputs::with_options(scene, decoder, options).unwrap();
    let folded = FoldedLayers::new(inputs.content(), decoder, &map).unwrap();
    Case {
        scene: StyleScene::upload(&gpu.device, &gpu.queue, &inputs).unwrap(),
        weights: GpuDecoder::new(&gpu.device, &gpu.queue, &folded).unwrap(),
        expected: fold::stylize(scene, decoder, &map).unwrap(),
    }
}

/// Colors after as many frames as the budget needs, and the number of these frames.
fn colors(
    gpu: &HeadlessDevice,
    pass: &StylePass,
    case: &Case,
    mut budget: WorkMeter,
) -> (Vec<[f32; 3]>, usize) {
    let HeadlessDevice { device, queue, .. } = gpu;
    let colors = GaussianColors::new(device, case.expected.len()).unwrap();
    let (mut progress, mut n_parts) = (StyleProgress::default(), 0);
    while !progress.is_done() {
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let Case { scene, weights, .. } = case;
        budget.begin_frame();
        pass.encode_some(device, &mut encoder, scene, weights, &colors, &mut progress, &mut budget).unwrap();
        queue.submit([encoder.finish()]);
        n_parts += 1;
    }
    (colors.read(device, queue).unwrap(), n_parts)
}

fn largest_difference(expected: &[[f32; 3]], found: &[[f32; 3]]) -> f32 {
    assert_eq!(expected.len(), found.len());
    let pairs = expected.as_flattened().iter().zip(found.as_flattened());
    let differences =
        pairs.map(|(a, b)| if a.is_finite() && b.is_finite() { (a - b).abs() } else { f32::INFINITY });
    differences.fold(0.0, f32::max)
}

#[track_caller]
fn check(gpu: &HeadlessDevice, scene: &Scene, decoder: &Decoder, options: StyleOptions, tolerance: f32) {
    let pass = StylePass::with_precision(&gpu.device, options.precision);
    let case = case(gpu, scene, decoder, options);
    let (found, _) = colors(gpu, &pass, &case, WorkMeter::unlimited());
    let difference = largest_difference(&case.expected, &found);
    eprintln!("{options:?}: largest difference {difference:.2e}");
    assert!(difference < tolerance, "{options:?}: {difference} from the CPU");
}

/// Scratch memory for a half and for a tenth of the scene, one to five layers, with and without base colors.
/// Gaussians on the borders of blocks get the same colors as those inside.
#[test]
fn blocks_give_the_same_colors() {
    let Some(gpu) = device() else { return };
    let cases: [(usize, &[usize], usize); 4] = [
        (3000, &[48, 40, 3], 2000),
        (6000, &[16, 16, 16, 16, 3], 4500),
        (6000, &[24, 3], 900),
        (500, &[3], 50),
    ];
    for (n, widths, max_rows) in cases {
        for (residual, smoothing_passes) in [(0.0, 0), (0.5, 2)] {
            let mut random = Random(n as u64 + max_rows as u64);
            let scene = random.scene(n, 12, 1, 8);
            // Both options change together: that covers each of them with and without borders of blocks.
            let decoder = Decoder { residual, smoothing_passes, n_noise: 2, ..random.empty(8, LEAKY) };
            let decoder = random.layers(decoder, &scene, widths, false);
            let row_bytes: usize = 2 * (widths[0] + widths.get(1).copied().unwrap_or(0));
            let scratch_bytes = (max_rows * row_bytes) as u64;
            let options = StyleOptions { scratch_bytes, ..StyleOptions::default() };
            if widths.len() > 2 {
                let bytes = StyleBytes::of(&scene, &decoder, &options).unwrap();
                assert!(bytes.activations <= scratch_bytes, "{bytes:?}, expected {scratch_bytes}");
            }
            check(&gpu, &scene, &decoder, options, 2e-3);
        }
    }
}

/// A change in parts gives the same colors as the change at once, to the last bit, also if the scene is cut
/// into blocks.
#[test]
fn parts_add_up() {
    let Some(gpu) = device() else { return };
    let mut random = Random(21);
    let scene = random.scene(2500, 16, 0, 8);
    let decoder = random.decoder(&scene, 8, &[64, 32, 3], LEAKY);
    let pass = StylePass::new(&gpu.device);
    for scratch_bytes in [64 << 20, 2000 * 192] {
        let case = case(&gpu, &scene, &decoder, StyleOptions { scratch_bytes, ..StyleOptions::default() });
        let (at_once, n_parts) = colors(&gpu, &pass, &case, WorkMeter::unlimited());
        assert_eq!(n_parts, 1);
        assert!(largest_difference(&case.expected, &at_once) < 2e-3);
        let all: u64 = case.scene.operations().iter().sum();
        let (in_parts, n_parts) = colors(&gpu, &pass, &case, WorkMeter::of_operations(all / 6));
        assert!((6..20).contains(&n_parts), "{n_parts} parts");
        assert_eq!(at_once, in_parts);
    }
}

/// Timestamps arrive and change the assumed speed, although the clock of a software adapter measures nothing
/// useful. The colors stay the same.
#[test]
fn a_timed_budget_learns_a_speed() {
    let features = wgpu::Features::TIMESTAMP_QUERY;
    let options = DeviceOptions { features, ..Default::default() };
    let gpu = match pollster::block_on(HeadlessDevice::request(options)) {
        Ok(gpu) => gpu,
        Err(error) => return eprintln!("SKIPPED: {error}"),
    };
    let HeadlessDevice { device, queue, info } = &gpu;
    let mut budget = WorkMeter::new(0.05).timed(device, queue);
    if !budget.is_timed() {
        return eprintln!("SKIPPED: {} has no timestamps", info.name);
    }
    let mut random = Random(41);
    let scene = random.scene(3000, 12, 1, 8);
    let decoder = random.decoder(&scene, 8, &[48, 40, 3], LEAKY);
    let pass = StylePass::new(device);
    let Case { scene, weights, expected } = case(&gpu, &scene, &decoder, StyleOptions::default());
    let colors = GaussianColors::new(device, expected.len()).unwrap();
    let assumed = budget.operations();
    let (mut progress, mut n_frames) = (StyleProgress::default(), 0);
    while !progress.is_done() {
        budget.begin_frame();
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        pass.encode_some(device, &mut encoder, &scene, &weights, &colors, &mut progress, &mut budget)
            .unwrap();
        queue.submit([encoder.finish()]);
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        n_frames += 1;
    }
    eprintln!("{n_frames} frames; {assumed} operations assumed, {} found", budget.operations());
    assert!(n_frames > 3, "{n_frames}");
    assert_ne!(assumed, budget.operations());
    assert!(largest_difference(&expected, &colors.read(device, queue).unwrap()) < 2e-3);
}

/// The bounds in the documentation of [`Precision`].
#[test]
fn precisions_keep_their_bounds() {
    let Some(gpu) = device() else { return };
    let mut random = Random(31);
    let scene = random.scene(1500, 32, 0, 8);
    let sigmoid = random.decoder(&scene, 8, &PAPER, Activation::Sigmoid);
    let leaky = random.decoder(&scene, 8, &PAPER, LEAKY);
    let options = |precision| StyleOptions { precision, ..StyleOptions::default() };
    for decoder in [&sigmoid, &leaky] {
        check(&gpu, &scene, decoder, options(Precision::F32), 6e-4);
        check(&gpu, &scene, decoder, options(Precision::F16), 2e-3);
    }
    check(&gpu, &scene, &sigmoid, options(Precision::Unorm8), 5e-3);
    let averaged = Decoder { smoothing_passes: 3, ..sigmoid };
    check(&gpu, &scene, &averaged, options(Precision::Unorm8), 5e-3);
    check(&gpu, &scene, &averaged, options(Precision::F32), 6e-4);
    check(&gpu, &scene, &random.decoder(&scene, 8, &[3], LEAKY), options(Precision::F32), 6e-4);
}

/// A pass of another precision, and bytes for activations outside of 0..1, are refused before wgpu sees them.
#[test]
fn precisions_that_do_not_fit_are_errors() {
    let Some(gpu) = device() else { return };
    let mut random = Random(41);
    let scene = random.scene(50, 8, 0, 8);
    let decoder = random.decoder(&scene, 8, &[16, 3], LEAKY);
    let refused = |decoder: &Decoder, of_pass, precision| {
        let case = case(&gpu, &scene, decoder, StyleOptions { precision, ..StyleOptions::default() });
        let colors = GaussianColors::new(&gpu.device, 50).unwrap();
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let pass = StylePass::with_precision(&gpu.device, of_pass);
        let encoded = pass.encode(&gpu.device, &mut encoder, &case.scene, &case.weights, &colors);
        let error = encoded.unwrap_err();
        assert!(matches!(error, StyleSceneError::Mismatch { .. }), "{error}");
        error.to_string()
    };
    let precisions = refused(&decoder, Precision::F32, Precision::F16);
    assert!(precisions.contains("a precision of F32, the scene has F16"), "{precisions}");
    let bytes = refused(&decoder, Precision::Unorm8, Precision::Unorm8);
    assert!(bytes.contains("leaky_relu:0.2"), "{bytes}");
}

/// A page may draw between the slices of packing: no slice holds more than a fixed number of Gaussians.
#[test]
fn packing_pauses_in_proportion_to_the_scene() {
    let pauses_of = |n: usize| {
        let mut random = Random(43);
        let scene = random.scene(n, 8, 0, 8);
        let decoder = random.decoder(&scene, 8, &[16, 3], LEAKY);
        let n_pauses = std::cell::Cell::new(0);
        let mut pause = || {
            n_pauses.set(n_pauses.get() + 1);
            let mut has_waited = false;
            std::future::poll_fn(move |context| {
                context.waker().wake_by_ref();
                match std::mem::replace(&mut has_waited, true) {
                    true => std::task::Poll::Ready(()),
                    false => std::task::Poll::Pending,
                }
            })
        };
        let options = StyleOptions::default();
        let sliced =
            pollster::block_on(StyleInputs::in_slices(&scene, &decoder, options, &mut pause)).unwrap();
        let at_once = StyleInputs::new(&scene, &decoder).unwrap();
        assert_eq!(sliced.content().statistics(), at_once.content().statistics());
        n_pauses.get()
    };
    // Centering and planes pause once for every slice; covariances at every fourth.
    let (few, many) = (pauses_of(2 * SLICE), pauses_of(6 * SLICE));
    assert_eq!(many - few, 4 + 4 + 1, "{few} and {many} pauses");
}
