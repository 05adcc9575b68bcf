//! Bind groups and pipelines of both passes. Bindings of a group are numbered from 0 without gaps.

use stylegaussian_shaders::Source;

/// The binding of a storage buffer.
pub(crate) fn storage_binding(read_only: bool) -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

/// The binding of a uniform buffer that holds a `T`.
pub(crate) fn uniform_binding<T>() -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: wgpu::BufferSize::new(size_of::<T>() as u64),
    }
}

/// The binding of a uniform buffer of several `T`s, of which a dynamic offset selects one: see [`one_of`].
pub(crate) fn uniforms_binding<T>() -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: true,
        min_binding_size: wgpu::BufferSize::new(size_of::<T>() as u64),
    }
}

/// The `T` of a buffer that a dynamic offset selects.
pub(crate) fn one_of<T>(buffer: &wgpu::Buffer) -> wgpu::BindingResource<'_> {
    let size = wgpu::BufferSize::new(size_of::<T>() as u64);
    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size })
}

/// Bytes from one `T` of such a buffer to the next one: its size, and a multiple of the coarsest alignment of
/// dynamic offsets that a device may ask for.
pub(crate) const fn stride<T>() -> usize {
    size_of::<T>().next_multiple_of(256)
}

/// The bytes of such a buffer.
pub(crate) fn at_strides<T: bytemuck::Pod>(uniforms: impl IntoIterator<Item = T>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for one in uniforms {
        bytes.extend_from_slice(bytemuck::bytes_of(&one));
        bytes.resize(bytes.len().next_multiple_of(stride::<T>()), 0);
    }
    bytes
}

/// The binding of a texture with one sample per texel.
pub(crate) fn texture_binding(
    sample_type: wgpu::TextureSampleType,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindingType {
    wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false }
}

/// The layout of a group with bindings 0, 1, ...
pub(crate) fn group_layout(
    device: &wgpu::Device,
    label: &str,
    visibility: wgpu::ShaderStages,
    bindings: &[wgpu::BindingType],
) -> wgpu::BindGroupLayout {
    let entry = |(i, &ty)| wgpu::BindGroupLayoutEntry { binding: i as u32, visibility, ty, count: None };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(label),
        entries: &bindings.iter().enumerate().map(entry).collect::<Vec<_>>(),
    })
}

/// A group of resources 0, 1, ...
pub(crate) fn bind_group(
    device: &wgpu::Device,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource],
) -> wgpu::BindGroup {
    let numbered = resources.iter().cloned().enumerate();
    let entries = numbered.map(|(i, resource)| wgpu::BindGroupEntry { binding: i as u32, resource });
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(label),
        layout,
        entries: &entries.collect::<Vec<_>>(),
    })
}

/// The layout of pipelines with groups 0, 1, ...
pub(crate) fn pipeline_layout(
    device: &wgpu::Device,
    label: &str,
    groups: &[&wgpu::BindGroupLayout],
) -> wgpu::PipelineLayout {
    device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &groups.iter().map(|&group| Some(group)).collect::<Vec<_>>(),
        immediate_size: 0,
    })
}

/// Compiles a joined shader.
pub(crate) fn shader_module(device: &wgpu::Device, source: Source) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(source.label),
        source: wgpu::ShaderSource::Wgsl(source.wgsl.into()),
    })
}

/// The pipeline of the one kernel of `source`, whose entry point has the same name.
pub(crate) fn compute_pipeline(
    device: &wgpu::Device,
    source: Source,
    layout: &wgpu::PipelineLayout,
    compilation_options: wgpu::PipelineCompilationOptions,
) -> wgpu::ComputePipeline {
    let label = source.label;
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(label),
        layout: Some(layout),
        module: &shader_module(device, source),
        entry_point: Some(label),
        compilation_options,
        cache: None,
    })
}

/// A pass of kernels, without a measurement of its time.
pub(crate) fn compute_pass<'a>(encoder: &'a mut wgpu::CommandEncoder, label: &str) -> wgpu::ComputePass<'a> {
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(label), timestamp_writes: None })
}

/// A kernel that binds one group of resources.
#[derive(Debug)]
pub(crate) struct Kernel {
    pub pipeline: wgpu::ComputePipeline,
    pub layout: wgpu::BindGroupLayout,
    pub label: &'static str,
}

impl Kernel {
    pub fn new(device: &wgpu::Device, source: Source, bindings: &[wgpu::BindingType]) -> Self {
        Self::with_options(device, source, bindings, wgpu::PipelineCompilationOptions::default())
    }

    pub fn with_options(
        device: &wgpu::Device,
        source: Source,
        bindings: &[wgpu::BindingType],
        options: wgpu::PipelineCompilationOptions,
    ) -> Self {
        let label = source.label;
        let layout = group_layout(device, label, wgpu::ShaderStages::COMPUTE, bindings);
        let pipeline_layout = pipeline_layout(device, label, &[&layout]);
        let pipeline = compute_pipeline(device, source, &pipeline_layout, options);
        Self { pipeline, layout, label }
    }

    /// A group of whole buffers.
    pub fn bind(&self, device: &wgpu::Device, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let resources: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_binding()).collect();
        bind_group(device, self.label, &self.layout, &resources)
    }
}
