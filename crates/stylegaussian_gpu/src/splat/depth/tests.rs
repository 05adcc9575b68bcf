//! Iso depths against the CPU twin's, by each way, and what is written into depth attachments.

use glam::{Affine3A, UVec2, Vec3};
use stylegaussian::{
    Scene,
    splat::{ISO_THRESHOLD, iso_depth},
};

use super::*;
use crate::{
    device::HeadlessDevice,
    splat::{
        Camera, Cloud, CloudColors, GpuScene, Layer, SplatPass, SplatSettings,
        testing::{drawn_depths, gpu, random_splats, read},
    },
};

const SIZE: UVec2 = UVec2::new(77, 53);

/// Splats of all shapes and opacities: faint ones, which have no core, and opaque ones.
fn random_scene(n: usize) -> Scene {
    random_splats(n, Vec3::new(-2.0, -2.0, -0.5), Vec3::new(4.0, 4.0, 5.0), 0.3)
}

fn pinhole() -> stylegaussian::Camera {
    let (eye, at) = (Vec3::new(0.3, -0.2, -1.5), Vec3::new(0.0, 0.1, 2.0));
    stylegaussian::Camera::look_at(eye, at, Vec3::NEG_Y, 1.0, SIZE)
}

/// The view of a scene, projected and sorted, and an encoder that has that encoded.
fn sorted(
    gpu: &HeadlessDevice,
    pass: &SplatPass,
    view: &mut SplatView,
    camera: &Camera,
    scene: &GpuScene,
) -> wgpu::CommandEncoder {
    let device = &gpu.device;
    let cloud = Cloud {
        scene,
        colors: CloudColors::Captured,
        world_from_scene: Affine3A::IDENTITY,
        visibility: None,
    };
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let settings = SplatSettings::default();
    pass.project_and_sort(&mut gpu.encoding(&mut encoder), view, camera, &[cloud], &settings).unwrap();
    encoder
}

/// Depths as distances along the axis, infinite where there is none. The camera's depths are `near` over them.
fn distances(depths: &[f32], near: f32) -> Vec<f32> {
    depths.iter().map(|&depth| if depth > 0.0 { near / depth } else { f32::INFINITY }).collect()
}

/// Share of the pixels that disagree on whether there is a surface; relative errors of the others, ascending.
fn errors(found: &[f32], expected: &[f32]) -> (f32, Vec<f32>) {
    let pairs = || found.iter().zip(expected);
    let n_wrong = pairs().filter(|(f, e)| f.is_finite() != e.is_finite()).count();
    let both = pairs().filter(|(f, e)| f.is_finite() && e.is_finite());
    let mut errors: Vec<f32> = both.map(|(f, e)| (f / e - 1.0).abs()).collect();
    errors.sort_by(f32::total_cmp);
    (n_wrong as f32 / found.len() as f32, errors)
}

/// Scenes with surfaces everywhere, and here and there; several thresholds, one after the other in one view.
#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let camera = Camera::pinhole(&pinhole());
    let near = camera.clip_from_view.w_axis.z;
    for (pass, by_quads) in [(SplatPass::new(device), false), (SplatPass::by_quads(device), true)] {
        let is_exact = pass.tiles.is_some() && !by_quads;
        for n in [2000, 500] {
            let scene = random_scene(n);
            let on_gpu = GpuScene::new(device, &scene).unwrap();
            let (mut view, mut iso) = (SplatView::new(), IsoDepth::new());
            for threshold in [ISO_THRESHOLD, 0.3, 0.9] {
                let mut encoder = sorted(&gpu, &pass, &mut view, &camera, &on_gpu);
                pass.find_depth(&mut gpu.encoding(&mut encoder), &mut view, threshold, &mut iso);
                queue.submit([encoder.finish()]);
                let found = distances(&read(&gpu, iso.buffer().unwrap()), near);
                let expected = iso_depth(&scene, &pinhole(), threshold, None);
                let (wrong, errors) = errors(&found, &expected);
                let mean = errors.iter().sum::<f32>() / errors.len() as f32;
                let most = errors[errors.len() * 95 / 100];
                eprintln!(
                    "exact {is_exact}, {n} splats, {threshold}: {wrong} wrong, {mean} mean, {most} most"
                );
                assert!(errors.len() > 300, "only {} pixels have a depth", errors.len());
                // Opacities are rounded to f16, so a light that is almost the threshold may be on either side.
                assert!(wrong < 0.003, "{n} splats, {threshold}: {wrong} wrong");
                // Slices are as thick as these clouds are deep; a capture's surfaces are thin.
                let (mean_limit, limit) = if is_exact { (0.002, 1e-3) } else { (0.05, 0.12) };
                assert!(mean < mean_limit && most < limit, "{n} splats, {threshold}: {mean}, {most}");
            }
        }
    }
}

