//! The splat pass against its CPU twin, `stylegaussian::splat::render`.

mod pictures;
mod target;

use std::path::Path;

use glam::{Affine3A, Quat, UVec2, Vec2, Vec3};
use pictures::{camera, check, draw, psnr, random_scene, randoms, rgba, scene};
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, render},
};
use stylegaussian_files::read_scene;
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::HeadlessDevice,
    splat::{self, GpuScene, SplatSettings},
};
use target::gpu;

/// The agreement with the CPU that the documentation promises, in decibels.
const LEAST: f64 = 45.0;

/// Degrees 0 to 3, and colors that are not clamped.
#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = gpu() else { return };
    let camera = camera(UVec2::new(160, 120));
    for degree in 0..=3 {
        let scene = random_scene(2000, degree, 7);
        check(&gpu, &format!("degree {degree}"), &scene, Colors::Captured, &camera, LEAST);
    }
    let mut scene = random_scene(2000, 0, 8);
    let mut random = randoms(3);
    let colors: Vec<_> = (0..2000).map(|_| [(); 3].map(|()| 1.6 * random() - 0.3)).collect();
    check(&gpu, "colors", &scene, Colors::Rgb(&colors), &camera, LEAST);
    // Premultiplied: none, some or all of the captured color is left.
    let mixed = |[r, g, b]: [f32; 3], share: f32| [share * r, share * g, share * b, share];
    let mixed: Vec<_> =
        colors.iter().map(|&rgb| mixed(rgb, (2.0 * random() - 0.5).clamp(0.0, 1.0))).collect();
    let view_dependent = random_scene(2000, 3, 8);
    check(&gpu, "captured colors below a look", &view_dependent, Colors::Mixed(&mixed), &camera, LEAST);
    scene.sh = None;
    check(&gpu, "mid-gray", &scene, Colors::Captured, &camera, LEAST);
}

/// In small units the near plane is nearer, and in large ones all stays as it is.
#[test]
fn worlds_of_any_scale_match() {
    let Some(gpu) = gpu() else { return };
    for factor in [1e-4, 1e-2, 1e4] {
        let mut scene = random_scene(500, 1, 10);
        scene.means.iter_mut().for_each(|mean| *mean *= factor);
        scene.scales.iter_mut().for_each(|scales| *scales *= factor);
        let mut camera = camera(UVec2::new(120, 90));
        camera.view_from_world.translation *= factor;
        let camera = camera.near_among(&scene.means);
        let covered = render(&scene, Colors::Captured, &camera).alpha.iter().sum::<f32>();
        assert!(covered > 1000.0, "{factor}: {covered} pixels");
        check(&gpu, &format!("scale {factor}"), &scene, Colors::Captured, &camera, LEAST);
    }
}

/// More tiles, and more splats for each of them, than one invocation of a software adapter has loop iterations
/// for: 14,400 tiles, all of them covered by large splats.
#[test]
fn large_pictures_are_drawn_to_their_last_row() {
    let Some(gpu) = gpu() else { return };
    let camera = splat::Camera::pinhole(&camera(UVec2::new(1280, 720)));
    let mut all = random_scene(3000, 0, 13);
    for i in 0..60 {
        all.means[i] = Vec3::new(0.0, 0.0, 1.0 + 0.05 * i as f32);
        all.scales[i] = Vec3::splat(20.0);
        all.opacities[i] = 0.05;
    }
    let clouds = [(&all, Colors::Captured, Affine3A::IDENTITY)];
    let picture = draw(&gpu, &camera, &clouds, &SplatSettings::default());
    let last_row = &picture.rgba[719 * 1280..];
    assert!(last_row.iter().all(|pixel| pixel[3] > 0.5));
}

/// A part of the demo scene. The whole scene would fill the picture.
#[test]
fn the_demo_scene_matches() {
    let Some(gpu) = gpu() else { return };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo.sgs");
    let demo = read_scene(&path).unwrap().scene;
    let indices: Vec<u32> = (0..demo.len() as u32).step_by(8).collect();
    let scene = demo.subset(&indices);
    let (low, high) = scene.bounds().unwrap();
    let center = (low + high) / 2.0;
    let up = scene.up.unwrap_or(Vec3::Y);
    let aside = up.any_orthonormal_vector();
    let eye = center + (high - low).length() * (0.22 * aside + 0.1 * up);
    let camera = Camera::look_at(eye, center, up, 1.0, UVec2::new(160, 120));
    check(&gpu, "demo", &scene, Colors::Captured, &camera, LEAST);
}

/// The principal point far from the middle, as for one eye of a headset or one screen of a video wall.
#[test]
fn off_axis_projections_match() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(2000, 1, 9);
    let mut camera = camera(UVec2::new(120, 90));
    camera.center = Vec2::new(95.0, 10.0);
    camera.focal = Vec2::new(100.0, 60.0);
    check(&gpu, "off-axis", &scene, Colors::Captured, &camera, LEAST);
}

