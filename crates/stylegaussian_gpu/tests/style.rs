//! The style pass against its CPU twin, `stylegaussian::fold::stylize`.

mod random;

use random::Random;
use stylegaussian::{Activation, Decoder, Neighbors, Scene, fold};
use stylegaussian_files::{read_decoder, read_scene};
use stylegaussian_gpu::{
    buffers::TooLarge,
    colors::GaussianColors,
    device::{DeviceError, DeviceOptions, HeadlessDevice},
    style::{FoldedLayers, GpuDecoder, StylePass, StyleScene, StyleSceneError},
};

/// The largest difference from the CPU that the documentation promises, in display-referred units.
const TOLERANCE: f32 = 2e-3;

const LEAKY: Activation = Activation::LeakyRelu { slope: 0.2 };

fn device() -> Option<HeadlessDevice> {
    device_with_limits(|limits| limits)
}

fn device_with_limits(limits: fn(wgpu::Limits) -> wgpu::Limits) -> Option<HeadlessDevice> {
    match pollster::block_on(HeadlessDevice::request(DeviceOptions { limits, ..Default::default() })) {
        Ok(device) => Some(device),
        Err(DeviceError::NoAdapter(_)) => {
            eprintln!("SKIPPED: no GPU adapter");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Colors of a scene in a mix of two random styles: the CPU's, then the GPU's.
fn both(gpu: &HeadlessDevice, scene: &Scene, decoder: &Decoder, content: f64) -> [Vec<[f32; 3]>; 2] {
    let features = scene.features.as_ref().unwrap();
    let mut random = Random(7);
    let styles = [random.style(features), random.style(features)];
    let map = fold::transfer(features, &[(&styles[0], 0.3), (&styles[1], 0.7)], content).unwrap();
    let expected = fold::stylize(scene, decoder, &map).unwrap();
    let found = pollster::block_on(stylegaussian_gpu::style::stylize(gpu, scene, decoder, &map)).unwrap();
    [expected, found]
}

fn largest_difference([expected, found]: &[Vec<[f32; 3]>; 2]) -> f32 {
    assert_eq!(expected.len(), found.len());
    let difference = |(a, b): (&f32, &f32)| {
        let difference = (a - b).abs();
        if difference.is_nan() { f32::INFINITY } else { difference }
    };
    expected.as_flattened().iter().zip(found.as_flattened()).map(difference).fold(0.0, f32::max)
}

/// Standard deviation of all numbers.
fn deviation(colors: &[[f32; 3]]) -> f32 {
    let values = colors.as_flattened();
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt()
}

fn check(gpu: &HeadlessDevice, name: &str, scene: &Scene, decoder: &Decoder, content: f64) {
    let colors = both(gpu, scene, decoder, content);
    let difference = largest_difference(&colors);
    eprintln!("{name}: largest difference {difference:.2e}, deviation {:.3}", deviation(&colors[0]));
    assert!(difference < TOLERANCE, "{name}: {difference} from the CPU");
}

/// N, L, E, K, widths of the layers' outputs, activation, content.
type Case = (usize, usize, usize, usize, &'static [usize], Activation, f64);

#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = device() else { return };
    let paper: &[usize] = &[256, 128, 64, 32, 3];
    let cases: [Case; 8] = [
        (1000, 32, 0, 8, paper, Activation::Sigmoid, 0.0),
        (1000, 32, 3, 8, paper, LEAKY, 0.25),
        (3000, 32, 0, 8, &[64, 32, 3], LEAKY, 0.0),
        (500, 256, 0, 8, &[64, 40, 3], Activation::Sigmoid, 0.0),
        (7, 256, 5, 8, &[72, 3], LEAKY, 0.5),
        (1, 32, 0, 8, paper, Activation::Sigmoid, 0.0),
        (300, 5, 1, 1, &[9, 17, 3], LEAKY, 1.0),
        (200, 12, 0, 64, &[3], Activation::Sigmoid, 0.0),
    ];
    for (seed, (n, n_latent, n_extra, k, widths, activation, content)) in cases.into_iter().enumerate() {
        let mut random = Random(seed as u64 + 1);
        let scene = random.scene(n, n_latent, n_extra, k);
        let decoder = random.decoder(&scene, k, widths, activation);
        check(
            &gpu,
            &format!("N {n}, L {n_latent}, E {n_extra}, K {k}, {widths:?}"),
            &scene,
            &decoder,
            content,
        );
    }
}

#[test]
fn gpu_matches_cpu_with_all_that_decoders_take() {
    let Some(gpu) = device() else { return };
    for (residual, smoothing_passes) in [(0.0, 0), (1.0, 0), (0.0, 1), (0.25, 4)] {
        let mut random = Random(11);
        let mut scene = random.scene(400, 16, 2, 8);
        // Neighbors are found if the scene has none.
        scene.neighbors = None;
        let decoder = random.empty(8, LEAKY);
        let decoder = Decoder { residual, n_noise: 4, smoothing_passes, base_color: true, ..decoder };
        for widths in [&[32, 16, 3][..], &[3]] {
            let decoder = random.layers(decoder.clone(), &scene, widths, true);
            let what = format!("residual {residual}, {smoothing_passes} smoothing passes, {widths:?}");
            check(&gpu, &what, &scene, &decoder, 0.1);
        }
    }
}

#[test]
fn no_gaussians_no_colors() {
    let Some(gpu) = device() else { return };
    let mut random = Random(1);
    let scene = random.scene(0, 32, 0, 8);
    let decoder = random.decoder(&scene, 8, &[16, 3], LEAKY);
    assert!(both(&gpu, &scene, &decoder, 0.0).iter().all(Vec::is_empty));
}

/// The shipped decoder on real features.
#[test]
fn gpu_matches_cpu_on_the_demo_scene() {
    let Some(gpu) = device() else { return };
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let path = format!("{root}/crates/stylegaussian_defaults/default.decoder.safetensors");
    let decoder = read_decoder(path.as_ref()).unwrap();
    let whole = read_scene(format!("{root}/assets/demo.sgs").as_ref()).unwrap().scene;
    // Every 37th Gaussian, so that all parts of the scene contribute and colors differ as they do in a picture.
    let some: Vec<u32> = (0..whole.len() as u32).step_by(37).collect();
    let scene = whole.subset(&some);
    let colors = both(&gpu, &scene, &decoder, 0.0);
    let (difference, deviation) = (largest_difference(&colors), deviation(&colors[0]));
    eprintln!("demo scene: largest difference {difference:.2e}, deviation {deviation:.3}");
    assert!(difference < TOLERANCE && deviation >= 0.1, "{difference} from the CPU, deviation {deviation}");
}

/// Channels that hardly vary about a large mean, as in checkpoints, each scaled to the style's deviation by
/// gains of up to 3e5. f16 would lose them entirely if they were not centered.
#[test]
fn nearly_constant_channels_keep_their_precision() {
    let Some(gpu) = device() else { return };
    let (n, d) = (1000, 48);
    let mut random = Random(9);
    let mut scene = random.scene(n, d, 0, 8);
    let features = scene.features.as_mut().unwrap();
    features.basis = (0..d * d).map(|i| if i % (d + 1) == 0 { 1.0 } else { 0.0 }).collect();
    let size = |channel: usize| 1e-5_f32.powf(channel as f32 / (d - 1) as f32);
    features.values = (0..n * d).map(|i| size(i % d) * random.signed() + 3.0).collect();
    let decoder = random.decoder(&scene, 8, &[64, 32, 3], LEAKY);
    let map = {
        let features = scene.features.as_ref().unwrap();
        let style = stylegaussian::ChannelStatistics {
            mean: vec![0.0; d],
            std_dev: vec![5.0; d],
            covariance: None,
            encoder: None,
        };
        fold::transfer(features, &[(&style, 1.0)], 0.0).unwrap()
    };
    assert!(map.gain.iter().any(|gain| *gain > 1e5), "{:?}", map.gain.last());
    let expected = fold::stylize(&scene, &decoder, &map).unwrap();
    let found = pollster::block_on(stylegaussian_gpu::style::stylize(&gpu, &scene, &decoder, &map)).unwrap();
    let deviation = deviation(&expected);
    let difference = largest_difference(&[expected, found]);
    eprintln!("nearly constant channels: largest difference {difference:.2e}, deviation {deviation:.3}");
    assert!(difference < TOLERANCE && deviation > 0.1, "{difference} from the CPU, deviation {deviation}");
}

/// 3,000 Gaussians under limits that put two planes in a buffer.
#[test]
fn split_buffers_give_the_same_colors() {
    let limits = |limits: wgpu::Limits| wgpu::Limits {
        max_storage_buffer_binding_size: 100_000,
        max_buffer_size: 200_000,
        ..limits
    };
    let Some(gpu) = device_with_limits(limits) else { return };
    let mut random = Random(5);
    let scene = random.scene(3000, 40, 0, 8);
    let decoder = random.decoder(&scene, 8, &[48, 40, 3], LEAKY);
    check(&gpu, "split", &scene, &decoder, 0.0);
}

/// A scene that is too large is an error, and reaches no validation of wgpu (whose default handler panics).
#[test]
fn a_scene_beyond_the_limits_is_refused() {
    let limits =
        |limits| wgpu::Limits { max_storage_buffer_binding_size: 4096, max_buffer_size: 4096, ..limits };
    let Some(gpu) = device_with_limits(limits) else { return };
    let mut random = Random(5);
    let scene = random.scene(300, 8, 0, 8);
    let decoder = random.decoder(&scene, 8, &[8, 3], LEAKY);
    let error = StyleScene::new(&gpu.device, &gpu.queue, &scene, &decoder).unwrap_err();
    assert!(matches!(error, StyleSceneError::TooLarge(TooLarge { found: 4800, limit: 4096, .. })), "{error}");
    assert!(error.to_string().contains("4800 bytes"), "{error}");
}

/// One scene, two styles in turns. The same buffers serve both, and dispatches are counted.
#[test]
fn weights_are_replaced_in_place() {
    let Some(gpu) = device() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let mut random = Random(3);
    let scene = random.scene(200, 8, 0, 4);
    let decoder = random.decoder(&scene, 4, &[16, 8, 3], LEAKY);
    let features = scene.features.as_ref().unwrap();
    let maps =
        [1, 2].map(|seed| fold::transfer(features, &[(&Random(seed).style(features), 1.0)], 0.0).unwrap());

    let gpu_scene = StyleScene::new(device, queue, &scene, &decoder).unwrap();
    let fold = |map| FoldedLayers::new(gpu_scene.content(), &decoder, map).unwrap();
    let mut weights = GpuDecoder::new(device, queue, &fold(&maps[0])).unwrap();
    let colors = GaussianColors::new(device, scene.len()).unwrap();
    let pass = StylePass::new(device);
    assert_eq!(pass.dispatches(), 0);
    for i in [0, 1, 0] {
        // The second change allocates its memory anew, the third one reuses it.
        if i == 1 {
            gpu_scene.release_scratch();
        }
        assert!(weights.write(queue, &fold(&maps[i])));
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        pass.encode(device, &mut encoder, &gpu_scene, &weights, &colors).unwrap();
        queue.submit([encoder.finish()]);
        let expected = fold::stylize(&scene, &decoder, &maps[i]).unwrap();
        let found = colors.read(device, queue).unwrap();
        assert!(largest_difference(&[expected, found]) < TOLERANCE);
    }
    assert_eq!(pass.dispatches(), 9);
    let other = random.decoder(&scene, 4, &[16, 3], LEAKY);
    assert!(!weights.write(queue, &FoldedLayers::new(gpu_scene.content(), &other, &maps[0]).unwrap()));
    let few = GaussianColors::new(device, 3).unwrap();
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let error = pass.encode(device, &mut encoder, &gpu_scene, &weights, &few).unwrap_err();
    assert!(error.to_string().contains("colors of 3 Gaussians"), "{error}");
}

#[test]
fn bytes_are_known_before_they_are_allocated() {
    let mut random = Random(3);
    let scene = random.scene(200, 30, 3, 8);
    let decoder = random.decoder(&scene, 8, &[256, 128, 64, 32, 3], LEAKY);
    // 33 inputs are 5 planes; hidden layers write 256 and 128 channels in turns.
    let weights = 4 * (321 * 256 + 2049 * 128 + 1025 * 64 + 513 * 32 + 257 * 4);
    let scratch = 200 * 2 * (256 + 128) + weights;
    assert_eq!(StyleScene::scratch_bytes(&scene, &decoder).unwrap(), scratch);
    assert_eq!(StyleScene::bytes(&scene, &decoder).unwrap(), 200 * (5 * 16 + 8 * 4) + scratch);
}

#[test]
fn what_does_not_fit_is_an_error() {
    let mut random = Random(3);
    let mut scene = random.scene(20, 8, 0, 4);
    let decoder = random.decoder(&scene, 4, &[16, 3], LEAKY);
    let content = stylegaussian_gpu::style::StyleInputs::new(&scene, &decoder).unwrap().content().clone();
    let narrow = fold::ChannelMap::identity(5);
    assert!(FoldedLayers::new(&content, &decoder, &narrow).is_err());
    scene.features = None;
    scene.neighbors = Some(Neighbors { k: 1, indices: (0..20).collect() });
    let error = StyleScene::bytes(&scene, &decoder).unwrap_err();
    assert!(error.to_string().contains("embed it first"), "{error}");
}
