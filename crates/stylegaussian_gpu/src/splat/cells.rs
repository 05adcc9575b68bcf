//! The draw on adapters that are a CPU: `splat_cells_*`, a list of splats for each square of pixels, blended by compute.
//!
//! Software walks every quad block by block and fetches and stores what is behind it each time. Here a pixel stays in
//! registers until it is finished, and eight invocations read a splat at once.

use glam::{UVec2, UVec4};
use stylegaussian_shaders::splat::{
    self as shaders, CELL, CELLS_OF_SEGMENT, IN_STEP, N_RUNS, ROUNDS_OF_RUN, RunProgress, SplatCells,
    SplatCommands,
};

use super::{
    LAYER_FORMAT,
    bind::{Kernel, bind_group, storage, uniform, whole},
    sort::SortBuffers,
};

/// Entries that the lists have room for, for each slot: footprints of 56 by 56 pixels.
const ENTRIES_OF_SLOT: u64 = 64;
/// Entries that the lists have room for, for each cell, where that is more: a few large splats cover it.
const ENTRIES_OF_CELL: u64 = 256;

/// The pipelines.
#[derive(Debug)]
pub(super) struct Cells {
    count: Kernel,
    scan: Kernel,
    total: Kernel,
    scatter: Kernel,
    /// Without and with a depth texture.
    blend: [Kernel; 2],
}

impl Cells {
    pub fn new(device: &wgpu::Device) -> Self {
        let of_view = uniform::<SplatCells>();
        let (read, write) = (storage(true), storage(false));
        let layer = wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: LAYER_FORMAT,
            view_dimension: wgpu::TextureViewDimension::D2,
        };
        let depth = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Depth,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let blended = [of_view, read, read, read, read, read, layer, depth];
        Self {
            count: Kernel::new(
                device,
                &shaders::cells_count(),
                &[of_view, read, read, read, read, write, write, write],
            ),
            scan: Kernel::new(device, &shaders::cells_scan(), &[of_view, write, write]),
            total: Kernel::new(device, &shaders::cells_total(), &[of_view, read, write, read, write]),
            scatter: Kernel::new(
                device,
                &shaders::cells_scatter(),
                &[of_view, read, read, read, write, read, write, write],
            ),
            blend: [
                Kernel::new(device, &shaders::cells_blend(false), &blended[..7]),
                Kernel::new(device, &shaders::cells_blend(true), &blended),
            ],
        }
    }

    /// Fills the lists with what was sorted, unless they hold it.
    pub fn fill(&self, encoder: &mut wgpu::CommandEncoder, buffers: &mut CellBuffers) {
        if std::mem::replace(&mut buffers.is_filled, true) {
            return;
        }
        encoder.clear_buffer(&buffers.run_counts, 0, Some(run_counts_bytes(buffers.n_cells)));
        encoder.clear_buffer(&buffers.progress[0], 0, None);
        encoder.clear_buffer(&buffers.progress[1], 0, None);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("splat_cells"),
            timestamp_writes: None,
        });
        let n_segments = (product(buffers.n_cells) as u32).div_ceil(CELLS_OF_SEGMENT);
        for (kernel, group, n_groups, n_times) in [
            (&self.count, &buffers.count, N_RUNS / IN_STEP, buffers.n_times),
            (&self.scan, &buffers.scan, n_segments.div_ceil(IN_STEP), 1),
            (&self.total, &buffers.total, 1, 1),
            (&self.scatter, &buffers.scatter, N_RUNS / IN_STEP, buffers.n_times),
        ] {
            pass.set_pipeline(&kernel.pipeline);
            pass.set_bind_group(0, group, &[]);
            for _ in 0..n_times {
                pass.dispatch_workgroups(n_groups, 1, 1);
            }
        }
    }

    /// Blends the lists into `layer`, tested against `depth` (reverse z) where there is one. Lists that did not fit are left
    /// to the quads.
    pub fn blend(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        buffers: &mut CellBuffers,
        layer: &wgpu::TextureView,
        depth: Option<&wgpu::TextureView>,
    ) {
        let kernel = &self.blend[usize::from(depth.is_some())];
        let textures = (layer.clone(), depth.cloned());
        if buffers.blend.as_ref().is_none_or(|(of, _)| *of != textures) {
            let group = buffers.bind_blend(device, kernel, layer, depth);
            buffers.blend = Some((textures, group));
        }
        let Some((_, group)) = &buffers.blend else { return };
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("splat_cells_blend"),
            timestamp_writes: None,
        });
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups_indirect(&buffers.commands, 0);
    }
}

/// The lists of one view.
#[derive(Debug)]
pub(super) struct CellBuffers {
    /// Cells that there is room for.
    n_reserved: u64,
    capacity: u32,
    viewport: UVec4,
    n_cells: UVec2,
    /// Whether the lists are those of what was sorted last.
    is_filled: bool,
    /// Dispatches after which runs are done whose lists fit, unless some are much longer than others.
    n_times: u32,
    uniforms: wgpu::Buffer,
    run_counts: wgpu::Buffer,
    segments: wgpu::Buffer,
    entries: wgpu::Buffer,
    /// `RunProgress` of the count and of the scatter `[run]`.
    progress: [wgpu::Buffer; 2],
    commands: wgpu::Buffer,
    records: [wgpu::Buffer; 2],
    count: wgpu::BindGroup,
    scan: wgpu::BindGroup,
    total: wgpu::BindGroup,
    scatter: wgpu::BindGroup,
    /// The layer and the depth texture of the last frame, bound.
    blend: Option<((wgpu::TextureView, Option<wgpu::TextureView>), wgpu::BindGroup)>,
}

