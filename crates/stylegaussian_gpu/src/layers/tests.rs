//! The kernel against its CPU twin on random scenes, layers and masks.

use std::f32::consts::TAU;

use glam::{Affine3A, Quat, Vec3};
use stylegaussian::{
    Scene,
    layers::{self, Layer, Region, Shape},
};

use super::*;
use crate::{
    device::HeadlessDevice,
    splat::{Camera, Cloud, CloudColors, Headless, SplatSettings, testing},
};

/// A scene of random means; nothing else of it is read.
pub(super) fn random_scene(n: usize, random: &mut impl FnMut() -> f32) -> Scene {
    Scene {
        means: (0..n).map(|_| Vec3::from_array([(); 3].map(|()| 4.0 * random() - 2.0))).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::ONE; n],
        opacities: vec![1.0; n],
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    }
}

pub(super) fn random_region(i: usize, random: &mut impl FnMut() -> f32) -> Region {
    let mut size = || 0.2 + 1.5 * random();
    let shape = match i % 9 {
        0 => Shape::Everything,
        1 => Shape::HalfSpace,
        2 => Shape::Ellipsoid { radii: Vec3::new(size(), size(), size()) },
        3 => Shape::Cuboid { half_size: Vec3::new(size(), size(), size()) },
        4 => Shape::Cylinder { radius: size(), half_height: size() },
        5 => Shape::Capsule { radius: size(), half_length: size() },
        6 => Shape::Cone { radius: size(), height: size() },
        7 => Shape::Torus { major_radius: size(), minor_radius: 0.5 * size() },
        _ => Shape::Noise { size: 0.3 * size(), level: 0.6 },
    };
    let axis = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5).normalize();
    let place = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
    let shape_from_scene =
        Affine3A::from_rotation_translation(Quat::from_axis_angle(axis, TAU * random()), place);
    Region { shape, shape_from_scene, softness: 0.5 * random() }
}

/// The kernel's result for layers of these looks and masks, in chunks far smaller than any limit requires.
fn on_gpu(gpu: &HeadlessDevice, scene: &Scene, layers: &[GpuLayer]) -> Vec<[f32; 4]> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let on_gpu = GpuScene::in_chunks(device, scene, 300);
    let colors = GaussianColors::new(device, scene.len()).unwrap();
    let mixer = LayerMixer::new(device);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    mixer.encode(&mut gpu.encoding(&mut encoder), &on_gpu, layers, &colors, &mut MixedLayers::default());
    queue.submit([encoder.finish()]);
    colors.read_premultiplied(device, queue).unwrap()
}