/// Footprint variance (10 * 0.2 / 2)^2 + 0.3 = 1.3 px^2 on both axes, as in the CPU twin's own test.
#[test]
fn one_splat_at_the_center() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera {
        view_from_world: Affine3A::IDENTITY,
        focal: Vec2::splat(10.0),
        center: Vec2::splat(4.5),
        size: UVec2::splat(9),
        near: Camera::NEAR,
    };
    let one = scene(&[(Vec3::new(0.0, 0.0, 2.0), Vec3::splat(0.2), 0.5)]);
    let picture = pictures::draw_scene(&gpu, &one, Colors::Rgb(&[[1.0, 0.5, -0.25]]), &camera);
    let center = 4 * 9 + 4;
    let beside = 0.5 * (-0.5f32 / 1.3).exp();
    let near = |found: f32, expected: f32| assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    for (found, expected) in picture.rgba[center].into_iter().zip([0.5, 0.25, -0.125, 0.5]) {
        near(found, expected);
    }
    near(picture.rgba[center + 1][3], beside);
    near(picture.rgba[center + 9][3], beside);
    // 3 px away alpha is 0.0157, 4 px away it would be 0.0011.
    near(picture.rgba[center + 3][3], 0.5 * (-4.5f32 / 1.3).exp());
    assert_eq!(picture.rgba[center + 4][3], 0.0);
}

/// A cloud under a rotation, a uniform scale and a translation looks like the scene of the moved Gaussians.
#[test]
fn a_moved_cloud_is_the_scene_of_moved_gaussians() {
    let Some(gpu) = gpu() else { return };
    let still = random_scene(1000, 0, 10);
    let (scale, turn) = (1.3, Quat::from_rotation_z(0.7));
    let world_from_scene =
        Affine3A::from_scale_rotation_translation(Vec3::splat(scale), turn, Vec3::new(0.2, -0.3, 0.4));
    let mut moved = still.clone();
    for i in 0..moved.len() {
        moved.means[i] = world_from_scene.transform_point3(still.means[i]);
        moved.rotations[i] = turn * still.rotations[i];
        moved.scales[i] = scale * still.scales[i];
    }
    let camera = camera(UVec2::new(120, 90));
    let expected = rgba(&render(&moved, Colors::Captured, &camera));
    let clouds = [(&still, Colors::Captured, world_from_scene)];
    let found = draw(&gpu, &splat::Camera::pinhole(&camera), &clouds, &SplatSettings::default());
    let psnr = psnr(&found.rgba, &expected);
    assert!(psnr >= LEAST, "{psnr:.1} dB");
}

/// Two halves of one scene look like that scene, however their Gaussians interleave in depth.
#[test]
fn clouds_interleave() {
    let Some(gpu) = gpu() else { return };
    let whole = random_scene(2000, 1, 11);
    let half = |first: u32| -> Scene { whole.subset(&(first..2000).step_by(2).collect::<Vec<_>>()) };
    let (even, odd) = (half(0), half(1));
    let camera = camera(UVec2::new(120, 90));
    let expected = rgba(&render(&whole, Colors::Captured, &camera));
    let clouds =
        [(&even, Colors::Captured, Affine3A::IDENTITY), (&odd, Colors::Captured, Affine3A::IDENTITY)];
    let found = draw(&gpu, &splat::Camera::pinhole(&camera), &clouds, &SplatSettings::default());
    let psnr = psnr(&found.rgba, &expected);
    assert!(psnr >= LEAST, "{psnr:.1} dB");
}

/// One view over several frames. Some only change colors, and some change nothing.
#[test]
fn a_view_keeps_up_with_what_changes() {
    let Some(gpu) = gpu() else { return };
    let splat_colors = |seed: u64| {
        let mut random = randoms(seed);
        (0..1500).map(|_| [(); 3].map(|()| random())).collect::<Vec<_>>()
    };
    let scene = random_scene(1500, 0, 12);
    let HeadlessDevice { device, queue, .. } = &gpu;
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let colors = GaussianColors::from_rgb(device, queue, &splat_colors(1)).unwrap();
    let mut headless = splat::Headless::new(device);
    let front = camera(UVec2::new(120, 90));
    let mut aside = front.clone();
    aside.view_from_world = front.view_from_world * Affine3A::from_rotation_y(0.5);
    for (camera, seed) in [(&front, 1), (&front, 1), (&front, 2), (&aside, 2), (&aside, 3), (&front, 3)] {
        let rgb = splat_colors(seed);
        colors.write(queue, &rgb);
        let cloud = splat::Cloud {
            scene: &on_gpu,
            colors: splat::CloudColors::Rgb(&colors),
            world_from_scene: Affine3A::IDENTITY,
            visibility: None,
        };
        let settings = SplatSettings::default();
        let found =
            headless.render(device, queue, &splat::Camera::pinhole(camera), &[cloud], &settings).unwrap();
        let again =
            headless.render(device, queue, &splat::Camera::pinhole(camera), &[cloud], &settings).unwrap();
        assert_eq!(found, again);
        let psnr = psnr(&found.rgba, &rgba(&render(&scene, Colors::Rgb(&rgb), camera)));
        assert!(psnr >= LEAST, "{psnr:.1} dB");
    }
}
