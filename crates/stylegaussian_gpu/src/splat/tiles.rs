//! The draw on software adapters: `splat_tiles_*`, a list of splats for each tile of the picture, blended by
//! compute.
//!
//! Software rasterizers walk every quad block by block, and load and store the pixels behind it each time. Here
//! a pixel stays in registers until it is finished, and eight invocations share each read of a splat.
//!
//! The sorted splats are cut into *runs* of consecutive ones. `count`, `scan`, `total` and `scatter` enter them
//! into a list for each tile of 8x8 pixels that they reach. An invocation of `blend` then blends four rows of
//! four pixels front to back, against the depth that it reads as a texture. If the lists overflow, an indirect
//! draw of quads takes over within the same frame, without asking the CPU.

use std::sync::OnceLock;

use glam::{UVec2, UVec4};
use stylegaussian_shaders::splat::{
    self as shaders, ITERATIONS_PER_DISPATCH, N_RUNS, RunProgress, SOFTWARE_WORKGROUP, SplatCommands,
    SplatTiles, TILE_SIZE, TILES_PER_SEGMENT,
};

use super::{layer::LAYER_FORMAT, sort::SortBuffers, strokes::StrokeStage};
use crate::{
    bindings::{
        Kernel, bind_group, compute_pass, compute_pipeline, pipeline_layout, storage_binding,
        texture_binding, uniform_binding,
    },
    buffers,
    device::GpuEncoder,
};

/// Room in the lists for each record, in entries: footprints of 56 by 56 pixels, which touch at most 8 by 8
/// tiles.
const ENTRIES_PER_RECORD: u64 = 64;
/// Room in the lists for each tile, in entries, if that is more: for pictures that a few large splats cover.
const ENTRIES_PER_TILE: u64 = 256;

/// The pipelines.
#[derive(Debug)]
pub(super) struct Tiles {
    count: Kernel,
    scan: Kernel,
    total: Kernel,
    scatter: Kernel,
    /// Without and with a depth texture.
    blend: [Kernel; 2],
    /// The same with strokes, compiled when they are asked for.
    painted: OnceLock<[wgpu::ComputePipeline; 2]>,
}

