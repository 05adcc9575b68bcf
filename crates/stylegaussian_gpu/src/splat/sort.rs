//! The sort stage on the GPU: `splat_sort_*`, a stable radix sort of what is visible.

use stylegaussian_shaders::splat::{
    self as shaders, IN_STEP, N_DIGITS, SortPass, SplatCommands, SplatCounts, TILE,
};
use wgpu::util::DeviceExt;

use super::bind::{Kernel, storage, uniform};

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

/// Keys and values on their way through the sort, for up to a number of slots.
#[derive(Debug)]
pub(super) struct SortBuffers {
    /// Where keys go in `[slot]`; overwritten by the sort.
    pub keys: wgpu::Buffer,
    /// Where slots come out, by ascending key `[n_visible]`.
    pub slots: wgpu::Buffer,
    /// `SplatCounts`.
    pub counts: wgpu::Buffer,
    /// `SplatCommands`, for indirect commands.
    pub commands: wgpu::Buffer,
    groups: Groups,
}

#[derive(Debug)]
struct Groups {
    histogram: [wgpu::BindGroup; N_PASSES],
    scan: [wgpu::BindGroup; N_PASSES],
    scatter: [wgpu::BindGroup; N_PASSES],
    counts: wgpu::BindGroup,
}

impl Sort {
    /// The kernels that are fastest on the adapter: those of a GPU wait for one another within a workgroup, which a CPU
    /// pays for by switching between the invocations it stands for.
    pub fn new(device: &wgpu::Device) -> Self {
        Self::of_kind(device, is_software(&device.adapter_info()))
    }

    /// The kernels of which one invocation handles a whole tile, or those of which many do.
    pub fn of_kind(device: &wgpu::Device, serial: bool) -> Self {
        let of_pass = uniform::<SortPass>();
        let (read, write) = (storage(true), storage(false));
        Self {
            histogram: Kernel::new(device, &shaders::sort_histogram(serial), &[of_pass, read, read, write]),
            scan: Kernel::new(device, &shaders::sort_scan(serial), &[of_pass, read, write, write]),
            scatter: Kernel::new(
                device,
                &shaders::sort_scatter(serial),
                &[of_pass, read, read, read, read, read, write, write],
            ),
            counts: Kernel::new(device, &shaders::sort_counts(), &[write, read, write]),
            n_scans: if serial { N_DIGITS / IN_STEP } else { N_DIGITS },
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

    /// Sorts the slots whose keys are not `INVISIBLE`, stably, and counts them. `n_slots` is what the CPU wrote into
    /// `SplatCounts`, at most what the buffers are for.
    pub fn encode(&self, pass: &mut wgpu::ComputePass, buffers: &SortBuffers, n_slots: u32) {
        let groups = &buffers.groups;
        for i in 0..N_PASSES {
            // Only the first pass sees every slot; the CPU does not know how many are left after it.
            let dispatch_tiles = |pass: &mut wgpu::ComputePass| match i {
                0 => pass.dispatch_workgroups(n_slots.div_ceil(TILE), 1, 1),
                _ => pass.dispatch_workgroups_indirect(&buffers.commands, 0),
            };
            pass.set_pipeline(&self.histogram.pipeline);
            pass.set_bind_group(0, &groups.histogram[i], &[]);
            dispatch_tiles(pass);
            pass.set_pipeline(&self.scan.pipeline);
            pass.set_bind_group(0, &groups.scan[i], &[]);
            pass.dispatch_workgroups(self.n_scans, 1, 1);
            pass.set_pipeline(&self.scatter.pipeline);
            pass.set_bind_group(0, &groups.scatter[i], &[]);
            dispatch_tiles(pass);
            if i == 0 {
                pass.set_pipeline(&self.counts.pipeline);
                pass.set_bind_group(0, &groups.counts, &[]);
                pass.dispatch_workgroups(1, 1, 1);
            }
        }
    }
}

impl SortBuffers {
    /// Bytes of the largest buffer for `n_slots`.
    pub fn largest(n_slots: usize) -> u64 {
        let n = n_slots as u64;
        (4 * n).max(4 * u64::from(N_DIGITS) * n.div_ceil(u64::from(TILE)))
    }

    /// Buffers for up to `n_slots`, at least one.
    pub fn new(device: &wgpu::Device, sort: &Sort, n_slots: usize) -> Self {
        let usages = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let buffer = |label, size, more| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: usages | more,
                mapped_at_creation: false,
            })
        };
        let none = wgpu::BufferUsages::empty();
        let bytes = 4 * n_slots as u64;
        let keys = [(); 2].map(|()| buffer("splat_keys", bytes, wgpu::BufferUsages::COPY_DST));
        let values = [(); 2].map(|()| buffer("splat_slots", bytes, none));
        let n_tiles = (n_slots as u64).div_ceil(u64::from(TILE));
        let tile_counts = buffer("splat_tile_counts", 4 * u64::from(N_DIGITS) * n_tiles, none);
        let digit_counts = buffer("splat_digit_counts", 4 * u64::from(N_DIGITS), none);
        let counts = buffer("splat_counts", size_of::<SplatCounts>() as u64, wgpu::BufferUsages::COPY_DST);
        let commands =
            buffer("splat_commands", size_of::<SplatCommands>() as u64, wgpu::BufferUsages::INDIRECT);

        // Keys go to and fro; after an even number of passes they are back.
        let groups = Groups {
            histogram: std::array::from_fn(|i| {
                sort.histogram.bind(device, &[&sort.passes[i], &counts, &keys[i % 2], &tile_counts])
            }),
            scan: std::array::from_fn(|i| {
                sort.scan.bind(device, &[&sort.passes[i], &counts, &tile_counts, &digit_counts])
            }),
            scatter: std::array::from_fn(|i| {
                let (from, to) = (i % 2, (i + 1) % 2);
                let (into_pass, out) = ([&keys[from], &values[from]], [&keys[to], &values[to]]);
                let [keys_in, values_in] = into_pass;
                let [keys_out, values_out] = out;
                let of_pass = &sort.passes[i];
                let offsets = [&tile_counts, &digit_counts];
                sort.scatter.bind(
                    device,
                    &[of_pass, &counts, keys_in, values_in, offsets[0], offsets[1], keys_out, values_out],
                )
            }),
            counts: sort.counts.bind(device, &[&counts, &digit_counts, &commands]),
        };
        let ([keys, _], [slots, _]) = (keys, values);
        Self { keys, slots, counts, commands, groups }
    }
}

#[cfg(test)]
mod tests;
