//! Layers of views with several samples per pixel: `splat_edges_*`.
//!
//! Splats are smooth, so one sample of them per pixel is enough. Meshes are not: where one ends, the samples of
//! a pixel have the depths of two surfaces. There splats are drawn twice, before the farther surface and before
//! the nearer one, and the composite gives each sample the side that it is on.

use glam::UVec2;
use stylegaussian_shaders::splat::{self as shaders, SplatEdges};

use super::{camera::Camera, layer::LAYER_FORMAT};
use crate::{
    bindings::{bind_group, group_layout, pipeline_layout, shader_module, uniform_binding},
    buffers,
};

/// The format of [`EdgeLayers::nearer_samples`]: a bit for each of up to eight samples.
const MASK_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Uint;
/// The format of depth on either side.
const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Surfaces that go deeper than this many pixel sizes across a pixel count as edges: those that are seen at
/// less than atan(1 / 8), 7 degrees. A splat that is less deep behind a surface is hidden in all samples of the
/// pixel or in none.
pub(super) const STEEPEST: f32 = 8.0;

/// The textures of a view with several samples per pixel.
#[derive(Clone, Debug)]
pub struct EdgeLayers {
    size: UVec2,
    pub(super) farther: wgpu::TextureView,
    pub(super) nearer: wgpu::TextureView,
    pub(super) farther_depth: wgpu::TextureView,
    pub(super) nearer_depth: wgpu::TextureView,
    /// The samples on the nearer side, a bit each.
    pub(super) nearer_samples: wgpu::TextureView,
}

impl EdgeLayers {
    /// Textures of `size` in pixels. `more` are the usages of layers besides those of attachments.
    pub(super) fn new(device: &wgpu::Device, size: UVec2, more: wgpu::TextureUsages) -> Self {
        let texture = |label, format, more| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING | more,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let none = wgpu::TextureUsages::empty();
        Self {
            size,
            farther: texture("splat_layer", LAYER_FORMAT, more),
            nearer: texture("splat_nearer_layer", LAYER_FORMAT, more),
            farther_depth: texture("splat_farther_depth", DEPTH_FORMAT, none),
            nearer_depth: texture("splat_nearer_depth", DEPTH_FORMAT, none),
            nearer_samples: texture("splat_nearer_samples", MASK_FORMAT, none),
        }
    }

    /// Width and height, in pixels.
    pub fn size(&self) -> UVec2 {
        self.size
    }
}

/// The pipelines that split depth.
#[derive(Debug)]
pub(super) struct Edges {
    layout: wgpu::BindGroupLayout,
    farther: wgpu::RenderPipeline,
    nearer: wgpu::RenderPipeline,
}

/// The uniforms of one view.
#[derive(Debug)]
pub(super) struct EdgeUniforms {
    buffer: wgpu::Buffer,
    /// The numbers that the buffer holds.
    written: Option<SplatEdges>,
}

impl EdgeUniforms {
    pub fn new(device: &wgpu::Device) -> Self {
        let buffer = buffers::uniforms(device, "splat_edges", size_of::<SplatEdges>() as u64);
        Self { buffer, written: None }
    }

    /// Uploads what is an edge for `camera`, if it changed.
    pub fn write(&mut self, queue: &wgpu::Queue, camera: &Camera) {
        let limit = camera.depth_across_pixel().map(|x| STEEPEST * x);
        let now = SplatEdges { limit };
        if self.written != Some(now) {
            queue.write_buffer(&self.buffer, 0, bytemuck::bytes_of(&now));
            self.written = Some(now);
        }
    }
}

impl Edges {
    pub fn new(device: &wgpu::Device) -> Self {
        let depth = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Depth,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: true,
        };
        let bindings = [uniform_binding::<SplatEdges>(), depth];
        let layout = group_layout(device, "splat_edges", wgpu::ShaderStages::FRAGMENT, &bindings);
        let pipeline = |nearer| {
            let source = shaders::edges(nearer);
            let label = source.label;
            let mask = [Some(wgpu::ColorTargetState::from(MASK_FORMAT))];
            let module = shader_module(device, source);
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(label),
                layout: Some(&pipeline_layout(device, label, &[&layout])),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(&format!("{label}_vertex")),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH_FORMAT,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::Always),
                    stencil: wgpu::StencilState::default(),
                    bias: wgpu::DepthBiasState::default(),
                }),
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(&format!("{label}_fragment")),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: if nearer { &[] } else { &mask },
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let (farther, nearer) = (pipeline(false), pipeline(true));
        Self { layout, farther, nearer }
    }

    /// Splits `depth` (several samples, reverse z) within a viewport (left, top, width and height in pixels).
    pub fn encode(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        (uniforms, viewport): (&EdgeUniforms, glam::UVec4),
        layers: &EdgeLayers,
        depth: &wgpu::TextureView,
    ) {
        let resources = [uniforms.buffer.as_entire_binding(), wgpu::BindingResource::TextureView(depth)];
        let group = bind_group(device, "splat_edges", &self.layout, &resources);
        let mask = wgpu::RenderPassColorAttachment {
            view: &layers.nearer_samples,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Store,
            },
        };
        let [x, y, width, height] = viewport.as_vec4().to_array();
        for (pipeline, mask, depth) in
            [(&self.farther, Some(mask), &layers.farther_depth), (&self.nearer, None, &layers.nearer_depth)]
        {
            let attachments = [mask];
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("splat_edges"),
                color_attachments: if attachments[0].is_some() { &attachments } else { &[] },
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: depth,
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Clear(0.0),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            pass.set_viewport(x, y, width, height, 0.0, 1.0);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}
