//! Shadow maps against the CPU twin's, and against depths worked out by hand.

use glam::{Affine3A, Mat4, Quat, UVec2, Vec3};
use stylegaussian::{
    Scene,
    mask::{MaskUse, Visibility},
    scene::ScreenFilter,
    splat::cast,
};

use super::*;
use crate::{
    device::HeadlessDevice,
    mask::GaussianMask,
    splat::{
        Camera, CloudColors, CloudVisibility, GpuScene, SplatPass,
        testing::{drawn_depths, gpu, random_splats, randoms},
    },
};

const SIZE: UVec2 = UVec2::new(77, 53);

/// Splats of all shapes and opacities, some of them before the light.
fn random_scene(n: usize) -> Scene {
    random_splats(n, Vec3::new(-2.0, -2.0, -0.5), Vec3::new(4.0, 4.0, 5.0), 0.3)
}

fn cloud(scene: &GpuScene) -> Cloud<'_> {
    let world_from_scene = Affine3A::IDENTITY;
    Cloud { scene, colors: CloudColors::Captured, world_from_scene, visibility: None }
}

/// The depths in a shadow map of [`SIZE`] that was cleared to `wall`, with the casters of `view` in it.
fn drawn(gpu: &HeadlessDevice, pass: &SplatPass, view: &CastView, wall: f32) -> Vec<f32> {
    drawn_depths(gpu, (SIZE, 1), wall, |render| pass.cast(render, view))
}

/// Scenes with both filters, in one chunk and in several, without a mask and with one; a wall hides what is
/// behind it.
#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let (eye, at) = (Vec3::new(0.3, -0.2, -1.5), Vec3::new(0.0, 0.1, 2.0));
    let pinhole = stylegaussian::Camera::look_at(eye, at, Vec3::NEG_Y, 1.0, SIZE);
    let camera = Camera::pinhole(&pinhole);
    // The camera's depths are `near` over distances.
    let near = camera.clip_from_view.w_axis.z;
    let mut random = randoms(9);
    let (pass, mut view) = (SplatPass::new(device), CastView::new());
    for (n, threshold, filter) in [
        (600, 0.5, ScreenFilter::Classic),
        (600, 0.2, ScreenFilter::Antialiased),
        (500, 0.6, ScreenFilter::Classic),
    ] {
        let scene = Scene { filter, ..random_scene(n) };
        let on_gpu = GpuScene::in_chunks(device, &scene, 250);
        let weights: Vec<_> = (0..n).map(|_| [0, 0, (255.0 * random()) as u8, 0]).collect();
        let mask = GaussianMask::new(device, queue, &weights).unwrap();
        for is in [None, Some(MaskUse::Hide), Some(MaskUse::Crop)] {
            let visibility = is.map(|is| CloudVisibility { mask: &mask, channel: 2, is });
            let caster = Caster { cloud: Cloud { visibility, ..cloud(&on_gpu) }, threshold };
            let light = (&camera, SplatSettings::default().near);
            pass.write_casters(device, queue, &mut view, light, &[caster]).unwrap();
            let wall = 2.5;
            let found = drawn(&gpu, &pass, &view, near / wall);
            let visibility = is.map(|is| Visibility { weights: &weights, channel: 2, is });
            let expected = cast(&scene, &pinhole, threshold, visibility.as_ref());
            // Rounding may decide at the edges of cores.
            let is_wrong = |(found, expected): (&f32, &f32)| (near / found - expected.min(wall)).abs() > 1e-3;
            let n_wrong = found.iter().zip(&expected).filter(|&pair| is_wrong(pair)).count();
            let n_cast = expected.iter().filter(|&&depth| depth < wall).count();
            eprintln!("{n} splats, {threshold}, {is:?}: {n_wrong} of {n_cast} wrong");
            assert!(n_cast > 20, "{n} splats, {threshold}, {is:?}: {n_cast} pixels in shadow");
            assert!(n_wrong < 10, "{n} splats, {threshold}, {is:?}: {n_wrong} pixels are wrong");
        }
    }
}

/// A light with parallel rays along -z, 6 units deep. What lies before its near plane is in that plane, and
/// what lies beyond its far plane is in no shadow map. A light at a point does not see what is behind it.
#[test]
fn what_is_before_a_sun_s_map_casts_its_shadow_into_it() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let mut scene = Scene::default();
    for (x, z) in [(-1.0, -3.0), (0.0, 10.0), (1.0, -7.0)] {
        scene.means.push(Vec3::new(x, 0.0, z));
        scene.scales.push(Vec3::splat(0.3));
        scene.rotations.push(Quat::IDENTITY);
        scene.opacities.push(0.9);
        scene.order.push(scene.order.len() as u32);
    }
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let (pass, mut view) = (SplatPass::new(device), CastView::new());
    let mut depths = |clip_from_view: Mat4| {
        let viewport = UVec4::new(0, 0, SIZE.x, SIZE.y);
        let camera = Camera { world_from_view: Affine3A::IDENTITY, clip_from_view, viewport };
        let caster = Caster { cloud: cloud(&on_gpu), threshold: 0.5 };
        pass.write_casters(device, queue, &mut view, (&camera, 0.2), &[caster]).unwrap();
        let map = drawn(&gpu, &pass, &view, 0.0);
        // The middle row, at x = -1, 0 and 1 of -2..2.
        [SIZE.x / 4, SIZE.x / 2, 3 * SIZE.x / 4].map(|x| map[(SIZE.y / 2 * SIZE.x + x) as usize])
    };
    // Near and far change geometry: reverse z.
    let found = depths(Mat4::orthographic_rh(-2.0, 2.0, -2.0, 2.0, 6.0, 0.0));
    // The core ends 3 + sqrt(2 ln 1.8) 0.3 = 3.325 below.
    assert!((found[0] - (1.0 - 3.325 / 6.0)).abs() < 1e-3 && found[1..] == [1.0, 0.0], "{found:?}");
    let found = depths(Mat4::perspective_infinite_reverse_rh(1.5, 1.0, 0.1));
    assert_eq!(found[1], 0.0, "{found:?}");
}

/// Nothing is made before there is a caster, and nothing anew while nothing changes.
#[test]
fn casting_is_free_unless_it_is_asked_for() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::in_chunks(device, &random_scene(100), 60);
    let (pass, mut view) = (SplatPass::new(device), CastView::new());
    assert!(pass.cast.get().is_none());
    let viewport = UVec4::new(0, 0, SIZE.x, SIZE.y);
    let clip_from_view = Mat4::orthographic_rh(-2.0, 2.0, -2.0, 2.0, 6.0, 0.0);
    let mut camera = Camera { world_from_view: Affine3A::IDENTITY, clip_from_view, viewport };
    let mut write = |camera: &Camera, casters: &[Caster]| {
        pass.write_casters(device, queue, &mut view, (camera, 0.2), casters).unwrap();
        let groups: Vec<_> = view.chunks.iter().map(|chunk| chunk.group.clone()).collect();
        (view.uniforms.clone(), groups)
    };
    let caster = Caster { cloud: cloud(&scene), threshold: 0.5 };
    let first = write(&camera, &[caster]);
    assert_eq!(first.1.len(), 2);
    assert!(write(&camera, &[caster]) == first, "a still map");
    camera.world_from_view.translation.z += 1.0;
    assert!(write(&camera, &[caster]) == first, "a light that moves changes numbers alone");
    assert!(write(&camera, &[]).1.is_empty(), "what is gone is not drawn");
    assert!(pass.cast.get().unwrap().variants[1].get().is_none(), "without a mask, none is compiled");
}