#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = testing::gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let mut random = testing::randoms(11);
    let n = 1000;
    let scene = random_scene(n, &mut random);
    // More layers, looks and masks than one dispatch holds.
    let (n_layers, n_looks) = (20, 6);
    let rgb: Vec<Vec<[f32; 3]>> =
        (0..n_looks).map(|_| (0..n).map(|_| [(); 3].map(|()| 1.4 * random() - 0.2)).collect()).collect();
    let looks: Vec<GaussianColors> =
        rgb.iter().map(|rgb| GaussianColors::from_rgb(device, queue, rgb).unwrap()).collect();
    let opaque: Vec<Vec<[f32; 4]>> =
        rgb.iter().map(|rgb| rgb.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect()).collect();
    let weights: Vec<Vec<[u8; 4]>> =
        (0..2).map(|_| (0..n).map(|_| [(); 4].map(|()| (255.0 * random()) as u8)).collect()).collect();
    let masks: Vec<GaussianMask> =
        weights.iter().map(|weights| GaussianMask::new(device, queue, weights).unwrap()).collect();
    let (mut for_cpu, mut for_gpu) = (Vec::new(), Vec::new());
    for i in 0..n_layers {
        let (region, strength) = (random_region(i, &mut random), 0.3 + 0.7 * random());
        // Every seventh layer is captured, every third painted.
        let look = (i % 7 != 6).then_some(i % n_looks);
        let mask = (i % 3 == 1).then_some((i % 2, i % 4));
        for_cpu.push(Layer {
            look: look.map(|look| &opaque[look][..]),
            region,
            strength,
            mask: mask.map(|(mask, channel)| (&weights[mask][..], channel)),
        });
        for_gpu.push(GpuLayer {
            look: look.map(|look| &looks[look]),
            strokes: None,
            region,
            strength,
            mask: mask.map(|(mask, channel)| (&masks[mask], channel as u32)),
            factors: None,
        });
    }
    // One layer alone, so that no layer hides another's error, and then all.
    for range in (0..n_layers).map(|i| i..i + 1).chain(std::iter::once(0..n_layers)) {
        let expected = layers::mix_layers(&scene.means, &for_cpu[range.clone()]);
        let found = on_gpu(&gpu, &scene, &for_gpu[range.clone()]);
        assert!(range.len() == 1 || found.iter().any(|color| color[3] > 0.5));
        for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
            // f16 holds 11 bits; colors between dispatches are rounded once more.
            let largest = (0..4).map(|c| (found[c] - expected[c]).abs()).fold(0.0, f32::max);
            assert!(largest < 4e-3, "layers {range:?}, Gaussian {i}: {found:?}, expected {expected:?}");
        }
    }
}

/// Regions of no size, of infinite size and of NaN cover nothing or everything, as on the CPU.
#[test]
fn degenerate_layers_match_the_cpu() {
    let Some(gpu) = testing::gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = random_scene(50, &mut testing::randoms(12));
    let look = GaussianColors::from_rgb(device, queue, &[[0.5, 0.25, 1.0]; 50]).unwrap();
    let same = vec![[0.5, 0.25, 1.0, 1.0]; 50];
    let (everywhere, nan) = (Region::EVERYWHERE, Affine3A::from_translation(Vec3::NAN));
    let sphere = |radius: f32| Shape::Ellipsoid { radii: Vec3::splat(radius) };
    let regions = [
        everywhere,
        Region { shape_from_scene: nan, ..everywhere },
        Region { shape: Shape::HalfSpace, shape_from_scene: nan, ..everywhere },
        Region { shape: Shape::HalfSpace, softness: f32::INFINITY, ..everywhere },
        Region { shape: Shape::HalfSpace, softness: f32::NAN, ..everywhere },
        Region { shape: sphere(0.0), ..everywhere },
        Region { shape: sphere(f32::INFINITY), ..everywhere },
        Region { shape: sphere(f32::NAN), ..everywhere },
        Region { shape: Shape::Cuboid { half_size: Vec3::ZERO }, ..everywhere },
        Region { shape: Shape::Cuboid { half_size: Vec3::INFINITY }, ..everywhere },
        Region { shape: Shape::Noise { size: 0.0, level: 0.5 }, ..everywhere },
    ];
    for region in regions {
        let layer =
            GpuLayer { look: Some(&look), strokes: None, region, strength: 1.0, mask: None, factors: None };
        let found = on_gpu(&gpu, &scene, &[layer]);
        let layer = Layer { look: Some(&same), region, strength: 1.0, mask: None };
        let expected = layers::mix_layers(&scene.means, &[layer]);
        for (found, expected) in found.iter().zip(&expected) {
            let largest = (0..4).map(|c| (found[c] - expected[c]).abs()).fold(0.0, f32::max);
            assert!(largest < 2e-3, "{region:?}: {found:?}, expected {expected:?}");
        }
    }
}

