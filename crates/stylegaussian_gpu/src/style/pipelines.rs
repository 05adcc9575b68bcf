//! Pipelines, bind groups and parameters of the style pass.

use stylegaussian::Activation;
use stylegaussian_shaders::{
    Source,
    style::{self, COLUMNS_PER_WORKGROUP, KnnLayer, NumberFormat},
};
use wgpu::util::DeviceExt;

use super::{
    options::Precision,
    plan::{Step, StepKind},
    weights::GpuDecoder,
};
use crate::bindings::{
    at_strides, bind_group, compute_pipeline, group_layout, one_of, pipeline_layout, storage_binding,
    uniforms_binding,
};

/// The number of storage bindings, which follow the uniforms. All kernels share one layout.
pub(super) const N_STORAGE: usize = 7;

/// Whether each storage binding is only read. `style_knn_conv` does not use the sixth.
const STORAGE_IS_READ_ONLY: [bool; N_STORAGE] = [true, true, true, false, false, true, true];

/// The pipelines of one precision; they share a layout.
#[derive(Debug)]
pub(super) struct Pipelines {
    layout: wgpu::BindGroupLayout,
    /// Pipelines of the layer that reads the scene's inputs.
    first: LayerPipelines,
    /// Pipelines of the other layers; `None` if activations have the format of the inputs.
    hidden: Option<LayerPipelines>,
    /// The pipeline of the smoothing passes behind the layers.
    smoothing_pass: wgpu::ComputePipeline,
}

/// The pipelines that read one format of input: one for each number of columns of a workgroup, and one for the
/// last layer.
#[derive(Debug)]
struct LayerPipelines {
    knn_conv: [wgpu::ComputePipeline; COLUMNS_PER_WORKGROUP.len()],
    color: wgpu::ComputePipeline,
}

impl Pipelines {
    pub fn new(device: &wgpu::Device, precision: Precision) -> Self {
        let read_only = STORAGE_IS_READ_ONLY.map(storage_binding);
        let bindings = [&[uniforms_binding::<KnnLayer>()], &read_only[..]].concat();
        let layout = group_layout(device, "style", wgpu::ShaderStages::COMPUTE, &bindings);
        let pipeline_layout = pipeline_layout(device, "style", &[&layout]);
        let pipeline = |source: Source| {
            let options = wgpu::PipelineCompilationOptions {
                // Every step of `style_knn_conv` writes all of the workgroup memory that it reads.
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            };
            compute_pipeline(device, source, &pipeline_layout, options)
        };
        let (inputs, activations) = (precision.input_format(), precision.activation_format());
        let pipelines = |input: NumberFormat| LayerPipelines {
            knn_conv: COLUMNS_PER_WORKGROUP
                .map(|columns| pipeline(style::knn_conv(columns, input, activations))),
            color: pipeline(style::color(input)),
        };
        let hidden = (activations != inputs).then(|| pipelines(activations));
        let smoothing_pass = pipeline(style::smoothing_pass());
        Self { first: pipelines(inputs), hidden, smoothing_pass, layout }
    }

    pub fn of(&self, step: &Step) -> &wgpu::ComputePipeline {
        let hidden = self.hidden.as_ref().filter(|_| step.layer > 0);
        let pipelines = hidden.unwrap_or(&self.first);
        match step.kind {
            StepKind::KnnConv(variant) => &pipelines.knn_conv[variant],
            StepKind::Color => &pipelines.color,
            StepKind::SmoothingPass => &self.smoothing_pass,
        }
    }

    pub fn bind_group(
        &self,
        device: &wgpu::Device,
        parameters: &wgpu::Buffer,
        storage: &[wgpu::BufferBinding; N_STORAGE],
    ) -> wgpu::BindGroup {
        let storage = storage.iter().cloned().map(wgpu::BindingResource::Buffer);
        let resources: Vec<_> = std::iter::once(one_of::<KnnLayer>(parameters)).chain(storage).collect();
        bind_group(device, "style", &self.layout, &resources)
    }

    /// The uniforms of `steps`, completed by those of the decoder, one after another.
    pub fn parameters(&self, device: &wgpu::Device, steps: &[Step], weights: &GpuDecoder) -> wgpu::Buffer {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("style_parameters"),
            contents: &at_strides(steps.iter().map(|step| with_decoder(step, weights))),
            usage: wgpu::BufferUsages::UNIFORM,
        })
    }
}

fn with_decoder(step: &Step, weights: &GpuDecoder) -> KnnLayer {
    // The base color is added once, by the last step.
    let n_steps = weights.widths.len() - 1 + weights.smoothing_passes;
    let residual = if step.layer + 1 == n_steps { weights.residual } else { 0.0 };
    let (is_sigmoid, slope) = match weights.activation {
        Activation::Sigmoid => (1, 0.0),
        Activation::LeakyRelu { slope } => (0, slope),
    };
    KnnLayer { is_sigmoid, slope, residual, ..step.parameters }
}
