//! Bindings and pipelines in few words: groups are numbered from 0 without gaps.

/// A storage buffer binding.
pub(super) fn storage(read_only: bool) -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

/// A uniform buffer binding of a `T`.
pub(super) fn uniform<T>() -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: wgpu::BufferSize::new(size_of::<T>() as u64),
    }
}

/// The layout of a group with bindings 0, 1, ...
pub(super) fn layout(
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

/// All of a buffer.
pub(super) fn whole(buffer: &wgpu::Buffer) -> wgpu::BindingResource<'_> {
    buffer.as_entire_binding()
}

/// A group of resources 0, 1, ...
pub(super) fn bind_group(
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

/// The pipeline of the one kernel of `source`, which is named like it.
pub(super) fn compute_pipeline(
    device: &wgpu::Device,
    source: &stylegaussian_shaders::Source,
    groups: &[&wgpu::BindGroupLayout],
) -> wgpu::ComputePipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(source.label),
        source: wgpu::ShaderSource::Wgsl(source.wgsl.as_str().into()),
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(source.label),
        bind_group_layouts: &groups.iter().map(|&group| Some(group)).collect::<Vec<_>>(),
        immediate_size: 0,
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(source.label),
        layout: Some(&layout),
        module: &module,
        entry_point: Some(source.label),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

/// A kernel that binds one group of buffers.
#[derive(Debug)]
pub(super) struct Kernel {
    pub pipeline: wgpu::ComputePipeline,
    pub layout: wgpu::BindGroupLayout,
    pub label: &'static str,
}

impl Kernel {
    pub fn new(
        device: &wgpu::Device,
        source: &stylegaussian_shaders::Source,
        bindings: &[wgpu::BindingType],
    ) -> Self {
        let layout = layout(device, source.label, wgpu::ShaderStages::COMPUTE, bindings);
        let pipeline = compute_pipeline(device, source, &[&layout]);
        Self { pipeline, layout, label: source.label }
    }

    /// A group of whole buffers.
    pub fn bind(&self, device: &wgpu::Device, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let resources: Vec<_> = buffers.iter().map(|buffer| whole(buffer)).collect();
        bind_group(device, self.label, &self.layout, &resources)
    }
}
