//! Pipelines, bind groups and parameters of the style pass.

use stylegaussian::Activation;
use stylegaussian_shaders::{
    Source,
    style::{self, KnnLayer, Storage, TILE_COLUMNS},
};

use super::{
    options::Precision,
    plan::{Kernel, Step},
    weights::GpuDecoder,
};

/// Storage bindings of all kernels, from 1 on.
pub(super) const N_STORAGE: usize = 7;

/// Whether they are only read. `style_knn_conv` leaves the sixth alone.
const STORAGE_IS_READ_ONLY: [bool; N_STORAGE] = [true, true, true, false, false, true, true];

/// The pipelines of one precision; they share a layout.
#[derive(Debug)]
pub(super) struct Pipelines {
    layout: wgpu::BindGroupLayout,
    /// Of a layer that reads the scene's inputs.
    first: Kernels,
    /// Of the others; `None` where activations are kept as the inputs are.
    hidden: Option<Kernels>,
    /// Of the averages behind the layers.
    smoothing_pass: wgpu::ComputePipeline,
}

/// What reads one kind of input: one pipeline for each width of tile, and one for the last layer.
#[derive(Debug)]
struct Kernels {
    knn_conv: [wgpu::ComputePipeline; TILE_COLUMNS.len()],
    color: wgpu::ComputePipeline,
}

/// The parameters of successive steps in one buffer.
#[derive(Debug)]
pub(super) struct Parameters {
    buffer: wgpu::Buffer,
    stride: u64,
}

impl Pipelines {
    pub fn new(device: &wgpu::Device, precision: Precision) -> Self {
        let layout = bind_group_layout(device);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("style"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = |source: Source| pipeline(device, &pipeline_layout, &source);
        let (inputs, activations) = (precision.of_inputs(), precision.of_activations());
        let kernels = |input: Storage| Kernels {
            knn_conv: TILE_COLUMNS.map(|columns| pipeline(style::knn_conv(columns, input, activations))),
            color: pipeline(style::color(input)),
        };
        let hidden = (activations != inputs).then(|| kernels(activations));
        let smoothing_pass = pipeline(style::smoothing_pass());
        Self { first: kernels(inputs), hidden, smoothing_pass, layout }
    }

    pub fn of(&self, step: &Step) -> &wgpu::ComputePipeline {
        let hidden = self.hidden.as_ref().filter(|_| step.layer > 0);
        let kernels = hidden.unwrap_or(&self.first);
        match step.kernel {
            Kernel::KnnConv(tile) => &kernels.knn_conv[tile],
            Kernel::Color => &kernels.color,
            Kernel::SmoothingPass => &self.smoothing_pass,
        }
    }

    pub fn bind_group(
        &self,
        device: &wgpu::Device,
        parameters: wgpu::BufferBinding,
        storage: &[wgpu::BufferBinding; N_STORAGE],
    ) -> wgpu::BindGroup {
        let bindings = std::iter::once(&parameters).chain(storage).enumerate();
        let entries: Vec<_> = bindings
            .map(|(i, binding)| wgpu::BindGroupEntry {
                binding: i as u32,
                resource: wgpu::BindingResource::Buffer(binding.clone()),
            })
            .collect();
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("style"),
            layout: &self.layout,
            entries: &entries,
        })
    }

    /// The steps' parameters with what the decoder says.
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
        for (step, slot) in steps.iter().zip(bytes.chunks_exact_mut(stride as usize)) {
            let parameters = with_decoder(step, weights);
            slot[..size_of::<KnnLayer>()].copy_from_slice(bytemuck::bytes_of(&parameters));
        }
        buffer.get_mapped_range_mut(..).copy_from_slice(&bytes);
        buffer.unmap();
        Parameters { buffer, stride }
    }
}

impl Parameters {
    /// Those of step `index`.
    pub fn binding(&self, index: usize) -> wgpu::BufferBinding<'_> {
        wgpu::BufferBinding {
            buffer: &self.buffer,
            offset: self.stride * index as u64,
            size: std::num::NonZero::new(size_of::<KnnLayer>() as u64),
        }
    }
}

fn with_decoder(step: &Step, weights: &GpuDecoder) -> KnnLayer {
    // The own color is added once, in the end.
    let n_steps = weights.widths.len() - 1 + weights.smoothing_passes;
    let residual = if step.layer + 1 == n_steps { weights.residual } else { 0.0 };
    let (is_sigmoid, slope) = match weights.activation {
        Activation::Sigmoid => (1, 0.0),
        Activation::LeakyRelu { slope } => (0, slope),
    };
    KnnLayer { is_sigmoid, slope, residual, ..step.parameters }
}

fn bind_group_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let entry = |binding: usize, ty| wgpu::BindGroupLayoutEntry {
        binding: binding as u32,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let storage = STORAGE_IS_READ_ONLY.iter().enumerate();
    let storage = storage.map(|(i, &read_only)| entry(i + 1, wgpu::BufferBindingType::Storage { read_only }));
    let entries: Vec<_> =
        std::iter::once(entry(0, wgpu::BufferBindingType::Uniform)).chain(storage).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("style"),
        entries: &entries,
    })
}

fn pipeline(device: &wgpu::Device, layout: &wgpu::PipelineLayout, source: &Source) -> wgpu::ComputePipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(source.label),
        source: wgpu::ShaderSource::Wgsl(source.wgsl.as_str().into()),
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(source.label),
        layout: Some(layout),
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions {
            // Every step writes all of what it reads.
            zero_initialize_workgroup_memory: false,
            ..Default::default()
        },
        cache: None,
    })
}