impl Tiles {
    pub fn new(device: &wgpu::Device) -> Self {
        let uniforms = uniform_binding::<SplatTiles>();
        let (read, write) = (storage_binding(true), storage_binding(false));
        let layer = wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: LAYER_FORMAT,
            view_dimension: wgpu::TextureViewDimension::D2,
        };
        let depth = texture_binding(wgpu::TextureSampleType::Depth, wgpu::TextureViewDimension::D2);
        let blended = [uniforms, read, read, read, read, read, layer, depth];
        Self {
            count: Kernel::new(
                device,
                shaders::tiles_count(),
                &[uniforms, read, read, read, read, write, write, write],
            ),
            scan: Kernel::new(device, shaders::tiles_scan(), &[uniforms, write, write]),
            total: Kernel::new(device, shaders::tiles_total(), &[uniforms, read, write, read, write]),
            scatter: Kernel::new(
                device,
                shaders::tiles_scatter(),
                &[uniforms, read, read, read, write, read, write, write],
            ),
            blend: [
                Kernel::new(device, shaders::tiles_blend(false), &blended[..7]),
                Kernel::new(device, shaders::tiles_blend(true), &blended),
            ],
            painted: OnceLock::new(),
        }
    }

    /// The blends with strokes, which are compiled unless they are there.
    pub fn painted(&self, device: &wgpu::Device, strokes: &StrokeStage) -> &[wgpu::ComputePipeline; 2] {
        self.painted.get_or_init(|| {
            [false, true].map(|tested| {
                let source = shaders::strokes::tiles_blend(tested);
                let groups = [&self.blend[usize::from(tested)].layout, &strokes.draws(device).layout];
                let layout = pipeline_layout(device, source.label, &groups);
                compute_pipeline(device, source, &layout, wgpu::PipelineCompilationOptions::default())
            })
        })
    }

    /// Fills the lists with the sorted splats, unless they hold them already.
    pub fn fill(&self, encoder: &mut wgpu::CommandEncoder, lists: &mut TileLists) {
        if std::mem::replace(&mut lists.is_filled, true) {
            return;
        }
        // Counts and progress accumulate over dispatches. Buffers may be larger than this picture needs.
        encoder.clear_buffer(&lists.run_counts, 0, Some(run_counts_bytes(lists.n_tiles)));
        encoder.clear_buffer(&lists.progress[0], 0, None);
        encoder.clear_buffer(&lists.progress[1], 0, None);
        let mut pass = compute_pass(encoder, "splat_tiles");
        let n_segments = (product(lists.n_tiles) as u32).div_ceil(TILES_PER_SEGMENT);
        for (kernel, group, n_groups, n_times) in [
            (&self.count, &lists.count, N_RUNS / SOFTWARE_WORKGROUP, lists.n_times),
            (&self.scan, &lists.scan, n_segments.div_ceil(SOFTWARE_WORKGROUP), 1),
            (&self.total, &lists.total, 1, 1),
            (&self.scatter, &lists.scatter, N_RUNS / SOFTWARE_WORKGROUP, lists.n_times),
        ] {
            pass.set_pipeline(&kernel.pipeline);
            pass.set_bind_group(0, group, &[]);
            // Each dispatch goes on from the progress of the one before: see `ITERATIONS_PER_DISPATCH`.
            for _ in 0..n_times {
                pass.dispatch_workgroups(n_groups, 1, 1);
            }
        }
    }

    /// Blends the lists into `layer`. If `depth` (reverse z) is given, splats behind it are hidden. `strokes`
    /// is the group of draws with strokes, if there are any. Lists that did not fit are left to the quads.
    pub fn blend(
        &self,
        gpu: &mut GpuEncoder,
        lists: &mut TileLists,
        (layer, depth): (&wgpu::TextureView, Option<&wgpu::TextureView>),
        strokes: Option<(&StrokeStage, &wgpu::BindGroup)>,
    ) {
        let tested = usize::from(depth.is_some());
        let kernel = &self.blend[tested];
        let textures = (layer.clone(), depth.cloned());
        // Textures change if a window is resized, but hardly otherwise.
        if !lists.blends.iter().any(|(of, _)| *of == textures) {
            let group = lists.bind_blend(gpu.device, kernel, layer, depth);
            // The layers of both sides of edges are blended from the same lists.
            lists.blends.truncate(1);
            lists.blends.insert(0, (textures.clone(), group));
        }
        let Some((_, group)) = lists.blends.iter().find(|(of, _)| *of == textures) else { return };
        let mut pass = compute_pass(gpu.encoder, "splat_tiles_blend");
        match strokes {
            None => pass.set_pipeline(&kernel.pipeline),
            Some((stage, of_strokes)) => {
                pass.set_pipeline(&self.painted(gpu.device, stage)[tested]);
                pass.set_bind_group(1, of_strokes, &[]);
            }
        }
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups_indirect(&lists.commands, 0);
    }
}

/// The lists of one view.
#[derive(Debug)]
pub(super) struct TileLists {
    /// Tiles that there is room for.
    n_reserved: u64,
    capacity: u32,
    viewport: UVec4,
    n_tiles: UVec2,
    /// Whether the lists hold the splats that were sorted last.
    is_filled: bool,
    /// Dispatches that finish all runs if the lists fit, unless some runs are much longer than others.
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
    /// The last two layers and their depth textures, bound.
    blends: Vec<((wgpu::TextureView, Option<wgpu::TextureView>), wgpu::BindGroup)>,
}

/// Columns and rows of tiles.
fn n_tiles(viewport: UVec4) -> UVec2 {
    UVec2::new(viewport.z.div_ceil(TILE_SIZE), viewport.w.div_ceil(TILE_SIZE))
}

fn product(n_tiles: UVec2) -> u64 {
    u64::from(n_tiles.x) * u64::from(n_tiles.y)
}

fn run_counts_bytes(n_tiles: UVec2) -> u64 {
    4 * u64::from(N_RUNS) * product(n_tiles)
}

