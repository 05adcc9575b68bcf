//! Both shaders against the CPU twin.

use half::f16;
use stylegaussian::splat::{half_depths, upsampled};
use wgpu::TextureFormat::{Depth32Float, R32Float};

use super::*;
use crate::{
    buffers::{self, Uniforms},
    device::HeadlessDevice,
    splat::testing::{gpu, randoms, read},
};

/// Size of the whole target, and the viewport in it: of an odd width, and beside the corner.
const TARGET: UVec2 = UVec2::new(40, 32);
const VIEWPORT: UVec4 = UVec4::new(5, 3, 31, 22);
/// The depth of pixels without a nearer side.
const NO_SURFACE: f32 = 1.0;

/// A texture for all uses of this module, which holds `bytes` if there are any.
fn texture(gpu: &HeadlessDevice, size: UVec2, format: wgpu::TextureFormat, bytes: &[u8]) -> wgpu::Texture {
    // No copy writes depth.
    let written =
        if format == Depth32Float { wgpu::TextureUsages::empty() } else { wgpu::TextureUsages::COPY_DST };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC
            | written,
        view_formats: &[],
    });
    if !bytes.is_empty() {
        let bytes_per_row = Some(bytes.len() as u32 / size.y);
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None };
        gpu.queue.write_texture(texture.as_image_copy(), bytes, layout, texture.size());
    }
    texture
}

fn view_of(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// A depth texture of the target's size that holds `depths`, written by a shader.
fn depth_of(gpu: &HeadlessDevice, depths: &[f32]) -> wgpu::Texture {
    let numbers = view_of(&texture(gpu, TARGET, R32Float, bytemuck::cast_slice(depths)));
    let wgsl = "
        @group(0) @binding(0) var numbers: texture_2d<f32>;
        @vertex fn plain_vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
            return vec4(vec2(f32(i & 1u), f32(i >> 1u)) * 4.0 - 1.0, 0.0, 1.0);
        }
        @fragment fn plain_fragment(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
            return textureLoad(numbers, vec2<i32>(at.xy), 0).r;
        }";
    let binding = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: false },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let source = Source { label: "plain", wgsl: wgsl.into() };
    let stage = Stage::new(&gpu.device, source, &[binding], &[], Some(written_depth()));
    let depth = texture(gpu, TARGET, Depth32Float, &[]);
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &view_of(&depth),
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        }),
        ..Default::default()
    });
    let resources = [wgpu::BindingResource::TextureView(&numbers)];
    pass.set_pipeline(&stage.pipeline);
    pass.set_bind_group(0, &bind_group(&gpu.device, "plain", &stage.layout, &resources), &[]);
    pass.draw(0..3, 0..1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    depth
}

/// The bytes of a texture, row by row, of `texel` bytes each.
fn bytes_of(gpu: &HeadlessDevice, texture: &wgpu::Texture, texel: u32) -> Vec<u8> {
    let row = texture.width() * texel;
    let stride = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let size = u64::from(stride * texture.height());
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = buffers::create(&gpu.device, "test", size, usage);
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: None };
    let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    gpu.queue.submit([encoder.finish()]);
    let bytes: Vec<u8> = read(gpu, &buffer);
    bytes.chunks_exact(stride as usize).flat_map(|bytes| bytes[..row as usize].to_vec()).collect()
}

/// The part of values of a width that is in a rectangle (left, top, width, height), row by row.
fn within<T: Copy>(values: &[T], width: u32, part: UVec4) -> Vec<T> {
    let rows = (part.y..part.y + part.w).map(|y| (y * width + part.x) as usize);
    rows.flat_map(|first| values[first..first + part.z as usize].to_vec()).collect()
}

/// Random surfaces: some pixels are infinitely far, some surfaces are alike, and some pixels have two sides.
#[test]
fn shaders_equal_the_twin() {
    let Some(gpu) = gpu() else { return };
    let mut random = randoms(17);
    let n = TARGET.element_product() as usize;
    let farther: Vec<f32> = (0..n)
        .map(|_| match random() {
            x if x < 0.2 => 0.0,
            x if x < 0.6 => 0.04,
            _ => 0.05 + 0.01 * random(),
        })
        .collect();
    let nearer: Vec<f32> =
        (0..n).map(|_| if random() < 0.3 { 0.1 + 0.1 * random() } else { NO_SURFACE }).collect();
    let size = UVec2::new(VIEWPORT.z, VIEWPORT.w);
    let [eye, ahead, up] = [glam::Vec3::ZERO, glam::Vec3::Z, glam::Vec3::NEG_Y];
    let pinhole = stylegaussian::Camera::look_at(eye, ahead, up, 0.3, size);
    let camera = Camera { viewport: VIEWPORT, ..Camera::pinhole(&pinhole) };
    let stage = Half::new(&gpu.device);
    let mut uniforms = Uniforms::new(&gpu.device, "splat_half");
    uniforms.write(&gpu.queue, half_of(&camera));
    let uniforms = (&uniforms.buffer, VIEWPORT);
    let low_size = half_size(TARGET);
    let numbers: Vec<f16> = (0..4 * low_size.element_product()).map(|_| f16::from_f32(random())).collect();
    let color = texture(&gpu, low_size, LAYER_FORMAT, bytemuck::cast_slice(&numbers));
    let low_depth = texture(&gpu, low_size, Depth32Float, &[]);
    let half = HalfLayer { size: TARGET, color: view_of(&color), depth: view_of(&low_depth) };

    let [far, near] = [&farther, &nearer].map(|depths| depth_of(&gpu, depths));
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let sides = [&view_of(&far), &view_of(&near)];
    stage.encode_depth(&mut gpu.encoding(&mut encoder), uniforms, sides, &half);
    let wholes = [&far, &near].map(|depth| {
        let whole = texture(&gpu, TARGET, LAYER_FORMAT, &[]);
        let target = (&view_of(&whole), &view_of(depth));
        stage.encode_whole(&mut gpu.encoding(&mut encoder), uniforms, &half, target);
        whole
    });
    gpu.queue.submit([encoder.finish()]);

    let part = |depths: &[f32]| within(depths, TARGET.x, VIEWPORT);
    let low_part = UVec4::new(0, 0, half_size(size).x, half_size(size).y);
    let low_depths: Vec<f32> = bytemuck::pod_collect_to_vec(&bytes_of(&gpu, &low_depth, 4));
    let low_depths = within(&low_depths, low_size.x, low_part);
    assert_eq!(low_depths, half_depths(&part(&farther), &part(&nearer), size));

    let texels = |numbers: &[f16]| -> Vec<[f32; 4]> {
        numbers.chunks_exact(4).map(|texel| [0, 1, 2, 3].map(|i| texel[i].to_f32())).collect()
    };
    let low = within(&texels(&numbers), low_size.x, low_part);
    let limit = camera.depth_across_pixel().map(|x| STEEPEST * x);
    for (whole, depths) in wholes.iter().zip([&farther, &nearer]) {
        let found: Vec<f16> = bytemuck::pod_collect_to_vec(&bytes_of(&gpu, whole, 8));
        let found = texels(&found);
        // Nothing is drawn beside the viewport.
        assert_eq!(found[..TARGET.x as usize], [[0.0; 4]; TARGET.x as usize]);
        let expected = upsampled((&low, &low_depths), &part(depths), size, limit);
        let found = within(&found, TARGET.x, VIEWPORT);
        for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 2e-3, "found {found}, expected {expected}");
        }
    }
}