/// A depth attachment of several samples, cleared to `wall`, with iso depths written into it; and its depths
/// where they are single.
fn written(gpu: &HeadlessDevice, pass: &SplatPass, iso: &IsoDepth, size: UVec2, wall: f32) -> Vec<f32> {
    let [_, depths] = [4, 1].map(|samples| {
        let pipeline = pass.depth_pipeline(&gpu.device, samples, wgpu::TextureFormat::Depth32Float);
        drawn_depths(gpu, (size, samples), wall, |render| pass.write_depth(render, iso, &pipeline))
    });
    depths
}

/// Two viewports of one target, one after the other. Outside of the viewport nothing is written, and before a
/// wall only what is nearer.
#[test]
fn depths_are_written_before_walls_and_within_the_viewport() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::new(device, &random_scene(500)).unwrap();
    let size = SIZE + UVec2::new(20, 10);
    for pass in [SplatPass::new(device), SplatPass::by_quads(device)] {
        let (mut view, mut iso) = (SplatView::new(), IsoDepth::new());
        for corner in [UVec2::ZERO, UVec2::new(13, 9)] {
            let mut camera = Camera::pinhole(&pinhole());
            camera.viewport = UVec4::new(corner.x, corner.y, SIZE.x, SIZE.y);
            let wall = camera.clip_from_view.w_axis.z / 2.5;
            let mut encoder = sorted(&gpu, &pass, &mut view, &camera, &scene);
            pass.find_depth(&mut gpu.encoding(&mut encoder), &mut view, ISO_THRESHOLD, &mut iso);
            queue.submit([encoder.finish()]);
            let found = written(&gpu, &pass, &iso, size, wall);
            let depths: Vec<f32> = read(&gpu, iso.buffer().unwrap());
            let mut n_nearer = 0;
            for (i, &found) in found.iter().enumerate() {
                let at = UVec2::new(i as u32 % size.x, i as u32 / size.x);
                let inside = at.cmpge(corner).all() && (at - corner.min(at)).cmplt(SIZE).all();
                let place = at - corner.min(at);
                let expected =
                    if inside { depths[(place.y * SIZE.x + place.x) as usize].max(wall) } else { wall };
                assert!((found - expected).abs() <= 1e-7, "{at}: found {found}, expected {expected}");
                n_nearer += usize::from(found > wall);
            }
            assert!((200..3000).contains(&n_nearer), "{n_nearer} pixels are nearer than the wall");
        }
    }
}

/// A view that does not ask for depth makes nothing of it. One that asks twice finds it once, and one that
/// shows nothing has none.
#[test]
fn depth_is_free_unless_it_is_asked_for() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::new(device, &random_scene(100)).unwrap();
    let (pass, camera) = (SplatPass::new(device), Camera::pinhole(&pinhole()));
    let (mut view, mut iso) = (SplatView::new(), IsoDepth::new());
    let color = pass.layer(device, SIZE);
    let pipeline = pass.pipeline(device, 1, None);
    let mut encoder = sorted(&gpu, &pass, &mut view, &camera, &scene);
    let layer = Layer { color: &color, depth: None };
    pass.draw_layer(&mut gpu.encoding(&mut encoder), &mut view, &layer, &pipeline);
    assert!(pass.depth.get().is_none());
    pass.find_depth(&mut gpu.encoding(&mut encoder), &mut view, ISO_THRESHOLD, &mut iso);
    queue.submit([encoder.finish()]);
    let found = iso.found.clone().unwrap();
    let encoder = sorted(&gpu, &pass, &mut view, &camera, &scene);
    queue.submit([encoder.finish()]);
    assert_eq!((found.threshold, found.order), (ISO_THRESHOLD, view.order()), "a still view is found once");
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let settings = SplatSettings::default();
    pass.project_and_sort(&mut gpu.encoding(&mut encoder), &mut view, &camera, &[], &settings).unwrap();
    pass.find_depth(&mut gpu.encoding(&mut encoder), &mut view, ISO_THRESHOLD, &mut iso);
    assert!(iso.buffer().is_none(), "nothing is shown");
}
