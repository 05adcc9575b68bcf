//! Strokes in the splat pass against the CPU twin, `stylegaussian::splat::render_strokes`.

mod paintings;
mod pictures;
mod target;

use std::time::Instant;

use glam::{Affine3A, Quat, UVec2, Vec2, Vec3};
use paintings::{strokes, texture};
use pictures::{camera, psnr, random_scene, rgba};
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, render, render_strokes},
    strokes::{PlainSeed, StrokeKnobs, StrokeMotion, StrokeWord, Strokes},
};
use stylegaussian_gpu::{
    device::HeadlessDevice,
    splat::{
        self, Cloud, CloudColors, GpuScene, Headless, HeadlessError, Picture, SplatError, SplatSettings,
    },
};
use target::gpu;

/// The agreement with the CPU, in decibels, with quads that blend in f16.
const LEAST: f64 = 54.0;

/// A cloud in its own place.
fn cloud<'a>(scene: &'a GpuScene, colors: CloudColors<'a>) -> Cloud<'a> {
    Cloud { scene, colors, world_from_scene: Affine3A::IDENTITY, visibility: None }
}

/// By the adapter's fastest way, and by quads.
fn both_ways(device: &wgpu::Device) -> [Headless; 2] {
    [Headless::new(device), Headless::by_quads(device)]
}

/// The differences of two pictures in each channel of each pixel.
fn differences(a: &[[f32; 4]], b: &[[f32; 4]]) -> Vec<f32> {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).collect()
}

fn max(numbers: &[f32]) -> f32 {
    numbers.iter().copied().fold(0.0, f32::max)
}

fn draw(
    gpu: &HeadlessDevice,
    headless: &mut Headless,
    scene: &Scene,
    painting: &Strokes,
    knobs: StrokeKnobs,
    camera: &Camera,
) -> Picture {
    let HeadlessDevice { device, queue, .. } = gpu;
    let on_gpu = GpuScene::new(device, scene).unwrap();
    let uploaded = headless.store().upload(device, queue, painting).unwrap();
    let colors = CloudColors::Captured.with_strokes(&uploaded, knobs);
    let (camera, settings) = (splat::Camera::pinhole(camera), SplatSettings::default());
    headless.render(device, queue, &camera, &[cloud(&on_gpu, colors)], &settings).unwrap()
}

/// Strokes of all sizes: blurred, about a texel to a pixel, and magnified with finer octaves.
#[test]
fn painted_pictures_match() {
    let Some(gpu) = gpu() else { return };
    let camera = camera(UVec2::new(160, 120));
    let textures = [texture(1), texture(2), texture(3)];
    let scene = random_scene(2000, 1, 31);
    let plain = rgba(&render(&scene, Colors::Captured, &camera));
    let default = StrokeKnobs::default();
    let knobs = [
        (600.0, default),
        (60.0, default),
        (8.0, StrokeKnobs { near: 0.8, ..default }),
        (30.0, StrokeKnobs { amount: 1.5, protection: 2.0, stroke_scale: 0.7, near: 0.0, ..default }),
        // A mean of a texel to a pixel, far, and near with gloss.
        (60.0, StrokeKnobs { relief: 1.0, light: Vec3::new(1.0, 1.0, 1.0), ..default }),
        (200.0, StrokeKnobs { relief: 2.0, light: Vec3::new(-2.0, 0.5, -0.3), ..default }),
        (8.0, StrokeKnobs { relief: 0.5, light: Vec3::Z, near: 0.8, ..default }),
        // Of one size on screen, from far, from near, and in relief.
        (600.0, StrokeKnobs { screen_stable: true, ..default }),
        (3.0, StrokeKnobs { screen_stable: true, stroke_scale: 1.7, ..default }),
        (20.0, StrokeKnobs { screen_stable: true, relief: 1.0, light: Vec3::new(1.0, 1.0, 1.0), ..default }),
    ];
    for mut headless in both_ways(&gpu.device) {
        for (pitch, knobs) in knobs {
            let painting = strokes(&scene, &textures, pitch, 32);
            let expected =
                rgba(&render_strokes(&scene, Colors::Captured, (&painting, &knobs), &camera, None));
            let found = draw(&gpu, &mut headless, &scene, &painting, knobs, &camera);
            let differences = differences(&found.rgba, &expected);
            let (far, largest) = (differences.iter().filter(|&&x| x > 4e-3).count(), max(&differences));
            let (agreement, from_plain) = (psnr(&found.rgba, &expected), psnr(&plain, &expected));
            println!(
                "pitch {pitch}: {far} above 0.004, {largest:.4}, {agreement:.1} dB, plain {from_plain:.1} dB"
            );
            // Where alpha is all but `LEAST_ALPHA`, rounding decides whether a splat shows strokes: 0.02 of its
            // detail. Quads blend in f16, with strokes and without.
            assert!(far <= differences.len() / 200 && largest < 0.015, "pitch {pitch}: {far}, {largest}");
            assert!(agreement > LEAST, "pitch {pitch}: {agreement:.1} dB");
            assert!(from_plain < 45.0, "pitch {pitch}: {from_plain:.1} dB from no strokes");
        }
    }
}

