//! The sort stage on the GPU: `splat_sort_*`, a stable radix sort of the visible splats.

use stylegaussian_shaders::splat::{
    self as shaders, N_DIGITS, SOFTWARE_WORKGROUP, SORT_BATCH, SortPass, SplatCommands, SplatCounts,
};
use wgpu::util::DeviceExt;

use crate::{
    bindings::{Kernel, storage_binding, uniform_binding},
    buffers,
    device::is_software,
};

/// Digits of 8 bits in a key of 32.
const N_PASSES: usize = 4;

/// The pipelines.
#[derive(Debug)]
pub(super) struct Sort {
    histogram: Kernel,
    scan: Kernel,
    scatter: Kernel,
    counts: Kernel,
    /// Workgroups of the scan.
    n_scans: u32,
    /// Uniforms of each pass.
    passes: [wgpu::Buffer; N_PASSES],
}

/// Keys and values on their way through the sort, for up to a number of records. A clone names the same
/// buffers.
#[derive(Clone, Debug)]
pub(super) struct SortBuffers {
    /// Keys of all records, the input of the sort `[n_records]`; overwritten by it.
    pub keys: wgpu::Buffer,
    /// Indices of the visible records by ascending key, the output of the sort `[n_visible]`.
    pub record_indices: wgpu::Buffer,
    /// `SplatCounts`.
    pub counts: wgpu::Buffer,
    /// `SplatCommands`, for indirect commands.
    pub commands: wgpu::Buffer,
    groups: Groups,
}

#[derive(Clone, Debug)]
struct Groups {
    histogram: [wgpu::BindGroup; N_PASSES],
    scan: [wgpu::BindGroup; N_PASSES],
    scatter: [wgpu::BindGroup; N_PASSES],
    counts: wgpu::BindGroup,
}

impl Sort {
    /// The kernels that are fastest on the adapter. Invocations of the GPU kernels wait for one another within
    /// a workgroup; a software adapter pays for every wait by switching between the invocations that it
    /// emulates.
    pub fn new(device: &wgpu::Device) -> Self {
        Self::of_kind(device, is_software(&device.adapter_info()))
    }

    /// The kernels that handle a batch by one invocation (`serial`) or by a workgroup.
    pub fn of_kind(device: &wgpu::Device, serial: bool) -> Self {
        let uniforms = uniform_binding::<SortPass>();
        let (read, write) = (storage_binding(true), storage_binding(false));
        Self {
            histogram: Kernel::new(device, shaders::sort_histogram(serial), &[uniforms, read, read, write]),
            scan: Kernel::new(device, shaders::sort_scan(serial), &[uniforms, read, write, write]),
            scatter: Kernel::new(
                device,
                shaders::sort_scatter(serial),
                &[uniforms, read, read, read, read, read, write, write],
            ),
            counts: Kernel::new(device, shaders::sort_counts(), &[write, read, write]),
            n_scans: if serial { N_DIGITS / SOFTWARE_WORKGROUP } else { N_DIGITS },
            passes: std::array::from_fn(|i| {
                let pass = SortPass { shift: 8 * i as u32, first: u32::from(i == 0), padding: [0; 2] };
                device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                    label: Some("splat_sort_pass"),
                    contents: bytemuck::bytes_of(&pass),
                    usage: wgpu::BufferUsages::UNIFORM,
                })
            }),
        }
    }

    /// Sorts the indices of the records whose keys are not `INVISIBLE`, stably, and counts them. `n_records` is
    /// the number that the CPU wrote to `SplatCounts`, at most that of the buffers.
    pub fn encode(&self, pass: &mut wgpu::ComputePass, buffers: &SortBuffers, n_records: u32) {
        let groups = &buffers.groups;
        for i in 0..N_PASSES {
            // Only the first pass sees every record. The CPU does not know how many are left after it.
            let dispatch_batches = |pass: &mut wgpu::ComputePass| match i {
                0 => pass.dispatch_workgroups(n_records.div_ceil(SORT_BATCH), 1, 1),
                _ => pass.dispatch_workgroups_indirect(&buffers.commands, 0),
            };
            pass.set_pipeline(&self.histogram.pipeline);
            pass.set_bind_group(0, &groups.histogram[i], &[]);
            dispatch_batches(pass);
            pass.set_pipeline(&self.scan.pipeline);
            pass.set_bind_group(0, &groups.scan[i], &[]);
            pass.dispatch_workgroups(self.n_scans, 1, 1);
            pass.set_pipeline(&self.scatter.pipeline);
            pass.set_bind_group(0, &groups.scatter[i], &[]);
            dispatch_batches(pass);
            // Counts of the first pass are the number of visible records. Later passes are dispatched by it.
            if i == 0 {
                pass.set_pipeline(&self.counts.pipeline);
                pass.set_bind_group(0, &groups.counts, &[]);
                pass.dispatch_workgroups(1, 1, 1);
            }
        }
    }
}

impl SortBuffers {
    /// Bytes of the largest buffer for `n_records`.
    pub fn largest(n_records: usize) -> u64 {
        let n = n_records as u64;
        // Keys or values, and the counts of each digit in each batch.
        (4 * n).max(4 * u64::from(N_DIGITS) * n.div_ceil(u64::from(SORT_BATCH)))
    }

    /// Buffers for up to `n_records`, at least one.
    pub fn new(device: &wgpu::Device, sort: &Sort, n_records: usize) -> Self {
        let buffer = |label, size, more| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | more;
            buffers::create(device, label, size, usage)
        };
        let none = wgpu::BufferUsages::empty();
        let bytes = 4 * n_records as u64;
        let keys = [(); 2].map(|()| buffer("splat_keys", bytes, wgpu::BufferUsages::COPY_DST));
        let values = [(); 2].map(|()| buffer("splat_record_indices", bytes, none));
        let n_batches = (n_records as u64).div_ceil(u64::from(SORT_BATCH));
        let batch_counts = buffer("splat_batch_counts", 4 * u64::from(N_DIGITS) * n_batches, none);
        let digit_counts = buffer("splat_digit_counts", 4 * u64::from(N_DIGITS), none);
        let counts = buffer("splat_counts", size_of::<SplatCounts>() as u64, wgpu::BufferUsages::COPY_DST);
        let commands =
            buffer("splat_commands", size_of::<SplatCommands>() as u64, wgpu::BufferUsages::INDIRECT);

        // Keys go back and forth between two buffers. After an even number of passes they are in the first one
        // again.
        let groups = Groups {
            histogram: std::array::from_fn(|i| {
                sort.histogram.bind(device, &[&sort.passes[i], &counts, &keys[i % 2], &batch_counts])
            }),
            scan: std::array::from_fn(|i| {
                sort.scan.bind(device, &[&sort.passes[i], &counts, &batch_counts, &digit_counts])
            }),
            scatter: std::array::from_fn(|i| {
                let (from, to) = (i % 2, (i + 1) % 2);
                let (into_pass, out) = ([&keys[from], &values[from]], [&keys[to], &values[to]]);
                let [keys_in, values_in] = into_pass;
                let [keys_out, values_out] = out;
                let of_pass = &sort.passes[i];
                let offsets = [&batch_counts, &digit_counts];
                sort.scatter.bind(
                    device,
                    &[of_pass, &counts, keys_in, values_in, offsets[0], offsets[1], keys_out, values_out],
                )
            }),
            counts: sort.counts.bind(device, &[&counts, &digit_counts, &commands]),
        };
        let ([keys, _], [record_indices, _]) = (keys, values);
        Self { keys, record_indices, counts, commands, groups }
    }
}

#[cfg(test)]
mod tests;
