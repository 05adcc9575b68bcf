//! The draw stage on the GPU: `splat_draw`.

use std::sync::{Arc, OnceLock};

use stylegaussian_shaders::splat::{self as shaders, SplatDraw};

use super::{layer::LAYER_FORMAT, strokes::StrokeStage, view::DrawSource};
use crate::{
    bindings::{group_layout, pipeline_layout, shader_module, storage_binding, uniform_binding},
    drawing::{Drawing, blended, depth_state, set_viewport},
};

/// Offset of the indirect draw's arguments in `SplatCommands`, in bytes.
const DRAW_ARGUMENTS: u64 = std::mem::offset_of!(shaders::SplatCommands, n_vertices) as u64;

/// The shader and the layouts that all draws share.
#[derive(Debug)]
pub(super) struct Draw {
    module: wgpu::ShaderModule,
    pipeline_layout: wgpu::PipelineLayout,
    /// Uniforms, counts, sorted record indices, and both halves of the records.
    pub layout: wgpu::BindGroupLayout,
    /// The shader and the layout of draws with strokes, made when the first is compiled.
    painted: OnceLock<(wgpu::ShaderModule, wgpu::PipelineLayout)>,
}

/// The draw for one kind of target.
#[derive(Clone, Debug)]
pub struct SplatPipeline {
    plain: wgpu::RenderPipeline,
    /// The draw with strokes, compiled when it is asked for.
    painted: Arc<OnceLock<wgpu::RenderPipeline>>,
    device: wgpu::Device,
    samples: u32,
    depth_format: Option<wgpu::TextureFormat>,
}

impl Draw {
    pub fn new(device: &wgpu::Device) -> Self {
        let source = shaders::draw();
        let label = source.label;
        let read = storage_binding(true);
        let bindings = [uniform_binding::<SplatDraw>(), read, read, read, read];
        let layout = group_layout(device, label, wgpu::ShaderStages::VERTEX, &bindings);
        let pipeline_layout = pipeline_layout(device, label, &[&layout]);
        let module = shader_module(device, source);
        Self { module, pipeline_layout, layout, painted: OnceLock::new() }
    }

    pub fn pipeline(
        &self,
        device: &wgpu::Device,
        samples: u32,
        depth_format: Option<wgpu::TextureFormat>,
    ) -> SplatPipeline {
        let plain = render_pipeline(
            device,
            &self.module,
            &self.pipeline_layout,
            "splat_draw",
            (samples, depth_format),
        );
        SplatPipeline { plain, painted: Arc::default(), device: device.clone(), samples, depth_format }
    }

    /// The draw of `pipeline` with strokes, which is compiled unless it is there.
    pub fn painted<'a>(
        &self,
        pipeline: &'a SplatPipeline,
        strokes: &StrokeStage,
    ) -> &'a wgpu::RenderPipeline {
        pipeline.painted.get_or_init(|| {
            let SplatPipeline { device, samples, depth_format, .. } = pipeline;
            let (module, layout) = self.painted.get_or_init(|| {
                let source = shaders::strokes::draw();
                let groups = [&self.layout, &strokes.draws(device).layout];
                (shader_module(device, source.clone()), pipeline_layout(device, source.label, &groups))
            });
            render_pipeline(device, module, layout, "splat_draw_strokes", (*samples, *depth_format))
        })
    }

    /// Encodes as many quads as `commands` (`SplatCommands`) ask for.
    pub fn encode(
        &self,
        pass: &mut wgpu::RenderPass,
        pipeline: &SplatPipeline,
        strokes: &StrokeStage,
        source: &DrawSource,
        commands: &wgpu::Buffer,
    ) {
        set_viewport(pass, source.viewport);
        match source.strokes {
            None => pass.set_pipeline(&pipeline.plain),
            Some(group) => {
                pass.set_pipeline(self.painted(pipeline, strokes));
                pass.set_bind_group(1, group, &[]);
            }
        }
        pass.set_bind_group(0, source.bind_group, &[]);
        pass.draw_indirect(commands, DRAW_ARGUMENTS);
    }
}

/// The draw for a number of samples and a format of depth.
fn render_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    label: &str,
    (samples, depth_format): (u32, Option<wgpu::TextureFormat>),
) -> wgpu::RenderPipeline {
    // Splats are transparent: meshes hide them, but they do not hide one another.
    let depth = depth_format.map(|format| depth_state(format, false, wgpu::CompareFunction::GreaterEqual));
    let targets = &[blended(LAYER_FORMAT, wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING)];
    let topology = wgpu::PrimitiveTopology::TriangleStrip;
    let drawing = Drawing::new(label, module, layout);
    Drawing { topology, depth, samples, targets, ..drawing }.pipeline(device)
}