/// Strokes that boil and that flow, by tiles and by quads.
#[test]
fn moving_pictures_match() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = random_scene(1000, 1, 41);
    let (camera, knobs) = (camera(UVec2::new(80, 60)), StrokeKnobs::default());
    let painting = strokes(&scene, &[texture(10)], 60.0, 42);
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let (on_screen, settings) = (splat::Camera::pinhole(&camera), SplatSettings::default());
    let still = rgba(&render_strokes(&scene, Colors::Captured, (&painting, &knobs), &camera, None));
    for mut headless in both_ways(device) {
        let uploaded = headless.store().upload(device, queue, &painting).unwrap();
        for motion in [
            StrokeMotion::Boil { rate: 8.0, amount: 0.5 },
            StrokeMotion::Flow { rate: 0.5, amount: 2.0, toward: Vec3::X },
        ] {
            let moving = uploaded.moving(motion);
            let colors = CloudColors::Captured.with_strokes(&moving, knobs).at(1234.56);
            let clouds = [cloud(&on_gpu, colors)];
            let found = headless.render(device, queue, &on_screen, &clouds, &settings).unwrap();
            let moved = painting.moved(motion, 1234.56);
            let expected = rgba(&render_strokes(&scene, Colors::Captured, (&moved, &knobs), &camera, None));
            let (agreement, from_still) = (psnr(&found.rgba, &expected), psnr(&still, &expected));
            // Places are rounded once more before they reach the CPU's records.
            assert!(
                agreement > 50.0 && from_still < 45.0,
                "{motion:?}: {agreement:.1} dB, {from_still:.1} dB"
            );
        }
    }
}

/// Every other Gaussian of a scene, with its strokes.
fn half(whole: &Scene, painting: &Strokes, first: usize) -> (Scene, Strokes) {
    let indices: Vec<u32> = (first as u32..whole.len() as u32).step_by(2).collect();
    let words = indices.iter().map(|&i| painting.words[i as usize]).collect();
    (whole.subset(&indices), Strokes { words, ..painting.clone() })
}

/// Two halves of one scene look like that scene, whether both have strokes or one, in one view that draws one
/// after another.
#[test]
fn painted_and_bare_clouds_interleave() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let whole = random_scene(2000, 1, 33);
    let (camera, default) = (camera(UVec2::new(120, 90)), StrokeKnobs::default());
    let painting = strokes(&whole, &[texture(4), texture(5)], 60.0, 34);
    let halves = [0, 1].map(|first| half(&whole, &painting, first));
    let scenes = halves.each_ref().map(|(scene, _)| GpuScene::new(device, scene).unwrap());
    for mut headless in both_ways(device) {
        let uploaded =
            halves.each_ref().map(|(_, strokes)| headless.store().upload(device, queue, strokes).unwrap());
        // The textures of both are the same.
        assert_eq!(headless.store().n_used(), 2);
        let plain = rgba(&render(&whole, Colors::Captured, &camera));
        let mut last_plain = None;
        for painted in [[false, false], [true, true], [true, false], [false, true], [false, false]] {
            let clouds = [0, 1].map(|i| {
                let colors = CloudColors::Captured;
                cloud(
                    &scenes[i],
                    if painted[i] { colors.with_strokes(&uploaded[i], default) } else { colors },
                )
            });
            let (on_screen, settings) = (splat::Camera::pinhole(&camera), SplatSettings::default());
            let found = headless.render(device, queue, &on_screen, &clouds, &settings).unwrap();
            let mut words = painting.words.clone();
            (0..words.len()).filter(|i| !painted[i % 2]).for_each(|i| words[i] = 0);
            let of_painted = Strokes { words, ..painting.clone() };
            let expected = render_strokes(&whole, Colors::Captured, (&of_painted, &default), &camera, None);
            let expected = rgba(&expected);
            let agreement = psnr(&found.rgba, &expected);
            assert!(agreement > LEAST, "{painted:?}: {agreement:.1} dB");
            assert_eq!(psnr(&plain, &expected) < 45.0, painted != [false, false]);
            if painted == [false, false] {
                // A view that loses its strokes draws as one that never had any.
                assert!(last_plain.replace(found.clone()).is_none_or(|last| last == found));
            }
        }
    }
}

