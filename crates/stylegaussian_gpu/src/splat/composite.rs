//! The composite stage on the GPU: `splat_composite`, the layer over a picture.

use glam::UVec4;
use stylegaussian_shaders::splat::{self as shaders, SplatComposite};
use wgpu::util::DeviceExt;

use super::tonemapping::{InverseTable, Tonemapping};
use crate::bindings::{bind_group, group_layout, pipeline_layout, shader_module, uniform_binding};

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
    multi: Variant,
    sampler: wgpu::Sampler,
    /// Bound if no table is needed.
    no_table: wgpu::TextureView,
}

/// Targets with or without multisampling.
#[derive(Debug)]
struct Variant {
    module: wgpu::ShaderModule,
    layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
}

/// The composite for one kind of target.
#[derive(Clone, Debug)]
pub struct CompositePipeline(wgpu::RenderPipeline);

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
        let no_table = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("splat_no_table"),
            size: wgpu::Extent3d::default(),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        Self {
            single: Variant::new(device, false),
            multi: Variant::new(device, true),
            sampler,
            no_table: no_table.create_view(&wgpu::TextureViewDescriptor::default()),
        }
    }

    /// The composite over targets of `format` with `samples` samples, as many as the layer has. The pass has no
    /// depth attachment.
    pub fn pipeline(
        &self,
        device: &wgpu::Device,
        format: wgpu::TextureFormat,
        samples: u32,
        mode: CompositeMode,
    ) -> CompositePipeline {
        let variant = self.variant(samples);
        let constants = [("mode", f64::from(mode.mode()))];
        let compilation_options =
            wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        CompositePipeline(device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("splat_composite"),
            layout: Some(&variant.pipeline_layout),
            vertex: wgpu::VertexState {
                module: &variant.module,
                entry_point: Some("splat_composite_vertex"),
                compilation_options: compilation_options.clone(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
            fragment: Some(wgpu::FragmentState {
                module: &variant.module,
                entry_point: Some("splat_composite_fragment"),
                compilation_options,
                targets: &[Some(wgpu::ColorTargetState {
                    format,
                    blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        }))
    }

    /// Binds a layer of `samples` samples, and the table of a tone mapping that
    /// [`needs_table`](Tonemapping::needs_table). If that table is missing, every color becomes black.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        layer: &wgpu::TextureView,
        samples: u32,
        table: Option<&InverseTable>,
    ) -> CompositeInput {
        let uniforms = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("splat_composite"),
            contents: bytemuck::bytes_of(&SplatComposite { exposure: 1.0 }),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        });
        let resources = [
            uniforms.as_entire_binding(),
            wgpu::BindingResource::TextureView(layer),
            wgpu::BindingResource::TextureView(table.map_or(&self.no_table, InverseTable::view)),
            wgpu::BindingResource::Sampler(&self.sampler),
        ];
        let group = bind_group(device, "splat_composite", &self.variant(samples).layout, &resources);
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
        let [x, y, width, height] = viewport.as_vec4().to_array();
        pass.set_viewport(x, y, width, height, 0.0, 1.0);
        pass.set_pipeline(&pipeline.0);
        pass.set_bind_group(0, &input.group, &[]);
        pass.draw(0..3, 0..1);
    }

    fn variant(&self, samples: u32) -> &Variant {
        if samples > 1 { &self.multi } else { &self.single }
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
    fn new(device: &wgpu::Device, multisampled: bool) -> Self {
        let source = shaders::composite(multisampled);
        let label = source.label;
        let texture = |view_dimension, filterable, multisampled| wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable },
            view_dimension,
            multisampled,
        };
        let bindings = [
            uniform_binding::<SplatComposite>(),
            texture(wgpu::TextureViewDimension::D2, false, multisampled),
            texture(wgpu::TextureViewDimension::D3, true, false),
            wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
        ];
        let layout = group_layout(device, label, wgpu::ShaderStages::FRAGMENT, &bindings);
        let pipeline_layout = pipeline_layout(device, label, &[&layout]);
        let module = shader_module(device, source);
        Self { module, layout, pipeline_layout }
    }
}
