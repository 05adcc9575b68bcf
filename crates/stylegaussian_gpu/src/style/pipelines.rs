//! Pipelines, bind groups and parameters of the style pass.

use stylegaussian::Activation;
use stylegaussian_shaders::{
    Source,
    style::{self, COLUMNS_PER_WORKGROUP, KnnLayer, NumberFormat},
};

use super::{
    options::Precision,
    plan::{Step, StepKind},
    weights::GpuDecoder,
};
use crate::bindings::{
    bind_group, compute_pipeline, group_layout, pipeline_layout, storage_binding, uniform_binding,
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

/// The uniforms of successive steps, in one buffer.
#[derive(Debug)]
pub(super) struct Parameters {
    buffer: wgpu::Buffer,
    stride: u64,
}

impl Pipelines {
    pub fn new(device: &wgpu::Device, precision: Precision) -> Self {
        let read_only = STORAGE_IS_READ_ONLY.map(storage_binding);
        let bindings = [&[uniform_binding::<KnnLayer>()], &read_only[..]].concat();
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
        parameters: wgpu::BufferBinding,
        storage: &[wgpu::BufferBinding; N_STORAGE],
    ) -> wgpu::BindGroup {
        let buffers = std::iter::once(&parameters).chain(storage).cloned();
        let resources: Vec<_> = buffers.map(wgpu::BindingResource::Buffer).collect();
        bind_group(device, "style", &self.layout, &resources)
    }

    /// The uniforms of `steps`, completed by those of the decoder.
    pub fn parameters(&self, device: &wgpu::Device, steps: &[Step], weights: &GpuDecoder) -> Parameters {
        let alignment = u64::from(device.limits().min_uniform_buffer_offset_alignment);
        let stride = (size_of::<KnnLayer>() as u64).next_multiple_of(alignment);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("style_parameters"),
            size: stride * steps.len() as u64,
            usage: wgpu::BufferUsages::UNIFORM,
            mapped_at_creation: true,
        });
        let mut bytes = vec![0; stride as usize * steps.len()];
        for (step, bytes) in steps.iter().zip(bytes.chunks_exact_mut(stride as usize)) {
            let parameters = with_decoder(step, weights);
            bytes[..size_of::<KnnLayer>()].copy_from_slice(bytemuck::bytes_of(&parameters));
        }
        buffer.get_mapped_range_mut(..).copy_from_slice(&bytes);
        buffer.unmap();
        Parameters { buffer, stride }
    }
}

impl Parameters {
    /// The uniforms of step `index`.
    pub fn binding(&self, index: usize) -> wgpu::BufferBinding<'_> {
        wgpu::BufferBinding {
            buffer: &self.buffer,
            offset: self.stride * index as u64,
            size: std::num::NonZero::new(size_of::<KnnLayer>() as u64),
        }
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
