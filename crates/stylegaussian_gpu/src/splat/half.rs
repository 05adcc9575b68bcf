//! Layers of half the width and height: `splat_half_*`.
//!
//! Splats are drawn at a quarter of the pixels, and their layer is made whole before it is composited, by any
//! composite. Meshes keep sharp edges: low pixels are tested against the depths of both sides, and each pixel
//! takes those that were tested against the surface that it shows. Views with several samples per pixel have a
//! whole layer for either side of edges, both made from the one low layer.

use glam::{UVec2, UVec4};
use stylegaussian::splat::half_size;
use stylegaussian_shaders::{
    Source,
    splat::half::{self as shaders, SplatHalf},
};

use super::{camera::Camera, edges::STEEPEST, layer::LAYER_FORMAT};
use crate::{
    bindings::{bind_group, group_layout, pipeline_layout, shader_module, texture_binding, uniform_binding},
    device::GpuEncoder,
    drawing::{Drawing, attachment, cleared_color, cleared_depth, depth_state, set_viewport},
};

/// The format of depths of low pixels.
const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// The textures of a layer of half the width and height.
#[derive(Clone, Debug)]
pub struct HalfLayer {
    /// Width and height of the whole layer, in pixels.
    size: UVec2,
    pub(super) color: wgpu::TextureView,
    pub(super) depth: wgpu::TextureView,
}

impl HalfLayer {
    /// Textures for a whole layer of `size` in pixels. `more` are usages of the color, besides those of
    /// attachments.
    pub(super) fn new(device: &wgpu::Device, size: UVec2, more: wgpu::TextureUsages) -> Self {
        let low = half_size(size);
        let texture = |label, format, more| attachment(device, label, low, format, more);
        Self {
            size,
            color: texture("splat_half_layer", LAYER_FORMAT, more),
            depth: texture("splat_half_depth", DEPTH_FORMAT, wgpu::TextureUsages::empty()),
        }
    }

    /// Width and height of the whole layer, in pixels.
    pub fn size(&self) -> UVec2 {
        self.size
    }
}

/// The pipelines of both shaders.
#[derive(Debug)]
pub(super) struct Half {
    depth: Stage,
    upsample: Stage,
}

#[derive(Debug)]
struct Stage {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
}

/// The place of the picture and what is one surface for `camera`, that of the whole picture.
pub(super) fn half_of(camera: &Camera) -> SplatHalf {
    let limit = camera.depth_across_pixel().map(|x| STEEPEST * x);
    SplatHalf { viewport: camera.viewport.as_vec4().to_array(), limit, padding: [0.0; 2] }
}

/// Depths that are written, whatever was there.
fn written_depth() -> wgpu::DepthStencilState {
    depth_state(DEPTH_FORMAT, true, wgpu::CompareFunction::Always)
}

impl Half {
    pub fn new(device: &wgpu::Device) -> Self {
        let texture = |sample_type| texture_binding(sample_type, wgpu::TextureViewDimension::D2);
        let uniforms = uniform_binding::<SplatHalf>();
        let depth = texture(wgpu::TextureSampleType::Depth);
        let color = texture(wgpu::TextureSampleType::Float { filterable: false });
        let layer = [Some(wgpu::ColorTargetState::from(LAYER_FORMAT))];
        Self {
            depth: Stage::new(
                device,
                shaders::depth(),
                &[uniforms, depth, depth],
                &[],
                Some(written_depth()),
            ),
            upsample: Stage::new(device, shaders::upsample(), &[uniforms, depth, color, depth], &layer, None),
        }
    }

    /// Finds the depths of the low pixels of `viewport`, that of the whole picture (left, top, width and height
    /// in pixels), from the depths of meshes on the farther and the nearer sides of edges.
    pub fn encode_depth(
        &self,
        gpu: &mut GpuEncoder,
        (uniforms, viewport): (&wgpu::Buffer, UVec4),
        sides: [&wgpu::TextureView; 2],
        half: &HalfLayer,
    ) {
        let mut pass = gpu.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("splat_half_depth"),
            depth_stencil_attachment: cleared_depth(&half.depth),
            ..Default::default()
        });
        let size = half_size(UVec2::new(viewport.z, viewport.w));
        self.depth.draw(gpu.device, &mut pass, UVec4::new(0, 0, size.x, size.y), uniforms, &sides);
    }

    /// Makes the whole layer `color` of the low one, within the whole picture's viewport, for surfaces at
    /// `depth`. What is outside is cleared.
    pub fn encode_whole(
        &self,
        gpu: &mut GpuEncoder,
        (uniforms, viewport): (&wgpu::Buffer, UVec4),
        half: &HalfLayer,
        (color, depth): (&wgpu::TextureView, &wgpu::TextureView),
    ) {
        let mut pass = gpu.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("splat_half_upsample"),
            color_attachments: &[cleared_color(color)],
            ..Default::default()
        });
        let textures = [depth, &half.color, &half.depth];
        self.upsample.draw(gpu.device, &mut pass, viewport, uniforms, &textures);
    }
}

impl Stage {
    fn new(
        device: &wgpu::Device,
        source: Source,
        bindings: &[wgpu::BindingType],
        targets: &[Option<wgpu::ColorTargetState>],
        depth: Option<wgpu::DepthStencilState>,
    ) -> Self {
        let label = source.label;
        let layout = group_layout(device, label, wgpu::ShaderStages::FRAGMENT, bindings);
        let groups = pipeline_layout(device, label, &[&layout]);
        let module = shader_module(device, source);
        let drawing = Drawing { depth, targets, ..Drawing::new(label, &module, &groups) };
        let pipeline = drawing.pipeline(device);
        Self { layout, pipeline }
    }

    /// Draws a triangle over `viewport`.
    fn draw(
        &self,
        device: &wgpu::Device,
        pass: &mut wgpu::RenderPass,
        viewport: UVec4,
        uniforms: &wgpu::Buffer,
        textures: &[&wgpu::TextureView],
    ) {
        let views = textures.iter().map(|&view| wgpu::BindingResource::TextureView(view));
        let resources: Vec<_> = [uniforms.as_entire_binding()].into_iter().chain(views).collect();
        set_viewport(pass, viewport);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bind_group(device, "splat_half", &self.layout, &resources), &[]);
        pass.draw(0..3, 0..1);
    }
}

#[cfg(test)]
mod tests;