/// One view over frames of which each changes words, knobs or the store's arrays, against a view of its own.
#[test]
fn a_painted_view_keeps_up_with_what_changes() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = random_scene(1000, 0, 35);
    let camera = camera(UVec2::new(80, 60));
    let painting = strokes(&scene, &[texture(6)], 10.0, 36);
    let other = Strokes { words: strokes(&scene, &[texture(6)], 10.0, 37).words, ..painting.clone() };
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let (on_screen, settings) = (splat::Camera::pinhole(&camera), SplatSettings::default());
    for mut headless in both_ways(device) {
        let store = headless.store().clone();
        let uploaded = store.upload(device, queue, &painting).unwrap();
        let default = StrokeKnobs::default();
        let mut more = Vec::new();
        for step in 0..6 {
            let knobs = match step {
                2 => StrokeKnobs { near: 1.0, ..default },
                3 => StrokeKnobs { stroke_scale: 2.0, ..default },
                _ => default,
            };
            if step == 4 {
                // The arrays grow, and others take their place.
                let others = Strokes { textures: vec![texture(7), texture(8)], ..Strokes::default() };
                more.push(store.upload(device, queue, &others).unwrap());
                assert_eq!(store.n_layers(), 4);
            }
            let present = if step == 5 { &other } else { &painting };
            if step == 5 {
                uploaded.write_words(queue, &other.words);
            }
            let colors = CloudColors::Captured.with_strokes(&uploaded, knobs);
            let clouds = [cloud(&on_gpu, colors)];
            let found = headless.render(device, queue, &on_screen, &clouds, &settings).unwrap();
            let expected = render_strokes(&scene, Colors::Captured, (present, &knobs), &camera, None);
            let agreement = psnr(&found.rgba, &rgba(&expected));
            assert!(agreement > LEAST, "step {step}: {agreement:.1} dB");
        }
    }
}

#[test]
fn strokes_without_seeds_are_plain_and_those_of_another_scene_an_error() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = random_scene(200, 0, 38);
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let camera = splat::Camera::pinhole(&camera(UVec2::new(40, 30)));
    let settings = SplatSettings::default();
    for mut headless in both_ways(device) {
        let mut render = |n: usize| {
            let word = StrokeWord { seed: 0, protection: 0.0, share: 1.0 }.packed();
            let bare = Strokes { words: vec![word; n], ..Strokes::default() };
            let bare = headless.store().upload(device, queue, &bare).unwrap();
            let colors = CloudColors::Captured.with_strokes(&bare, StrokeKnobs::default());
            let plain =
                headless.render(device, queue, &camera, &[cloud(&on_gpu, CloudColors::Captured)], &settings);
            let painted = headless.render(device, queue, &camera, &[cloud(&on_gpu, colors)], &settings);
            (plain.unwrap(), painted)
        };
        let (plain, bare) = render(200);
        assert!(psnr(&bare.unwrap().rgba, &plain.rgba) > 80.0);
        let (_, error) = render(0);
        let expected = SplatError::Strokes { cloud: 0, found: 0, expected: 200 };
        assert!(matches!(error, Err(HeadlessError::Splat(error)) if error == expected));
    }
    let empty = GpuScene::new(device, &Scene::default()).unwrap();
    let mut headless = Headless::new(device);
    let none = headless.store().upload(device, queue, &Strokes::default()).unwrap();
    let colors = CloudColors::Captured.with_strokes(&none, StrokeKnobs::default());
    let picture = headless.render(device, queue, &camera, &[cloud(&empty, colors)], &settings).unwrap();
    assert!(picture.rgba.iter().all(|pixel| *pixel == [0.0; 4]));
}

