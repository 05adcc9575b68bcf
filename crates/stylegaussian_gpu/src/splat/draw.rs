//! The draw stage on the GPU: `splat_draw`.

use stylegaussian_shaders::splat::{self as shaders, SplatDraw};

use super::{
    SplatView,
    bind::{layout, storage, uniform},
};

/// The format of the layer that splats blend in: stylized colors are not clamped, and 8 bits would round thousands of
/// times.
pub const LAYER_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Where the indirect draw's arguments start in `SplatCommands`, in bytes.
const DRAW_ARGUMENTS: u64 = std::mem::offset_of!(shaders::SplatCommands, n_vertices) as u64;

/// What all draws share.
#[derive(Debug)]
pub(super) struct Draw {
    module: wgpu::ShaderModule,
    pipeline_layout: wgpu::PipelineLayout,
    /// Uniforms, counts, sorted slots, and both halves of the records.
    pub layout: wgpu::BindGroupLayout,
}

/// The draw for one kind of target.
#[derive(Clone, Debug)]
pub struct SplatPipeline(wgpu::RenderPipeline);

impl Draw {
    pub fn new(device: &wgpu::Device) -> Self {
        let source = shaders::draw();
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(source.label),
            source: wgpu::ShaderSource::Wgsl(source.wgsl.into()),
        });
        let read = storage(true);
        let bindings = [uniform::<SplatDraw>(), read, read, read, read];
        let layout = layout(device, source.label, wgpu::ShaderStages::VERTEX, &bindings);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(source.label),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
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

    pub fn encode(&self, pass: &mut wgpu::RenderPass, view: &SplatView, pipeline: &SplatPipeline) {
        let Some((_, commands, _)) = view.to_draw() else { return };
        self.encode_indirect(pass, view, pipeline, commands);
    }

    /// The draw of as many quads as `commands` (`SplatCommands`) say.
    pub fn encode_indirect(
        &self,
        pass: &mut wgpu::RenderPass,
        view: &SplatView,
        pipeline: &SplatPipeline,
        commands: &wgpu::Buffer,
    ) {
        let Some((group, _, viewport)) = view.to_draw() else { return };
        let [x, y, width, height] = viewport.as_vec4().to_array();
        pass.set_viewport(x, y, width, height, 0.0, 1.0);
        pass.set_pipeline(&pipeline.0);
        pass.set_bind_group(0, group, &[]);
        pass.draw_indirect(commands, DRAW_ARGUMENTS);
    }
}