/// One mix after another into the same colors, of which each encodes what differs: layers that come, go, move
/// and change.
#[test]
fn a_mix_goes_on_from_the_last() {
    let Some(gpu) = testing::gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let mut random = testing::randoms(14);
    let n = 3000;
    let scene = sorted(random_scene(n, &mut random));
    let on_gpu = GpuScene::in_chunks(device, &scene, 700);
    let rgb: Vec<Vec<[f32; 3]>> =
        (0..3).map(|_| (0..n).map(|_| [(); 3].map(|()| random())).collect()).collect();
    let looks: Vec<_> = rgb.iter().map(|rgb| GaussianColors::from_rgb(device, queue, rgb).unwrap()).collect();
    let opaque: Vec<Vec<[f32; 4]>> =
        rgb.iter().map(|rgb| rgb.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect()).collect();
    let mut weights = vec![[0_u8; 4]; n];
    let mask = GaussianMask::new(device, queue, &weights).unwrap();
    let (mixer, colors) = (LayerMixer::new(device), GaussianColors::new(device, n).unwrap());
    let mut state = MixedLayers::default();
    // A look, a region, a strength, and whether it is masked.
    let mut layers: Vec<(Option<usize>, Region, f32, bool)> = Vec::new();
    for step in 0..60 {
        let choice = (random() * 8.0) as usize;
        let at = (random() * layers.len() as f32) as usize;
        match choice {
            0 | 1 => {
                let look = ((random() * 4.0) as usize).checked_sub(1);
                let strength = if random() < 0.5 { 1.0 } else { 0.5 };
                layers.insert(at, (look, random_region(step, &mut random), strength, random() < 0.3));
            }
            2 if !layers.is_empty() => _ = layers.remove(at),
            3 | 4 if !layers.is_empty() => {
                let moved = Affine3A::from_translation(Vec3::splat(0.3 * random()));
                layers[at].1.shape_from_scene = moved * layers[at].1.shape_from_scene;
            }
            5 if !layers.is_empty() => layers[at].2 = 1.5 - layers[at].2,
            6 => {
                weights.iter_mut().for_each(|weights| *weights = [(); 4].map(|()| (255.0 * random()) as u8));
                mask.write(queue, &weights);
            }
            _ => {}
        }
        let of_gpu: Vec<_> = layers
            .iter()
            .map(|&(look, region, strength, masked)| GpuLayer {
                look: look.map(|look| &looks[look]),
                strokes: None,
                region,
                strength,
                mask: masked.then_some((&mask, 1)),
                factors: None,
            })
            .collect();
        let of_cpu: Vec<_> = layers
            .iter()
            .map(|&(look, region, strength, masked)| Layer {
                look: look.map(|look| &opaque[look][..]),
                region,
                strength,
                mask: masked.then_some((&weights[..], 1)),
            })
            .collect();
        let version = colors.version();
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        mixer.begin_submission();
        mixer.encode(&mut gpu.encoding(&mut encoder), &on_gpu, &of_gpu, &colors, &mut state);
        queue.submit([encoder.finish()]);
        assert!(choice != 7 || colors.version() == version || step == 0, "nothing changed");
        let expected = layers::mix_layers(&scene.means, &of_cpu);
        let found = colors.read_premultiplied(device, queue).unwrap();
        for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
            let largest = (0..4).map(|c| (found[c] - expected[c]).abs()).fold(0.0, f32::max);
            assert!(largest < 4e-3, "step {step}, Gaussian {i}: {found:?}, expected {expected:?}");
        }
    }
    assert!(!layers.is_empty());
}

/// A scene in the order in which scenes are kept: neighbors in space lie near one another.
pub(super) fn sorted(mut scene: Scene) -> Scene {
    scene.sort_by_morton();
    scene
}