/// Columns and rows of cells.
fn n_cells(viewport: UVec4) -> UVec2 {
    UVec2::new(viewport.z.div_ceil(CELL), viewport.w.div_ceil(CELL))
}

fn product(n_cells: UVec2) -> u64 {
    u64::from(n_cells.x) * u64::from(n_cells.y)
}

fn run_counts_bytes(n_cells: UVec2) -> u64 {
    4 * u64::from(N_RUNS) * product(n_cells)
}

impl CellBuffers {
    /// Lists for `viewport`, of up to `n_slots` splats whose `records` (places and looks) `sort` sorts.
    pub fn new(
        device: &wgpu::Device,
        cells: &Cells,
        sort: &SortBuffers,
        records: [wgpu::Buffer; 2],
        n_slots: usize,
        viewport: UVec4,
    ) -> Self {
        let n_cells = n_cells(viewport);
        let limit = device.limits().max_storage_buffer_binding_size / 4;
        let wanted = (ENTRIES_OF_SLOT * n_slots as u64).max(ENTRIES_OF_CELL * product(n_cells));
        let capacity = wanted.min(limit).min(u64::from(u32::MAX)) as u32;
        let buffer = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let written = wgpu::BufferUsages::COPY_DST;
        let uniforms =
            buffer("splat_cells", size_of::<SplatCells>() as u64, wgpu::BufferUsages::UNIFORM | written);
        let run_counts = buffer("splat_run_counts", run_counts_bytes(n_cells), storage | written);
        let n_segments = product(n_cells).div_ceil(u64::from(CELLS_OF_SEGMENT));
        let segments = buffer("splat_segments", 4 * n_segments, storage);
        let progress = [(); 2].map(|()| {
            let bytes = u64::from(N_RUNS) * size_of::<RunProgress>() as u64;
            buffer("splat_run_progress", bytes, storage | written)
        });
        let rounds = u64::from(capacity) + n_slots as u64;
        let n_times = rounds.div_ceil(u64::from(N_RUNS * ROUNDS_OF_RUN)) as u32 + 1;
        let reaches = buffer("splat_reaches", 8 * n_slots as u64, storage);
        let entries = buffer("splat_entries", 4 * u64::from(capacity), storage);
        let commands = buffer(
            "splat_cell_commands",
            size_of::<SplatCommands>() as u64,
            storage | wgpu::BufferUsages::INDIRECT,
        );
        let [places, looks] = &records;
        let (counts, slots) = (&sort.counts, &sort.slots);
        Self {
            n_reserved: product(n_cells),
            capacity,
            viewport: UVec4::ZERO,
            n_cells,
            is_filled: false,
            n_times,
            count: cells.count.bind(
                device,
                &[&uniforms, counts, slots, places, looks, &run_counts, &reaches, &progress[0]],
            ),
            scan: cells.scan.bind(device, &[&uniforms, &run_counts, &segments]),
            total: cells.total.bind(device, &[&uniforms, counts, &segments, &progress[0], &commands]),
            scatter: cells.scatter.bind(
                device,
                &[&uniforms, counts, slots, &reaches, &run_counts, &segments, &entries, &progress[1]],
            ),
            blend: None,
            uniforms,
            run_counts,
            segments,
            entries,
            progress,
            commands,
            records,
        }
    }

    /// Whether there is room for the cells of `viewport`.
    pub fn fits(&self, viewport: UVec4) -> bool {
        product(n_cells(viewport)) <= self.n_reserved
    }

    /// Tells the GPU where the picture is.
    pub fn set_viewport(&mut self, queue: &wgpu::Queue, viewport: UVec4) {
        if std::mem::replace(&mut self.viewport, viewport) == viewport {
            return;
        }
        self.n_cells = n_cells(viewport);
        self.is_filled = false;
        let contents = SplatCells {
            viewport: viewport.as_vec4().to_array(),
            n_cells: self.n_cells.to_array(),
            capacity: self.capacity,
            padding: 0,
        };
        queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&contents));
    }

    /// Says that others than the splats in the lists were sorted.
    pub fn empty(&mut self) {
        self.is_filled = false;
    }

    /// `SplatCommands`.
    pub fn commands(&self) -> &wgpu::Buffer {
        &self.commands
    }

    fn bind_blend(
        &self,
        device: &wgpu::Device,
        kernel: &Kernel,
        layer: &wgpu::TextureView,
        depth: Option<&wgpu::TextureView>,
    ) -> wgpu::BindGroup {
        let [places, looks] = &self.records;
        let mut resources: Vec<_> =
            [&self.uniforms, &self.run_counts, &self.segments, &self.entries, places, looks]
                .map(whole)
                .into();
        resources.push(wgpu::BindingResource::TextureView(layer));
        resources.extend(depth.map(wgpu::BindingResource::TextureView));
        bind_group(device, kernel.label, &kernel.layout, &resources)
    }
}

#[cfg(test)]
mod tests;
