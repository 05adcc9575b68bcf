//! Splats that weak GPUs leave out: what remains equals the picture of what remains, and how far it is from the
//! whole.

mod pictures;
mod target;

use std::{f32::consts::TAU, path::Path};

use glam::{Affine3A, Mat2, UVec2, Vec2, Vec3};
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

/// Where a point is seen, in pixels from the image axis of a pinhole.
fn pixel(camera: &Camera, point: Vec3) -> Vec2 {
    let seen = camera.view_from_world.transform_point3(point);
    camera.focal * seen.truncate() / seen.z
}

/// The axes of a Gaussian on screen, in pixels: derivatives by differences. Its covariance is the sum of their
/// outer products.
fn axes(scene: &Scene, camera: &Camera, i: usize) -> [Vec2; 3] {
    let mean = scene.means[i];
    let step = 1e-3;
    let along = |axis: Vec3, scale: f32| {
        let axis = scene.rotations[i] * axis;
        scale * (pixel(camera, mean + step * axis) - pixel(camera, mean - step * axis)) / (2.0 * step)
    };
    let Vec3 { x, y, z } = scene.scales[i];
    [along(Vec3::X, x), along(Vec3::Y, y), along(Vec3::Z, z)]
}

/// The radius of a Gaussian on screen, in pixels: the root of the sum of its variances along x and y.
fn radius(scene: &Scene, camera: &Camera, i: usize) -> f32 {
    axes(scene, camera, i).map(Vec2::length_squared).iter().sum::<f32>().sqrt()
}

/// The sum of a splat's alphas, in pixels, over the square of its distance from the axis, in half pictures.
fn sum_over_distance(scene: &Scene, camera: &Camera, i: usize) -> f32 {
    let low_pass = Mat2::from_diagonal(Vec2::splat(0.3));
    let outer = |axis: Vec2| Mat2::from_cols(axis * axis.x, axis * axis.y);
    let covariance = axes(scene, camera, i).into_iter().map(outer).fold(low_pass, |sum, axis| sum + axis);
    let from_axis = 2.0 * pixel(camera, scene.means[i]) / camera.size.as_vec2();
    TAU * scene.opacities[i] * covariance.determinant().sqrt() / from_axis.length_squared()
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
    let adds = |i| sum_over_distance(&scene, &camera, i) >= 40.0;
    check(SplatCuts { least_at_edge: 40.0, ..SplatCuts::default() }, &adds);
}

/// Costs of cuts by radius and at the edge of view on the demo scene, at 320x240 pixels, as the documentation
/// of `SplatCuts` states them.
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
    let all = SplatCuts::default();
    for (cuts, least, most) in [
        (SplatCuts { least_radius: 0.5, ..all }, 70.0, f64::INFINITY),
        (SplatCuts { least_radius: 1.0, ..all }, 40.0, 60.0),
        (SplatCuts { least_at_edge: 4.0, ..all }, 40.0, 60.0),
        (SplatCuts { least_at_edge: 8.0, ..all }, 30.0, 50.0),
    ] {
        let psnr = psnr(&picture(&gpu, &scene, &camera, cuts), &whole);
        println!("{cuts:?}: {psnr:.1} dB");
        assert!(psnr > least && psnr < most, "{cuts:?}: {psnr:.1} dB");
    }
}