/// Eight volumes that move in each frame, against the splat pass at 1280 x 720, in turns: about 300,000
/// Gaussians, the demo scene four times with its copies shifted by a little.
#[test]
#[ignore = "a measurement, which other programs on the machine disturb"]
fn eight_volumes_take_a_tenth_of_the_splat_pass() {
    let Some(gpu) = testing::gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let mut random = testing::randoms(13);
    let demo = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo.sgs");
    let demo = stylegaussian_files::read_scene(&demo).unwrap().scene;
    let four_times: Vec<u32> = (0..4 * demo.len() as u32).map(|i| i / 4).collect();
    let mut scene = demo.subset(&four_times);
    scene.means.iter_mut().for_each(|mean| *mean += 0.02 * Vec3::from_array([(); 3].map(|()| random())));
    let (scene, n) = (sorted(scene), 4 * demo.len());
    let colors: Vec<[f32; 3]> = (0..n).map(|_| [(); 3].map(|()| random())).collect();
    let looks = [(); 3].map(|()| GaussianColors::from_rgb(device, queue, &colors).unwrap());
    let mixed = GaussianColors::new(device, n).unwrap();
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let (mixer, mut state) = (LayerMixer::new(device), MixedLayers::default());
    // Of 0.2 to 1.7 units across half of a world that is 12 wide, each shape at a place of its own.
    let regions: Vec<_> = (0..8).map(|i| random_region(1 + i % 7, &mut random)).collect();
    let places: Vec<_> = (0..8)
        .map(|i| {
            let (x, z) = (TAU * i as f32 / 8.0).sin_cos();
            3.0 * Vec3::new(x, 0.2, z)
        })
        .collect();
    let mut mix = |frame: usize| {
        let everywhere = GpuLayer {
            look: Some(&looks[0]),
            strokes: None,
            region: Region::EVERYWHERE,
            strength: 1.0,
            mask: None,
            factors: None,
        };
        let volumes = regions.iter().zip(&places).enumerate().map(|(i, (region, place))| {
            let moved = Affine3A::from_translation(*place + 0.05 * frame as f32);
            let region = Region { shape_from_scene: region.shape_from_scene * moved, ..*region };
            GpuLayer { look: Some(&looks[i % 3]), region, ..everywhere }
        });
        let layers: Vec<_> = std::iter::once(everywhere).chain(volumes).collect();
        let start = std::time::Instant::now();
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        mixer.begin_submission();
        mixer.encode(&mut gpu.encoding(&mut encoder), &on_gpu, &layers, &mixed, &mut state);
        let encoded = start.elapsed().as_secs_f64();
        queue.submit([encoder.finish()]);
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        [encoded, start.elapsed().as_secs_f64()]
    };
    let mut headless = Headless::new(device);
    let mut draw = || {
        let eye = Affine3A::look_at_rh(Vec3::new(0.0, 4.5, 11.0), Vec3::ZERO, Vec3::Y).inverse();
        let camera = Camera {
            world_from_view: eye,
            clip_from_view: glam::Mat4::perspective_infinite_reverse_rh(0.8, 16.0 / 9.0, 0.1),
            viewport: glam::UVec4::new(0, 0, 1280, 720),
        };
        let colors = CloudColors::Rgb(&mixed);
        let cloud = Cloud { scene: &on_gpu, colors, world_from_scene: Affine3A::IDENTITY, visibility: None };
        let start = std::time::Instant::now();
        headless.render(device, queue, &camera, &[cloud], &SplatSettings::default()).unwrap();
        start.elapsed().as_secs_f64()
    };
    let (mut encodes, mut mixes, mut draws) = (Vec::new(), Vec::new(), Vec::new());
    for frame in 0..25 {
        let [encoded, mixed] = mix(frame);
        encodes.push(encoded);
        mixes.push(mixed);
        draws.push(draw());
    }
    let median = |mut times: Vec<f64>| {
        times.sort_by(f64::total_cmp);
        1e3 * times[times.len() / 2]
    };
    let (encode, mix, draw) = (median(encodes), median(mixes), median(draws));
    eprintln!(
        "mix {mix:.1} ms, of it encoding {encode:.1} ms, splat pass {draw:.1} ms, ratio {:.3}",
        mix / draw
    );
    assert!(mix < 0.1 * draw, "{}", mix / draw);
}