impl TileLists {
    /// Lists for `viewport`, of up to `n_records` splats. `records` are their geometry and color halves, in the
    /// order of `sort`.
    pub fn new(
        device: &wgpu::Device,
        tiles: &Tiles,
        sort: &SortBuffers,
        records: [wgpu::Buffer; 2],
        n_records: usize,
        viewport: UVec4,
    ) -> Self {
        let n_tiles = n_tiles(viewport);
        // In entries of 4 bytes.
        let limit = device.limits().max_storage_buffer_binding_size / 4;
        let wanted = (ENTRIES_PER_RECORD * n_records as u64).max(ENTRIES_PER_TILE * product(n_tiles));
        let capacity = wanted.min(limit).min(u64::from(u32::MAX)) as u32;
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let written = wgpu::BufferUsages::COPY_DST;
        let uniforms = buffers::uniforms(device, "splat_tiles", size_of::<SplatTiles>() as u64);
        let run_counts =
            buffers::create(device, "splat_run_counts", run_counts_bytes(n_tiles), storage | written);
        let n_segments = product(n_tiles).div_ceil(u64::from(TILES_PER_SEGMENT));
        let segments = buffers::create(device, "splat_segments", 4 * n_segments, storage);
        let progress = [(); 2].map(|()| {
            let bytes = u64::from(N_RUNS) * size_of::<RunProgress>() as u64;
            buffers::create(device, "splat_run_progress", bytes, storage | written)
        });
        // An iteration for each entry and each splat. Runs differ in length, so one dispatch more than the mean
        // needs.
        let iterations = u64::from(capacity) + n_records as u64;
        let n_times = iterations.div_ceil(u64::from(N_RUNS * ITERATIONS_PER_DISPATCH)) as u32 + 1;
        let reaches = buffers::create(device, "splat_reaches", 8 * n_records as u64, storage);
        let entries = buffers::create(device, "splat_entries", 4 * u64::from(capacity), storage);
        let commands = buffers::create(
            device,
            "splat_tile_commands",
            size_of::<SplatCommands>() as u64,
            storage | wgpu::BufferUsages::INDIRECT,
        );
        let [geometry, color] = &records;
        let (counts, record_indices) = (&sort.counts, &sort.record_indices);
        Self {
            n_reserved: product(n_tiles),
            capacity,
            viewport: UVec4::ZERO,
            n_tiles,
            is_filled: false,
            n_times,
            count: tiles.count.bind(
                device,
                &[&uniforms, counts, record_indices, geometry, color, &run_counts, &reaches, &progress[0]],
            ),
            scan: tiles.scan.bind(device, &[&uniforms, &run_counts, &segments]),
            total: tiles.total.bind(device, &[&uniforms, counts, &segments, &progress[0], &commands]),
            scatter: tiles.scatter.bind(
                device,
                &[
                    &uniforms,
                    counts,
                    record_indices,
                    &reaches,
                    &run_counts,
                    &segments,
                    &entries,
                    &progress[1],
                ],
            ),
            blends: Vec::new(),
            uniforms,
            run_counts,
            segments,
            entries,
            progress,
            commands,
            records,
        }
    }

    /// Whether there is room for the tiles of `viewport`.
    pub fn fits(&self, viewport: UVec4) -> bool {
        product(n_tiles(viewport)) <= self.n_reserved
    }

    /// Uploads the place of the picture, if it changed.
    pub fn set_viewport(&mut self, queue: &wgpu::Queue, viewport: UVec4) {
        if std::mem::replace(&mut self.viewport, viewport) == viewport {
            return;
        }
        self.n_tiles = n_tiles(viewport);
        self.is_filled = false;
        let contents = SplatTiles {
            viewport: viewport.as_vec4().to_array(),
            n_tiles: self.n_tiles.to_array(),
            capacity: self.capacity,
            padding: 0,
        };
        queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&contents));
    }

    /// Marks the lists as stale, because other splats were sorted.
    pub fn empty(&mut self) {
        self.is_filled = false;
    }

    /// `SplatCommands`.
    pub fn commands(&self) -> &wgpu::Buffer {
        &self.commands
    }

    /// What a blend reads: uniforms, ends of runs, segments, entries, and both halves of the records.
    pub fn buffers(&self) -> [&wgpu::Buffer; 6] {
        let [geometry, color] = &self.records;
        [&self.uniforms, &self.run_counts, &self.segments, &self.entries, geometry, color]
    }

    fn bind_blend(
        &self,
        device: &wgpu::Device,
        kernel: &Kernel,
        layer: &wgpu::TextureView,
        depth: Option<&wgpu::TextureView>,
    ) -> wgpu::BindGroup {
        let mut resources: Vec<_> = self.buffers().map(wgpu::Buffer::as_entire_binding).into();
        resources.push(wgpu::BindingResource::TextureView(layer));
        resources.extend(depth.map(wgpu::BindingResource::TextureView));
        bind_group(device, kernel.label, &kernel.layout, &resources)
    }
}

#[cfg(test)]
mod tests;
