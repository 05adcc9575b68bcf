//! The composite stage on the GPU: `splat_composite`, the layer over a picture.

use glam::UVec4;
use stylegaussian_shaders::splat::{self as shaders, CompositeKind, SplatComposite};
use wgpu::util::DeviceExt;

use super::{
    edges::EdgeLayers,
    tonemapping::{InverseTable, Tonemapping},
};
use crate::{
    bindings::{bind_group, group_layout, pipeline_layout, shader_module, texture_binding, uniform_binding},
    drawing::{Drawing, blended, set_viewport},
};

/// The space in which the target stores its colors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CompositeMode {
    /// The layer's own space: display-referred and encoded as sRGB, e.g. the bytes of a PNG.
    Encoded,
    /// Display-referred and linear: sRGB textures, and anything after tone mapping.
    LinearFromSrgb,
    /// Linear, and tone-mapped later. The layer goes in as the scene color that the tone mapping turns into the
    /// layer's color.
    InvertTonemapping(Tonemapping),
}

impl CompositeMode {
    pub(super) fn mode(self) -> u32 {
        match self {
            Self::Encoded => shaders::MODE_ENCODED,
            Self::LinearFromSrgb => shaders::MODE_LINEAR,
            Self::InvertTonemapping(Tonemapping::None) => shaders::MODE_EXPOSED,
            Self::InvertTonemapping(Tonemapping::Reinhard) => shaders::MODE_REINHARD,
            Self::InvertTonemapping(Tonemapping::ReinhardLuminance) => shaders::MODE_REINHARD_LUMINANCE,
            Self::InvertTonemapping(_) => shaders::MODE_TABLE,
        }
    }
}

/// The shaders and resources that all composites share.
#[derive(Debug)]
pub struct Composite {
    single: Variant,
    /// Over targets with several samples, and over those with one.
    edges: [Variant; 2],
    sampler: wgpu::Sampler,
    /// Bound if no table is needed.
    no_table: wgpu::TextureView,
}

/// One kind of layers and targets.
#[derive(Debug)]
struct Variant {
    module: wgpu::ShaderModule,
    layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
}

/// The composite for one kind of target.
#[derive(Clone, Debug)]
pub struct CompositePipeline {
    pipeline: wgpu::RenderPipeline,
    /// Triangles over the viewport.
    n_instances: u32,
}

