//! The draw stage on the GPU: `splat_draw`.

use stylegaussian_shaders::splat::{self as shaders, SplatDraw};

use super::{layer::LAYER_FORMAT, view::DrawSource};
use crate::bindings::{group_layout, pipeline_layout, shader_module, storage_binding, uniform_binding};

/// Offset of the indirect draw's arguments in `SplatCommands`, in bytes.
const DRAW_ARGUMENTS: u64 = std::mem::offset_of!(shaders::SplatCommands, n_vertices) as u64;

/// The shader and the layouts that all draws share.
#[derive(Debug)]
pub(super) struct Draw {
    module: wgpu::ShaderModule,
    pipeline_layout: wgpu::PipelineLayout,
    /// Uniforms, counts, sorted record indices, and both halves of the records.
    pub layout: wgpu::BindGroupLayout,
}

/// The draw for one kind of target.
#[derive(Clone, Debug)]
pub struct SplatPipeline(wgpu::RenderPipeline);

impl Draw {
    pub fn new(device: &wgpu::Device) -> Self {
        let source = shaders::draw();
        let label = source.label;
        let read = storage_binding(true);
        let bindings = [uniform_binding::<SplatDraw>(), read, read, read, read];
        let layout = group_layout(device, label, wgpu::ShaderStages::VERTEX, &bindings);
        let pipeline_layout = pipeline_layout(device, label, &[&layout]);
        let module = shader_module(device, source);
        Self { module, pipeline_layout, layout }
    }

    pub fn pipeline(
        &self,
        device: &wgpu::Device,
        samples: u32,
        depth_format: Option<wgpu::TextureFormat>,
    ) -> SplatPipeline {
        let depth_stencil = depth_format.map(|format| wgpu::DepthStencilState {
            format,
            // Splats are transparent: meshes hide them, but they do not hide one another.
            depth_write_enabled: Some(false),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        });
        SplatPipeline(device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("splat_draw"),
            layout: Some(&self.pipeline_layout),
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some("splat_draw_vertex"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState {
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                ..Default::default()
            },
            depth_stencil,
            multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
            fragment: Some(wgpu::FragmentState {
                module: &self.module,
                entry_point: Some("splat_draw_fragment"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format: LAYER_FORMAT,
                    blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        }))
    }
}

impl SplatPipeline {
    /// Encodes as many quads as `commands` (`SplatCommands`) ask for.
    pub(super) fn encode(&self, pass: &mut wgpu::RenderPass, source: &DrawSource, commands: &wgpu::Buffer) {
        let [x, y, width, height] = source.viewport.as_vec4().to_array();
        pass.set_viewport(x, y, width, height, 0.0, 1.0);
        pass.set_pipeline(&self.0);
        pass.set_bind_group(0, source.bind_group, &[]);
        pass.draw_indirect(commands, DRAW_ARGUMENTS);
    }
}
