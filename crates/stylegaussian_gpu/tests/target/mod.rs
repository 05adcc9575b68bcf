//! Textures to draw to, passes over them, and their texels read back.

#![allow(dead_code, reason = "each test file uses a part")]

use glam::{UVec2, UVec4};
use half::f16;
use stylegaussian_gpu::{
    device::{DeviceError, DeviceOptions, HeadlessDevice},
    splat::{Camera, Composite, CompositeMode, EdgeLayers, LAYER_FORMAT, SplatPass, SplatView},
};

/// A device, or `None` with a message if there is none.
pub fn gpu() -> Option<HeadlessDevice> {
    gpu_with_limits(|limits| limits)
}

/// A device with limits that `limits` makes of the adapter's.
pub fn gpu_with_limits(limits: fn(wgpu::Limits) -> wgpu::Limits) -> Option<HeadlessDevice> {
    match pollster::block_on(HeadlessDevice::request(DeviceOptions { limits, ..Default::default() })) {
        Ok(gpu) => {
            // Without it, a test would draw on after a validation error and compare stale pictures.
            gpu.device.on_uncaptured_error(std::sync::Arc::new(|error| panic!("{error}")));
            Some(gpu)
        }
        Err(DeviceError::NoAdapter(_)) => {
            eprintln!("SKIPPED: no GPU adapter");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// A texture of `[width, height]` that can be drawn to, bound, and (with one sample) copied.
pub fn texture(
    device: &wgpu::Device,
    [width, height]: [u32; 2],
    format: wgpu::TextureFormat,
    samples: u32,
) -> wgpu::Texture {
    let mut usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
    if samples == 1 {
        usage |= wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST;
    }
    if format == LAYER_FORMAT && samples == 1 {
        usage |= wgpu::TextureUsages::STORAGE_BINDING;
    }
    device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

/// A layer of one sample that holds `texels`, row by row.
pub fn layer_of(gpu: &HeadlessDevice, texels: &[[f32; 4]], width: u32) -> wgpu::TextureView {
    let height = texels.len() as u32 / width;
    let layer = texture(&gpu.device, [width, height], LAYER_FORMAT, 1);
    let halves: Vec<f16> = texels.as_flattened().iter().map(|&x| f16::from_f32(x)).collect();
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * width), rows_per_image: None };
    gpu.queue.write_texture(layer.as_image_copy(), bytemuck::cast_slice(&halves), layout, layer.size());
    layer.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Runs a pass over `target`, cleared to `background`. `resolve` receives the mean of its samples.
pub fn pass(
    gpu: &HeadlessDevice,
    target: &wgpu::Texture,
    resolve: Option<&wgpu::Texture>,
    background: wgpu::Color,
    draw: impl FnOnce(&mut wgpu::RenderPass),
) {
    let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
    let (target, resolve) = (view(target), resolve.map(view));
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &target,
            depth_slice: None,
            resolve_target: resolve.as_ref(),
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(background), store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    });
    draw(&mut pass);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
}

/// All of a texture.
pub fn view_of(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// A camera with depth 0.1 / z.
pub fn with_near_plane(camera: &stylegaussian::Camera) -> Camera {
    let mut camera = Camera::pinhole(camera);
    camera.clip_from_view.w_axis.z = 0.1;
    camera
}

/// Depth with `samples` samples per pixel, of triangles of these corners in normalized device coordinates,
/// reverse z.
pub fn depth_of(gpu: &HeadlessDevice, size: UVec2, samples: u32, corners: &[[f32; 3]]) -> wgpu::Texture {
    let depth = texture(&gpu.device, size.to_array(), wgpu::TextureFormat::Depth32Float, samples);
    let (of_depth, mut encoder) =
        (view_of(&depth), gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default()));
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &of_depth,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        }),
        ..Default::default()
    });
    // An array in WGSL is not empty.
    if !corners.is_empty() {
        pass.set_pipeline(&mesh_pipeline(&gpu.device, samples, corners));
        pass.draw(0..corners.len() as u32, 0..1);
    }
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    depth
}

