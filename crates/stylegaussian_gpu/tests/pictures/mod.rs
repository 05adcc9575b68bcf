//! Random scenes for the tests of the splat pass, pictures of both rasterizers, and their difference.

#![allow(dead_code, reason = "each test file uses a part")]

use glam::{Affine3A, Quat, UVec2, Vec3};
use stylegaussian::{
    Camera, Scene,
    scene::Sh,
    sh::n_coefficients,
    splat::{Colors, RenderedImage, render},
};
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::HeadlessDevice,
    splat::{self, Cloud, CloudColors, GpuScene, Headless, Picture, SplatSettings},
};

/// Pseudo-random numbers in 0..1 (a linear congruential generator).
pub fn randoms(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// Overlapping splats of all shapes and opacities, some of them outside the picture or behind the camera.
pub fn random_scene(n: usize, sh_degree: u8, seed: u64) -> Scene {
    let mut random = randoms(seed);
    let mut scene = Scene::default();
    for i in 0..n {
        scene.means.push(Vec3::new(4.0 * random() - 2.0, 4.0 * random() - 2.0, 5.0 * random() - 0.5));
        scene.scales.push(0.01 + 0.3 * Vec3::new(random(), random(), random()).powf(3.0));
        let axis = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
        scene.rotations.push(Quat::from_axis_angle(axis.normalize(), 6.0 * random()));
        scene.opacities.push(random());
        scene.order.push(i as u32);
    }
    let n_values = n * 3 * n_coefficients(sh_degree);
    let coefficients = (0..n_values).map(|_| 2.0 * random() - 1.0).collect();
    scene.sh = Some(Sh { degree: sh_degree, coefficients });
    scene.n_source = n;
    scene
}

/// A scene of unrotated Gaussians given as (mean, scales, opacity).
pub fn scene(gaussians: &[(Vec3, Vec3, f32)]) -> Scene {
    Scene {
        means: gaussians.iter().map(|g| g.0).collect(),
        scales: gaussians.iter().map(|g| g.1).collect(),
        opacities: gaussians.iter().map(|g| g.2).collect(),
        rotations: vec![Quat::IDENTITY; gaussians.len()],
        order: (0..gaussians.len() as u32).collect(),
        n_source: gaussians.len(),
        ..Default::default()
    }
}

/// A camera outside the random scenes that sees a part of them.
pub fn camera(size: UVec2) -> Camera {
    Camera::look_at(Vec3::new(0.3, -0.2, -1.5), Vec3::new(0.0, 0.1, 2.0), Vec3::NEG_Y, 1.0, size)
}

/// The GPU's picture of clouds, drawn by the adapter's fastest way. Each cloud has its captured colors or the
/// given ones. The picture by quads must agree to the promised 45 dB.
#[track_caller]
pub fn draw(
    gpu: &HeadlessDevice,
    camera: &splat::Camera,
    clouds: &[(&Scene, Colors, Affine3A)],
    settings: &SplatSettings,
) -> Picture {
    let [picture, by_quads] = draw_both_ways(gpu, camera, clouds, settings);
    let psnr = psnr(&picture.rgba, &by_quads.rgba);
    assert!(psnr >= 45.0, "{psnr:.1} dB from what quads draw");
    picture
}

/// Two pictures of the same: by the adapter's fastest way, and by quads.
pub fn draw_both_ways(
    gpu: &HeadlessDevice,
    camera: &splat::Camera,
    clouds: &[(&Scene, Colors, Affine3A)],
    settings: &SplatSettings,
) -> [Picture; 2] {
    let HeadlessDevice { device, queue, .. } = gpu;
    let scenes: Vec<_> = clouds.iter().map(|(scene, ..)| GpuScene::new(device, scene).unwrap()).collect();
    let colors: Vec<_> = clouds
        .iter()
        .map(|&(_, colors, _)| match colors {
            Colors::Captured => None,
            Colors::Rgb(rgb) => Some(GaussianColors::from_rgb(device, queue, rgb).unwrap()),
            Colors::Mixed(mixed) => Some(GaussianColors::from_premultiplied(device, queue, mixed).unwrap()),
        })
        .collect();
    let clouds: Vec<Cloud> = (0..clouds.len())
        .map(|i| Cloud {
            scene: &scenes[i],
            colors: colors[i].as_ref().map_or(CloudColors::Captured, CloudColors::Rgb),
            world_from_scene: clouds[i].2,
            visibility: None,
        })
        .collect();
    let ways = [Headless::new(device), Headless::by_quads(device)];
    ways.map(|mut way| way.render(device, queue, camera, &clouds, settings).unwrap())
}

/// The GPU's picture of one scene in its own place.
pub fn draw_scene(gpu: &HeadlessDevice, scene: &Scene, colors: Colors, camera: &Camera) -> Picture {
    let settings = SplatSettings { near: camera.near, ..SplatSettings::default() };
    let camera = splat::Camera::pinhole(camera);
    draw(gpu, &camera, &[(scene, colors, Affine3A::IDENTITY)], &settings)
}

/// The CPU's picture in the format of the GPU's.
pub fn rgba(view: &RenderedImage) -> Vec<[f32; 4]> {
    view.color.iter().zip(&view.alpha).map(|(&[r, g, b], &alpha)| [r, g, b, alpha]).collect()
}

/// Peak signal-to-noise ratio in decibels over all four channels, for a peak of 1.
pub fn psnr(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    let sum: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (sum / (4 * a.len()) as f64).log10()
}

/// Draws a scene on the CPU and on the GPU, and compares.
#[track_caller]
pub fn check(gpu: &HeadlessDevice, what: &str, scene: &Scene, colors: Colors, camera: &Camera, least: f64) {
    let expected = rgba(&render(scene, colors, camera));
    let covered = expected.iter().filter(|pixel| pixel[3] > 0.5).count();
    assert!(2 * covered > expected.len(), "{what}: only {covered} pixels are covered");
    let found = draw_scene(gpu, scene, colors, camera);
    let psnr = psnr(&found.rgba, &expected);
    println!("{what}: {psnr:.1} dB");
    assert!(psnr >= least, "{what}: {psnr:.1} dB, expected {least}");
}
