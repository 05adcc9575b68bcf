//! Pictures of two eyes that share their order and colors, against pictures of views by themselves.

mod pictures;
mod target;

use std::path::Path;

use glam::{Affine3A, Mat4, UVec4, Vec3};
use pictures::psnr;
use stylegaussian::Scene;
use stylegaussian_files::read_scene;
use stylegaussian_gpu::{
    device::HeadlessDevice,
    splat::{Camera, Cloud, CloudColors, GpuScene, LAYER_FORMAT, Layer, SplatPass, SplatSettings, SplatView},
};
use target::{gpu, read, texture};

/// Width and height of either picture, in pixels.
const SIZE: [u32; 2] = [160, 120];

/// A part of the demo scene.
fn demo() -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo.sgs");
    let demo = read_scene(&path).unwrap().scene;
    let indices: Vec<u32> = (0..demo.len() as u32).step_by(8).collect();
    demo.subset(&indices)
}

/// Eyes a thirtieth of the distance to the scene's middle apart, which both see at the same place of their
/// pictures.
fn eyes(scene: &Scene) -> [Camera; 2] {
    let (low, high) = scene.bounds().unwrap();
    let center = (low + high) / 2.0;
    let up = scene.up.unwrap_or(Vec3::Y);
    let aside = up.any_orthonormal_vector();
    let distance = 0.25 * (high - low).length();
    let eye = center + distance * (0.9 * aside + 0.4 * up).normalize();
    let head = Affine3A::look_at_rh(eye, center, up).inverse();
    [-0.5, 0.5].map(|side: f32| {
        let mut clip_from_view = Mat4::perspective_infinite_reverse_rh(1.0, 160.0 / 120.0, 0.1);
        // The tangent to the middle, in half pictures.
        clip_from_view.z_axis.x = -side / 30.0 * clip_from_view.x_axis.x;
        Camera {
            world_from_view: head * Affine3A::from_translation(side * distance / 30.0 * Vec3::X),
            clip_from_view,
            viewport: UVec4::new(0, 0, SIZE[0], SIZE[1]),
        }
    })
}

/// The picture of a view that is projected and sorted.
fn picture(gpu: &HeadlessDevice, pass: &SplatPass, view: &mut SplatView) -> Vec<[f32; 4]> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let color = texture(device, SIZE, LAYER_FORMAT, 1);
    let of_color = color.create_view(&wgpu::TextureViewDescriptor::default());
    let layer = Layer { color: &of_color, depth: None };
    let pipeline = pass.pipeline(device, 1, None);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    pass.draw_layer(&mut gpu.encoding(&mut encoder), view, &layer, &pipeline);
    queue.submit([encoder.finish()]);
    read(gpu, &color)
}

/// Off-axis eyes see what cameras at their places see, by quads and by the adapter's fastest way.
#[test]
fn eyes_see_what_their_cameras_see() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = demo();
    let cameras = eyes(&scene);
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let (colors, world_from_scene) = (CloudColors::Captured, Affine3A::IDENTITY);
    let clouds = [Cloud { scene: &on_gpu, colors, world_from_scene, visibility: None }];
    let settings = SplatSettings::default();
    for pass in [SplatPass::by_quads(device), SplatPass::new(device)] {
        let mut views = [SplatView::new(), SplatView::new()];
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let of_views = views.each_mut();
        pass.project_and_sort_eyes(
            &mut gpu.encoding(&mut encoder),
            of_views,
            cameras.each_ref(),
            &clouds,
            &settings,
        )
        .unwrap();
        queue.submit([encoder.finish()]);
        let found = views.map(|mut view| picture(&gpu, &pass, &mut view));
        let expected = cameras.each_ref().map(|camera| {
            let mut view = SplatView::new();
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            pass.project_and_sort(&mut gpu.encoding(&mut encoder), &mut view, camera, &clouds, &settings)
                .unwrap();
            queue.submit([encoder.finish()]);
            picture(&gpu, &pass, &mut view)
        });
        for (found, expected) in found.iter().zip(&expected) {
            let psnr = psnr(found, expected);
            println!("{psnr:.1} dB");
            assert!(psnr > 45.0, "{psnr:.1} dB from the picture of its own camera");
        }
        let between = psnr(&expected[0], &expected[1]);
        assert!(between < 35.0, "{between:.1} dB between the eyes, which see the same");
    }
}
