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
    device::GpuEncoder,
    drawing::{Drawing, attachment, cleared_color, cleared_depth, depth_state, set_viewport},
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
        let texture = |label, format, more| attachment(device, label, size, format, more);
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

/// The edges of meshes that `camera` sees.
pub(super) fn edges_of(camera: &Camera) -> SplatEdges {
    SplatEdges { limit: camera.depth_across_pixel().map(|x| STEEPEST * x) }
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
            let layout = pipeline_layout(device, label, &[&layout]);
            let mask = [Some(wgpu::ColorTargetState::from(MASK_FORMAT))];
            let module = shader_module(device, source);
            let drawing = Drawing {
                depth: Some(depth_state(DEPTH_FORMAT, true, wgpu::CompareFunction::Always)),
                targets: if nearer { &[] } else { &mask },
                ..Drawing::new(label, &module, &layout)
            };
            drawing.pipeline(device)
        };
        let (farther, nearer) = (pipeline(false), pipeline(true));
        Self { layout, farther, nearer }
    }

    /// Splits `depth` (several samples, reverse z) within a viewport (left, top, width and height in pixels).
    pub fn encode(
        &self,
        gpu: &mut GpuEncoder,
        (uniforms, viewport): (&wgpu::Buffer, glam::UVec4),
        layers: &EdgeLayers,
        depth: &wgpu::TextureView,
    ) {
        let resources = [uniforms.as_entire_binding(), wgpu::BindingResource::TextureView(depth)];
        let group = bind_group(gpu.device, "splat_edges", &self.layout, &resources);
        let mask = [cleared_color(&layers.nearer_samples)];
        let sides = [
            (&self.farther, &mask[..], &layers.farther_depth),
            (&self.nearer, &mask[..0], &layers.nearer_depth),
        ];
        for (pipeline, color_attachments, depth) in sides {
            let mut pass = gpu.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("splat_edges"),
                color_attachments,
                depth_stencil_attachment: cleared_depth(depth),
                ..Default::default()
            });
            set_viewport(&mut pass, viewport);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}
