//! Helpers of this module's tests: a device, buffers and depths read back, random numbers and scenes.

use glam::{Quat, UVec2, Vec3};
use stylegaussian::{Scene, scene::Sh, sh::n_coefficients};

use crate::{
    buffers,
    device::{DeviceError, DeviceOptions, HeadlessDevice},
};

/// A device, or `None` with a message if there is none.
pub fn gpu() -> Option<HeadlessDevice> {
    match pollster::block_on(HeadlessDevice::request(DeviceOptions::default())) {
        Ok(gpu) => Some(gpu),
        Err(DeviceError::NoAdapter(_)) => {
            eprintln!("SKIPPED: no GPU adapter");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// The contents of a buffer that can be copied from.
pub fn read<T: bytemuck::Pod>(gpu: &HeadlessDevice, buffer: &wgpu::Buffer) -> Vec<T> {
    buffers::read(&gpu.device, &gpu.queue, buffer, |bytes| bytemuck::pod_collect_to_vec(bytes)).unwrap()
}

/// The depths `[H, W]` of an attachment that was cleared to `wall` and then drawn into. Those of several
/// samples are not read.
pub fn drawn_depths(
    gpu: &HeadlessDevice,
    (size, samples): (UVec2, u32),
    wall: f32,
    draw: impl FnOnce(&mut wgpu::RenderPass),
) -> Vec<f32> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Depth32Float,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let depth_ops = Some(wgpu::Operations { load: wgpu::LoadOp::Clear(wall), store: wgpu::StoreOp::Store });
    let attachment = wgpu::RenderPassDepthStencilAttachment { view: &view, depth_ops, stencil_ops: None };
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        depth_stencil_attachment: Some(attachment),
        ..Default::default()
    });
    draw(&mut pass);
    drop(pass);
    let row = (4 * size.x).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = buffers::create(device, "depths", u64::from(row * size.y), usage);
    if samples == 1 {
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    }
    queue.submit([encoder.finish()]);
    let rows: Vec<f32> = read(gpu, &buffer);
    rows.chunks_exact(row as usize / 4).flat_map(|row| &row[..size.x as usize]).copied().collect()
}

/// Splats of all shapes and opacities, with means in a box and scales of at most about `largest`.
pub fn random_splats(n: usize, corner: Vec3, extent: Vec3, largest: f32) -> Scene {
    let mut random = randoms(n as u64);
    let mut scene = Scene::default();
    for i in 0..n {
        scene.means.push(corner + extent * Vec3::new(random(), random(), random()));
        scene.scales.push(0.01 + largest * Vec3::new(random(), random(), random()).powf(3.0));
        scene.rotations.push(random_rotation(&mut random));
        scene.opacities.push(random());
        scene.order.push(i as u32);
    }
    scene.n_source = n;
    scene
}

/// Gaussians around the origin, in and out of sight, many of them small and faint.
pub fn random_scene(n: usize, degree: u8, seed: u64) -> Scene {
    let mut random = randoms(seed);
    let mut scene = Scene::default();
    for _ in 0..n {
        scene.means.push(8.0 * Vec3::new(random(), random(), random()) - 4.0);
        scene.scales.push(0.003 + 0.4 * Vec3::new(random(), random(), random()).powf(4.0));
        scene.rotations.push(random_rotation(&mut random));
        scene.opacities.push(random().powi(2));
    }
    let coefficients = (0..n * 3 * n_coefficients(degree)).map(|_| random() - 0.5).collect();
    scene.sh = Some(Sh { degree, coefficients });
    scene
}

fn random_rotation(random: &mut impl FnMut() -> f32) -> Quat {
    let axis = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
    Quat::from_axis_angle(axis.normalize(), 6.0 * random())
}

/// Pseudo-random numbers in 0..1 (a linear congruential generator).
pub fn randoms(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}
