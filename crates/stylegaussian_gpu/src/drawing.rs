//! Render pipelines, and the textures and passes that they draw into.

use glam::{UVec2, UVec4};

/// All that a render pipeline is made of.
pub(crate) struct Drawing<'a> {
    /// The stem of both entry points: `label` and `_vertex`, `label` and `_fragment`.
    pub label: &'a str,
    pub module: &'a wgpu::ShaderModule,
    pub layout: &'a wgpu::PipelineLayout,
    pub topology: wgpu::PrimitiveTopology,
    pub depth: Option<wgpu::DepthStencilState>,
    pub samples: u32,
    pub constants: &'a [(&'a str, f64)],
    pub targets: &'a [Option<wgpu::ColorTargetState>],
}

impl<'a> Drawing<'a> {
    /// Triangles of one sample per pixel, without constants, depth or targets.
    pub fn new(label: &'a str, module: &'a wgpu::ShaderModule, layout: &'a wgpu::PipelineLayout) -> Self {
        let topology = wgpu::PrimitiveTopology::TriangleList;
        Self { label, module, layout, topology, depth: None, samples: 1, constants: &[], targets: &[] }
    }

    /// Compiles the pipeline.
    pub fn pipeline(self, device: &wgpu::Device) -> wgpu::RenderPipeline {
        let Self { label, module, layout, topology, constants, .. } = self;
        let compilation_options = wgpu::PipelineCompilationOptions { constants, ..Default::default() };
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(label),
            layout: Some(layout),
            vertex: wgpu::VertexState {
                module,
                entry_point: Some(&format!("{label}_vertex")),
                compilation_options: compilation_options.clone(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState { topology, ..Default::default() },
            depth_stencil: self.depth,
            multisample: wgpu::MultisampleState { count: self.samples, ..Default::default() },
            fragment: Some(wgpu::FragmentState {
                module,
                entry_point: Some(&format!("{label}_fragment")),
                compilation_options,
                targets: self.targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// A target in which pixels blend.
pub(crate) fn blended(
    format: wgpu::TextureFormat,
    blend: wgpu::BlendState,
) -> Option<wgpu::ColorTargetState> {
    Some(wgpu::ColorTargetState { format, blend: Some(blend), write_mask: wgpu::ColorWrites::ALL })
}

/// Depth that is compared, and written if `is_written` is true.
pub(crate) fn depth_state(
    format: wgpu::TextureFormat,
    is_written: bool,
    compare: wgpu::CompareFunction,
) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format,
        depth_write_enabled: Some(is_written),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

/// A texture that is drawn into and read, with one sample per pixel. `more` are usages beside these.
pub(crate) fn attachment(
    device: &wgpu::Device,
    label: &str,
    size: UVec2,
    format: wgpu::TextureFormat,
    more: wgpu::TextureUsages,
) -> wgpu::TextureView {
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
}

/// A color attachment that a pass clears first.
pub(crate) fn cleared_color(view: &wgpu::TextureView) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    let ops =
        wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store };
    Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
}

/// A depth attachment that a pass clears first, to infinitely far.
pub(crate) fn cleared_depth(view: &wgpu::TextureView) -> Option<wgpu::RenderPassDepthStencilAttachment<'_>> {
    let depth_ops = Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store });
    Some(wgpu::RenderPassDepthStencilAttachment { view, depth_ops, stencil_ops: None })
}

/// Draws within `viewport` from now on: left, top, width and height in pixels.
pub(crate) fn set_viewport(pass: &mut wgpu::RenderPass, viewport: UVec4) {
    let [x, y, width, height] = viewport.as_vec4().to_array();
    pass.set_viewport(x, y, width, height, 0.0, 1.0);
}
