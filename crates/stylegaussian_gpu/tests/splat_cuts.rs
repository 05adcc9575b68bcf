//! Splats that weak GPUs leave out: what remains equals the picture of what remains, and how far it is from the
//! whole.

mod pictures;
mod target;

use std::path::Path;

use glam::{Affine3A, UVec2, Vec3};
use pictures::{camera, draw, psnr, random_scene};
use stylegaussian::{Camera, Scene, splat::Colors};
use stylegaussian_files::read_scene;
use stylegaussian_gpu::{
    device::HeadlessDevice,
    splat::{self, SplatCuts, SplatSettings},
};
use target::gpu;

fn picture(gpu: &HeadlessDevice, scene: &Scene, camera: &Camera, cuts: SplatCuts) -> Vec<[f32; 4]> {
    let settings = SplatSettings { near: camera.near, cuts, ..SplatSettings::default() };
    let camera = splat::Camera::pinhole(camera);
    draw(gpu, &camera, &[(scene, Colors::Captured, Affine3A::IDENTITY)], &settings).rgba
}

/// The radius of a Gaussian on screen, in pixels: the root of the sum of its variances along x and y.
/// Derivatives by differences, of a pinhole.
fn radius(scene: &Scene, camera: &Camera, i: usize) -> f32 {
    let pixel = |mean: Vec3| {
        let seen = camera.view_from_world.transform_point3(mean);
        camera.focal * seen.truncate() / seen.z
    };
    let mean = scene.means[i];
    let step = 1e-3;
    let along = |axis: Vec3, scale: f32| {
        let axis = scene.rotations[i] * axis;
        scale * (pixel(mean + step * axis) - pixel(mean - step * axis)).length() / (2.0 * step)
    };
    let Vec3 { x, y, z } = scene.scales[i];
    Vec3::new(along(Vec3::X, x), along(Vec3::Y, y), along(Vec3::Z, z)).length()
}

/// What is left out is missing, and nothing else.
#[test]
fn what_is_left_out_is_missing() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(1500, 1, 61);
    let camera = camera(UVec2::new(96, 72));
    let whole = picture(&gpu, &scene, &camera, SplatCuts::default());
    let check = |cuts: SplatCuts, is_left: &dyn Fn(usize) -> bool| {
        let is_ahead = |i: &usize| camera.view_from_world.transform_point3(scene.means[*i]).z > camera.near;
        let left: Vec<u32> =
            (0..scene.len()).filter(is_ahead).filter(|&i| is_left(i)).map(|i| i as u32).collect();
        assert!((200..1200).contains(&left.len()), "{} left", left.len());
        let expected = picture(&gpu, &scene.subset(&left), &camera, SplatCuts::default());
        let found = picture(&gpu, &scene, &camera, cuts);
        let (same, changed) = (psnr(&found, &expected), psnr(&found, &whole));
        assert!(same > 60.0 && changed < 40.0, "{cuts:?}: {same:.1} dB, {changed:.1} dB from the whole");
    };
    // Radii of a wide part of the picture are linearized elsewhere; here all are near the middle.
    check(SplatCuts { least_radius: 4.0, ..SplatCuts::default() }, &|i| radius(&scene, &camera, i) >= 4.0);
    check(SplatCuts { least_opacity: 0.4, ..SplatCuts::default() }, &|i| scene.opacities[i] >= 0.4);
}

/// What the cut by radius costs on the demo scene, at 320x240 pixels: what the documentation of `SplatCuts`
/// states.
#[test]
fn cuts_cost_what_is_documented() {
    let Some(gpu) = gpu() else { return };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo.sgs");
    let scene = read_scene(&path).unwrap().scene;
    let (low, high) = scene.bounds().unwrap();
    let center = (low + high) / 2.0;
    let up = scene.up.unwrap_or(Vec3::Y);
    let eye = center + (high - low).length() * (0.3 * up.any_orthonormal_vector() + 0.1 * up);
    let camera = Camera::look_at(eye, center, up, 1.0, UVec2::new(320, 240));
    let whole = picture(&gpu, &scene, &camera, SplatCuts::default());
    for (least_radius, least, most) in [(0.5, 70.0, f64::INFINITY), (1.0, 40.0, 60.0)] {
        let cut = picture(&gpu, &scene, &camera, SplatCuts { least_radius, ..SplatCuts::default() });
        let psnr = psnr(&cut, &whole);
        println!("radius {least_radius}: {psnr:.1} dB");
        assert!(psnr > least && psnr < most, "radius {least_radius}: {psnr:.1} dB");
    }
}