/// `n` flat Gaussians in the surfaces of a sphere and a floor, with strokes of about `texels` texels to a
/// pixel.
fn surfaces(n: usize, texels: f32) -> (Scene, Strokes) {
    let mut random = pictures::randoms(39);
    let (mut all, mut seeds) = (Vec::new(), Vec::new());
    for i in 0..n {
        let (u, v) = (random(), random());
        let (mean, normal, area) = if i % 2 == 0 {
            let (z, a) = (2.0 * u - 1.0, std::f32::consts::TAU * v);
            let r = (1.0 - z * z).sqrt();
            let normal = Vec3::new(r * a.cos(), z, r * a.sin());
            (normal + Vec3::Y, normal, 12.57)
        } else {
            (Vec3::new(8.0 * u - 4.0, 0.0, 8.0 * v - 4.0), Vec3::Y, 64.0)
        };
        let size = 0.8 * (area / (0.5 * n as f32)).sqrt();
        all.push((mean, Quat::from_rotation_arc(Vec3::Z, normal), size * Vec3::new(1.0, 1.0, 0.1)));
        if i % 8 < 2 {
            let right = normal.any_orthonormal_vector();
            let (down, place) = (normal.cross(right), 1024.0 * Vec2::new(random(), random()));
            let pitch = Vec2::splat(90.0 * texels);
            let seed = PlainSeed { at: mean, right, down, pitch, place, fine: 1.0, wide: 0.7, texture: 0 };
            seeds.push(seed.packed());
        }
    }
    let word = |i: usize| StrokeWord { seed: (i / 8 * 2 + i % 2) as u32, protection: 0.2, share: 1.0 };
    let words = (0..n).map(|i| word(i).packed()).collect();
    let mut scene = Scene {
        means: all.iter().map(|one| one.0).collect(),
        rotations: all.iter().map(|one| one.1).collect(),
        scales: all.iter().map(|one| one.2).collect(),
        opacities: vec![0.9; n],
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    scene.set_colors(&vec![[0.5; 3]; n]);
    (scene, Strokes { seeds, words, textures: vec![texture(9)] })
}

/// 100,000 Gaussians at 512 x 512, plain and with strokes in turns, while the camera moves.
#[test]
#[ignore = "a measurement, which other programs on the machine disturb"]
fn strokes_take_little_more() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let n: usize = std::env::var("N").ok().and_then(|n| n.parse().ok()).unwrap_or(100_000);
    for texels in [1.5, 0.2] {
        let (scene, painting) = surfaces(n, texels);
        let on_gpu = GpuScene::new(device, &scene).unwrap();
        let mut headless = Headless::new(device);
        let uploaded = headless.store().upload(device, queue, &painting).unwrap();
        let mut times = [Vec::new(), Vec::new()];
        for frame in 0..13 {
            let eye = Vec3::new(5.0 * (0.02 * frame as f32).sin(), 2.5, 5.0 * (0.02 * frame as f32).cos());
            let camera = Camera::look_at(eye, Vec3::new(0.0, 0.8, 0.0), Vec3::Y, 0.9, UVec2::splat(512));
            let (camera, plain) = (splat::Camera::pinhole(&camera), CloudColors::Captured);
            for (times, colors) in
                times.iter_mut().zip([plain, plain.with_strokes(&uploaded, StrokeKnobs::default())])
            {
                let start = Instant::now();
                headless
                    .render(device, queue, &camera, &[cloud(&on_gpu, colors)], &SplatSettings::default())
                    .unwrap();
                times.push(start.elapsed().as_secs_f64());
            }
        }
        let [plain, painted] = times.map(|mut times| {
            times.drain(..4);
            times.sort_by(f64::total_cmp);
            1e3 * times[times.len() / 2]
        });
        eprintln!(
            "{texels} texels: plain {plain:.1} ms, painted {painted:.1} ms, ratio {:.2}",
            painted / plain
        );
    }
}