/// A layer bound for compositing.
#[derive(Clone, Debug)]
pub struct CompositeInput {
    uniforms: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl Composite {
    /// Compiles the shaders. Pipelines depend on the target: see [`pipeline`](Self::pipeline).
    pub fn new(device: &wgpu::Device) -> Self {
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("splat_composite"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Self {
            single: Variant::new(device, CompositeKind::Single),
            edges: [CompositeKind::Multi, CompositeKind::Resolved].map(|kind| Variant::new(device, kind)),
            sampler,
            no_table: InverseTable::none(device),
        }
    }

    /// The composite of a layer over targets of `format` with `samples` samples, which all show the same. The
    /// pass has no depth attachment.
    pub fn pipeline(
        &self,
        device: &wgpu::Device,
        format: wgpu::TextureFormat,
        samples: u32,
        mode: CompositeMode,
    ) -> CompositePipeline {
        let constants = [("mode", f64::from(mode.mode()))];
        let pipeline = render_pipeline(device, &self.single, format, samples, &constants);
        CompositePipeline { pipeline, n_instances: 1 }
    }

    /// The composite of [`EdgeLayers`] over targets of `format`. `samples` are those of the target, as many as
    /// the depth has or 1, and those of the depth. The pass has no depth attachment.
    pub fn edge_pipeline(
        &self,
        device: &wgpu::Device,
        format: wgpu::TextureFormat,
        [target_samples, depth_samples]: [u32; 2],
        mode: CompositeMode,
    ) -> CompositePipeline {
        let mode = ("mode", f64::from(mode.mode()));
        let [multi, resolved] = &self.edges;
        if target_samples > 1 {
            let pipeline = render_pipeline(device, multi, format, target_samples, &[mode]);
            // The samples of either side.
            return CompositePipeline { pipeline, n_instances: 2 };
        }
        let constants = [mode, ("n_samples", f64::from(depth_samples))];
        let pipeline = render_pipeline(device, resolved, format, 1, &constants);
        CompositePipeline { pipeline, n_instances: 1 }
    }

    /// Binds a layer, and the table of a tone mapping that [`needs_table`](Tonemapping::needs_table). If that
    /// table is missing, every color becomes black.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        layer: &wgpu::TextureView,
        table: Option<&InverseTable>,
    ) -> CompositeInput {
        self.bind_textures(device, &self.single, layer, table, &[])
    }

    /// Binds the layers of both sides of edges, likewise.
    pub fn bind_edges(
        &self,
        device: &wgpu::Device,
        layers: &EdgeLayers,
        table: Option<&InverseTable>,
    ) -> CompositeInput {
        let EdgeLayers { farther, nearer, nearer_samples, .. } = layers;
        // Both kinds of targets bind the same.
        self.bind_textures(device, &self.edges[0], farther, table, &[nearer, nearer_samples])
    }

    fn bind_textures(
        &self,
        device: &wgpu::Device,
        variant: &Variant,
        layer: &wgpu::TextureView,
        table: Option<&InverseTable>,
        more: &[&wgpu::TextureView],
    ) -> CompositeInput {
        let uniforms = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("splat_composite"),
            contents: bytemuck::bytes_of(&SplatComposite { exposure: 1.0 }),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        });
        let mut resources = vec![
            uniforms.as_entire_binding(),
            wgpu::BindingResource::TextureView(layer),
            wgpu::BindingResource::TextureView(table.map_or(&self.no_table, InverseTable::view)),
            wgpu::BindingResource::Sampler(&self.sampler),
        ];
        resources.extend(more.iter().map(|&view| wgpu::BindingResource::TextureView(view)));
        let group = bind_group(device, "splat_composite", &variant.layout, &resources);
        CompositeInput { uniforms, group }
    }

    /// Puts the layer over the target of `pass`, within `viewport` (left, top, width, height in pixels of
    /// both).
    pub fn draw(
        &self,
        pass: &mut wgpu::RenderPass,
        pipeline: &CompositePipeline,
        input: &CompositeInput,
        viewport: UVec4,
    ) {
        // WebGPU rejects an empty viewport.
        if viewport.z == 0 || viewport.w == 0 {
            return;
        }
        set_viewport(pass, viewport);
        pass.set_pipeline(&pipeline.pipeline);
        pass.set_bind_group(0, &input.group, &[]);
        pass.draw(0..3, 0..pipeline.n_instances);
    }
}

impl CompositeInput {
    /// Sets by how many stops the camera brightens colors before it tone-maps them; 0 at first.
    /// [`CompositeMode::InvertTonemapping`] undoes it.
    pub fn set_exposure(&self, queue: &wgpu::Queue, stops: f32) {
        queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&stops.exp2()));
    }
}

impl Variant {
    fn new(device: &wgpu::Device, kind: CompositeKind) -> Self {
        let source = shaders::composite(kind);
        let label = source.label;
        let flat = wgpu::TextureViewDimension::D2;
        let layer = texture_binding(wgpu::TextureSampleType::Float { filterable: false }, flat);
        let mut bindings = vec![
            uniform_binding::<SplatComposite>(),
            layer,
            InverseTable::binding(),
            wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
        ];
        if kind != CompositeKind::Single {
            bindings.extend([layer, texture_binding(wgpu::TextureSampleType::Uint, flat)]);
        }
        let layout = group_layout(device, label, wgpu::ShaderStages::FRAGMENT, &bindings);
        let pipeline_layout = pipeline_layout(device, label, &[&layout]);
        let module = shader_module(device, source);
        Self { module, layout, pipeline_layout }
    }
}

/// The composite over targets of `format` with `samples` samples.
fn render_pipeline(
    device: &wgpu::Device,
    variant: &Variant,
    format: wgpu::TextureFormat,
    samples: u32,
    constants: &[(&str, f64)],
) -> wgpu::RenderPipeline {
    let targets = &[blended(format, wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING)];
    let Variant { module, pipeline_layout, .. } = variant;
    let drawing = Drawing::new("splat_composite", module, pipeline_layout);
    Drawing { samples, constants, targets, ..drawing }.pipeline(device)
}
