//! The adapter's limits: a plain product of matrices, and a plain copy.

use anyhow::{Result, ensure};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

use crate::{
    gpu::Gpu,
    measure::Samples,
    plan::Plan,
    report::{Report, Row, names},
};

/// Measures the copy. The product is measured in turns with the rows that are compared with it.
pub fn run(gpu: &Gpu, plan: &Plan, report: &mut Report) -> Result<()> {
    copy(gpu, if plan.on_gpu { 128 << 20 } else { 32 << 20 }, report)
}

/// A product of two square matrices, ready to run.
pub struct Product<'a> {
    gpu: &'a Gpu,
    /// Side of the matrices.
    pub n: usize,
    kernel: Kernel,
    buffers: [wgpu::Buffer; 3],
}

impl<'a> Product<'a> {
    /// A product of matrices that keep a GPU busy, or of smaller ones for a software adapter. The result is
    /// checked.
    pub fn new(gpu: &'a Gpu, plan: &Plan) -> Result<Self> {
        let n = if plan.on_gpu { 4096 } else { 768 };
        // Small whole numbers: sums of n of them are exact in f32.
        let matrix = |step: usize| (0..n * n).map(|i| (i * step % 7) as f32 - 3.0).collect::<Vec<_>>();
        let (a, b) = (matrix(5), matrix(11));
        let c = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("c"),
            size: 4 * (n * n) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let wgsl = include_str!("../wgsl/product.wgsl");
        let kernel = Kernel::new(gpu, "product", wgsl, &[("n_quads", n as f64 / 4.0)]);
        let buffers = [storage(gpu, bytemuck::cast_slice(&a)), storage(gpu, bytemuck::cast_slice(&b)), c];
        let product = Self { gpu, n, kernel, buffers };
        product.time()?;
        check_product(gpu, &a, &b, &product.buffers[2], n)?;
        Ok(product)
    }

    /// Milliseconds of one product.
    pub fn time(&self) -> Result<f64> {
        // The kernel's tile: 128 rows and 16 quads of columns.
        let workgroups = [self.n as u32 / 128, self.n as u32 / 64];
        self.gpu.time(|encoder| self.kernel.run(self.gpu, encoder, &self.buffers, workgroups))
    }

    /// Number of multiplications and additions.
    pub fn flops(&self) -> u64 {
        2 * (self.n as u64).pow(3)
    }
}

/// Checks a few elements of the product, because a limit that computes something else is worthless.
fn check_product(gpu: &Gpu, a: &[f32], b: &[f32], c: &wgpu::Buffer, n: usize) -> Result<()> {
    for (row, column) in [(0, 0), (1, n - 1), (n / 2 + 3, 17), (n - 1, n - 2)] {
        // Equality and no tolerance: at most 4096 products of at most 9 are far below 2^24.
        let expected: f32 = (0..n).map(|k| a[row * n + k] * b[k * n + column]).sum();
        let found = read(gpu, c, 4 * (row * n + column) as u64)?;
        ensure!(found == expected, "the product is wrong at {row}, {column}: {found}, expected {expected}");
    }
    Ok(())
}

/// The number at `offset` bytes of a buffer.
fn read(gpu: &Gpu, buffer: &wgpu::Buffer, offset: u64) -> Result<f32> {
    let copy = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 4,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(buffer, offset, &copy, 0, 4);
    gpu.queue.submit([encoder.finish()]);
    let (sender, receiver) = std::sync::mpsc::channel();
    copy.map_async(wgpu::MapMode::Read, .., move |result| {
        // The receiver waits below.
        let _ = sender.send(result);
    });
    gpu.wait()?;
    receiver.recv()??;
    Ok(bytemuck::pod_read_unaligned(&copy.get_mapped_range(..)))
}

fn copy(gpu: &Gpu, bytes: usize, report: &mut Report) -> Result<()> {
    let kernel = Kernel::new(gpu, "copy", include_str!("../wgsl/copy.wgsl"), &[]);
    let buffers = [storage(gpu, &vec![1; bytes]), storage(gpu, &vec![0; bytes])];
    let n = (bytes / 16).div_ceil(256) as u32;
    // WebGPU allows 65,535 workgroups along an axis. The kernel joins both axes to one index.
    let workgroups = [n.min(32_768), n.div_ceil(32_768)];
    let samples = Samples::of(2, 9, || gpu.time(|encoder| kernel.run(gpu, encoder, &buffers, workgroups)))?;
    // Each byte is read once and written once.
    let bytes = 2 * bytes as u64;
    report.add(Row {
        moved: Some(bytes),
        bytes: Some(bytes),
        ..Row::new(names::COPY, bytes as usize / 2, &samples)
    });
    Ok(())
}

fn storage(gpu: &Gpu, contents: &[u8]) -> wgpu::Buffer {
    gpu.device.create_buffer_init(&BufferInitDescriptor {
        label: None,
        contents,
        usage: wgpu::BufferUsages::STORAGE,
    })
}

struct Kernel(wgpu::ComputePipeline);

impl Kernel {
    /// The entry point `name` of `wgsl`.
    fn new(gpu: &Gpu, name: &str, wgsl: &str, constants: &[(&str, f64)]) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(wgsl.into()),
        });
        Self(gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: None,
            module: &module,
            entry_point: Some(name),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                // The kernels write before they read. Zeroing would cost time that is not the limit's.
                zero_initialize_workgroup_memory: false,
            },
            cache: None,
        }))
    }

    fn run(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        buffers: &[wgpu::Buffer],
        [x, y]: [u32; 2],
    ) -> Result<()> {
        let entries = buffers.iter().enumerate();
        let entries = entries.map(|(i, buffer)| wgpu::BindGroupEntry {
            binding: i as u32,
            resource: buffer.as_entire_binding(),
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.0.get_bind_group_layout(0),
            entries: &entries.collect::<Vec<_>>(),
        });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.0);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, 1);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    #[test]
    fn shaders_are_valid() {
        for wgsl in [include_str!("../wgsl/product.wgsl"), include_str!("../wgsl/copy.wgsl")] {
            let module =
                naga::front::wgsl::parse_str(wgsl).unwrap_or_else(|e| panic!("{}", e.emit_to_string(wgsl)));
            let valid = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
            assert!(valid.is_ok(), "{}", valid.unwrap_err().emit_to_string(wgsl));
        }
    }
}