/// The draw of triangles of these corners into depth alone.
fn mesh_pipeline(device: &wgpu::Device, samples: u32, corners: &[[f32; 3]]) -> wgpu::RenderPipeline {
    let list: Vec<String> = corners.iter().map(|[x, y, z]| format!("vec3({x:?}, {y:?}, {z:?})")).collect();
    let source = format!(
        "@vertex fn mesh(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {{
            var corners = array({});
            return vec4<f32>(corners[i], 1.0);
        }}",
        list.join(", ")
    );
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
        fragment: None,
        multiview_mask: None,
        cache: None,
    })
}

/// The layers of both sides of the edges in `depth`, which has several samples per pixel.
pub fn edge_layers(
    gpu @ HeadlessDevice { device, queue, .. }: &HeadlessDevice,
    splats: &SplatPass,
    view: &mut SplatView,
    camera: &Camera,
    depth: &wgpu::Texture,
) -> EdgeLayers {
    let layers = splats.edge_layers(device, UVec2::new(depth.width(), depth.height()));
    let pipeline = splats.pipeline(device, 1, Some(depth.format()));
    let depth = depth.create_view(&wgpu::TextureViewDescriptor::default());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    splats.draw_edge_layers(&mut gpu.encoding(&mut encoder), view, camera, (&layers, &depth), &pipeline);
    queue.submit([encoder.finish()]);
    layers
}

/// Puts the layers of a depth of `samples` samples over nothing, as they are stored.
pub fn composite_edges(gpu: &HeadlessDevice, layers: &EdgeLayers, samples: u32, target: &wgpu::Texture) {
    let composite = Composite::new(&gpu.device);
    let samples = [target.sample_count(), samples];
    let over = composite.edge_pipeline(&gpu.device, target.format(), samples, CompositeMode::Encoded);
    let input = composite.bind_edges(&gpu.device, layers, None);
    let UVec2 { x, y } = layers.size();
    pass(gpu, target, None, wgpu::Color::TRANSPARENT, |pass| {
        composite.draw(pass, &over, &input, UVec4::new(0, 0, x, y));
    });
}

/// The mean of the samples of a layer: the layer itself if it has one.
pub fn resolved(gpu: &HeadlessDevice, samples: &wgpu::Texture) -> wgpu::Texture {
    if samples.sample_count() == 1 {
        return samples.clone();
    }
    let single = texture(&gpu.device, [samples.width(), samples.height()], samples.format(), 1);
    let [view, resolved] =
        [samples, &single].map(|texture| texture.create_view(&wgpu::TextureViewDescriptor::default()));
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: Some(&resolved),
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    });
    gpu.queue.submit([encoder.finish()]);
    single
}

/// The texels of a texture of one sample, row by row. Bytes become 0..1, undecoded.
pub fn read(gpu: &HeadlessDevice, texture: &wgpu::Texture) -> Vec<[f32; 4]> {
    let texel_bytes = texture.format().block_copy_size(None).unwrap();
    let bytes_per_row = (texture.width() * texel_bytes).next_multiple_of(256);
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(bytes_per_row * texture.height()),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(bytes_per_row), rows_per_image: None };
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        texture.size(),
    );
    gpu.queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., Result::unwrap);
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let mapped = buffer.get_mapped_range(..);
    let row_bytes = (texture.width() * texel_bytes) as usize;
    let rows = mapped.chunks_exact(bytes_per_row as usize).map(|row| &row[..row_bytes]);
    rows.flat_map(|row| row.chunks_exact(texel_bytes as usize).map(texel)).collect()
}

/// A texel of four bytes, four f16 or four f32.
fn texel(bytes: &[u8]) -> [f32; 4] {
    let channel = |i: usize| match bytes.len() {
        4 => f32::from(bytes[i]) / 255.0,
        8 => f16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]).to_f32(),
        _ => f32::from_le_bytes([bytes[4 * i], bytes[4 * i + 1], bytes[4 * i + 2], bytes[4 * i + 3]]),
    };
    [0, 1, 2, 3].map(channel)
}
