//! The least light before a tone mapping, `splat_lift`, for layers that are composited after it.

use stylegaussian_shaders::splat as shaders;

use super::tonemapping::Tonemapping;
use crate::{
    bindings::{pipeline_layout, shader_module},
    drawing::Drawing,
};

/// The pipeline that lifts what is exactly black by less than a screen shows.
#[derive(Clone, Debug)]
pub struct LiftPipeline(wgpu::RenderPipeline);

impl LiftPipeline {
    /// Whether a tone mapping, as engines have it, makes no number of black: it divides by luminance.
    pub fn is_needed(tonemapping: Tonemapping) -> bool {
        tonemapping == Tonemapping::ReinhardLuminance
    }

    /// The pipeline for targets of a blendable `format` with one sample per pixel.
    pub fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let source = shaders::lift();
        let label = source.label;
        let layout = pipeline_layout(device, label, &[]);
        let module = shader_module(device, source);
        let most = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Max,
        };
        let blend = Some(wgpu::BlendState { color: most, alpha: most });
        let target = wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::COLOR };
        let targets = &[Some(target)];
        Self(Drawing { targets, ..Drawing::new(label, &module, &layout) }.pipeline(device))
    }

    /// Lifts all of the target of `pass`.
    pub fn draw(&self, pass: &mut wgpu::RenderPass) {
        pass.set_pipeline(&self.0);
        pass.draw(0..3, 0..1);
    }
}
