//! Splats of targets with several samples per pixel, where meshes end. They are drawn once or twice per pixel,
//! and equal those that quads draw with as many samples.

mod pictures;
mod target;

use glam::{Affine3A, UVec2, Vec3};
use pictures::{camera, psnr, random_scene};
use stylegaussian_gpu::{
    device::HeadlessDevice,
    splat::{
        Camera, Cloud, CloudColors, EdgeLayers, GpuScene, LAYER_FORMAT, Layer, SplatPass, SplatSettings,
        SplatView,
    },
};
use target::{
    composite_edges, depth_of, edge_layers, gpu, read, resolved, texture, view_of, with_near_plane,
};
use wgpu::TextureFormat::Depth32Float;

/// Samples per pixel of meshes.
const SAMPLES: u32 = 4;
/// Width and height of pictures, in pixels.
const SIZE: UVec2 = UVec2::new(96, 64);

/// A mesh's triangles as corners in normalized device coordinates, reverse z: depth is 0.1 / z.
const MESH: [[f32; 3]; 6] = [
    [-0.9, -0.8, 0.05],
    [0.4, -0.6, 0.04],
    [-0.2, 0.9, 0.025],
    [0.1, -0.9, 0.035],
    [0.95, 0.1, 0.06],
    [0.2, 0.7, 0.03],
];

/// Depth with `samples` samples per pixel, of the first `n` triangles of the mesh.
fn depth_of_mesh(gpu: &HeadlessDevice, samples: u32, n: usize) -> wgpu::Texture {
    depth_of(gpu, SIZE, samples, &MESH[..3 * n])
}

/// A camera with depth 0.1 / z.
fn eye() -> Camera {
    with_near_plane(&camera(SIZE))
}

/// A scene, projected and sorted.
fn sorted(gpu: &HeadlessDevice, splats: &SplatPass) -> SplatView {
    let HeadlessDevice { device, queue, .. } = gpu;
    let scene = GpuScene::new(device, &random_scene(800, 1, 7)).unwrap();
    let (colors, world_from_scene) = (CloudColors::Captured, Affine3A::from_translation(Vec3::Y * 0.1));
    let clouds = [Cloud { scene: &scene, colors, world_from_scene, visibility: None }];
    let (mut view, settings) = (SplatView::new(), SplatSettings::default());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    splats.project_and_sort(&mut gpu.encoding(&mut encoder), &mut view, &eye(), &clouds, &settings).unwrap();
    queue.submit([encoder.finish()]);
    view
}

/// The picture by quads with as many samples as the depth, averaged.
fn by_samples(gpu: &HeadlessDevice, depth: &wgpu::Texture) -> Vec<[f32; 4]> {
    let device = &gpu.device;
    let splats = SplatPass::by_quads(device);
    let view = sorted(gpu, &splats);
    let pipeline = splats.pipeline(device, SAMPLES, Some(Depth32Float));
    let color = texture(device, SIZE.to_array(), LAYER_FORMAT, SAMPLES);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view_of(&color),
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Store,
            },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &view_of(depth),
            depth_ops: None,
            stencil_ops: None,
        }),
        ..Default::default()
    });
    splats.draw(&mut pass, &view, &pipeline);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    read(gpu, &resolved(gpu, &color))
}

/// The layers of the scene among meshes.
fn layers(gpu: &HeadlessDevice, splats: &SplatPass, depth: &wgpu::Texture) -> EdgeLayers {
    edge_layers(gpu, splats, &mut sorted(gpu, splats), &eye(), depth)
}

/// The layers over nothing, in a target of `target_samples` samples, averaged.
fn composited(gpu: &HeadlessDevice, layers: &EdgeLayers, target_samples: u32) -> Vec<[f32; 4]> {
    let target = texture(&gpu.device, SIZE.to_array(), LAYER_FORMAT, target_samples);
    composite_edges(gpu, layers, SAMPLES, &target);
    read(gpu, &resolved(gpu, &target))
}

/// Two triangles, one over the other, among splats: the picture is that of quads with four samples, over
/// targets of four samples and of one, by quads and by the adapter's fastest way. With one depth per pixel it
/// is not.
#[test]
fn meshes_end_sample_by_sample() {
    let Some(gpu) = gpu() else { return };
    let depth = depth_of_mesh(&gpu, SAMPLES, 2);
    let expected = by_samples(&gpu, &depth);
    let without = psnr(&in_single_samples(&gpu, &depth_of_mesh(&gpu, 1, 2)), &expected);
    println!("one sample: {without:.1} dB");
    for splats in [SplatPass::by_quads(&gpu.device), SplatPass::new(&gpu.device)] {
        let layers = layers(&gpu, &splats, &depth);
        for target_samples in [SAMPLES, 1] {
            let found = psnr(&composited(&gpu, &layers, target_samples), &expected);
            println!("{target_samples} samples: {found:.1} dB");
            // Where the triangles and what is behind them share a pixel, one of three surfaces is left out.
            assert!(found > 45.0, "{target_samples} samples: {found:.1} dB");
            assert!(found > without + 6.0, "{found:.1} dB, with one sample {without:.1} dB");
        }
    }
}

/// The picture with one sample per pixel.
fn in_single_samples(gpu: &HeadlessDevice, depth: &wgpu::Texture) -> Vec<[f32; 4]> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let splats = SplatPass::new(device);
    let mut view = sorted(gpu, &splats);
    let color = texture(device, SIZE.to_array(), LAYER_FORMAT, 1);
    let pipeline = splats.pipeline(device, 1, Some(Depth32Float));
    let (of_color, of_depth) = (view_of(&color), view_of(depth));
    let layer = Layer { color: &of_color, depth: Some(&of_depth) };
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    splats.draw_layer(&mut gpu.encoding(&mut encoder), &mut view, &layer, &pipeline);
    queue.submit([encoder.finish()]);
    read(gpu, &color)
}

/// Where no mesh ends, four samples show what one does, to the bit.
#[test]
fn pixels_without_edges_equal_single_samples() {
    let Some(gpu) = gpu() else { return };
    let expected = in_single_samples(&gpu, &depth_of_mesh(&gpu, 1, 0));
    let splats = SplatPass::new(&gpu.device);
    let layers = layers(&gpu, &splats, &depth_of_mesh(&gpu, SAMPLES, 0));
    assert!(composited(&gpu, &layers, SAMPLES) == expected);
    assert!(composited(&gpu, &layers, 1) == expected);
}
