//! What one view keeps from frame to frame: buffers that only grow, and bindings for what it shows.

use std::collections::HashMap;

use stylegaussian_shaders::splat::{BY_DISTANCE, SplatChunk, SplatCounts, SplatDraw, TILE};

use super::{
    Camera, SplatError, SplatPass,
    bind::{bind_group, whole},
    cells::{CellBuffers, Cells},
    project::Project,
    sort::SortBuffers,
};

/// Bytes of one half of a record.
const HALF_RECORD: u64 = 16;

/// From one chunk's uniforms to the next one's: what every device aligns dynamic offsets to.
const UNIFORM_STRIDE: usize = 256;

/// Workgroups in one dimension of a dispatch, by WebGPU's default limits: the sort's.
const MAX_TILES: u64 = 65_535;

/// One view of the splat pass: a camera, or one of its pictures. Memory grows to the largest number of Gaussians seen
/// and stays; drop the view to give it back.
#[derive(Debug, Default)]
pub struct SplatView {
    buffers: Option<ViewBuffers>,
    chunk_uniforms: Option<ChunkUniforms>,
    bindings: HashMap<ChunkBindings, Cached>,
    /// This frame's chunks: Gaussians and bindings of each.
    chunks: Vec<(u32, wgpu::BindGroup)>,
    /// This frame's uniforms, one chunk every `UNIFORM_STRIDE` bytes.
    staging: Vec<u8>,
    /// What this frame is made of, and what the records on the GPU were made of.
    sources: Vec<ChunkSource>,
    drawn: Vec<ChunkSource>,
    /// Left, top, width and height in pixels; `None` while there is nothing to draw.
    viewport: Option<glam::UVec4>,
}

/// The buffers whose size goes with the number of slots.
#[derive(Debug)]
struct ViewBuffers {
    n_slots: usize,
    places: wgpu::Buffer,
    looks: wgpu::Buffer,
    draw_uniforms: wgpu::Buffer,
    sort: SortBuffers,
    draw_group: wgpu::BindGroup,
    /// What the GPU has been told: slots in use, viewport.
    told: Option<(u32, glam::UVec4)>,
    /// Once a layer was drawn by cells.
    cells: Option<CellBuffers>,
}

#[derive(Debug)]
struct ChunkUniforms {
    buffer: wgpu::Buffer,
    group: wgpu::BindGroup,
}

/// The buffers that a chunk is projected from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct ChunkBindings(pub [wgpu::Buffer; 4]);

/// All that a chunk's records follow from.
#[derive(Clone, Debug, PartialEq)]
struct ChunkSource {
    uniforms: SplatChunk,
    buffers: ChunkBindings,
    /// Versions of both color sources.
    colors: [u64; 2],
}

/// How a frame differs from the one whose records are on the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// Not at all.
    Nothing,
    /// Only in colors: what is visible, and its order, stay.
    Colors,
    /// Anything else.
    Order,
}

impl ChunkSource {
    /// The uniforms without what only colors follow from.
    fn placed(&self) -> SplatChunk {
        let flags = self.uniforms.flags & BY_DISTANCE;
        SplatChunk { eye: [0.0; 4], fade: 0.0, flags, ..self.uniforms }
    }

    fn is_placed_like(&self, other: &Self) -> bool {
        self.placed() == other.placed() && self.buffers.0[0] == other.buffers.0[0]
    }
}

#[derive(Debug)]
struct Cached {
    group: wgpu::BindGroup,
    in_use: bool,
}

/// One dispatch of the project kernel.
pub(super) struct ChunkDispatch<'a> {
    /// Of the chunk's uniforms, in bytes.
    pub offset: u32,
    pub n_gaussians: u32,
    pub bind_group: &'a wgpu::BindGroup,
}

impl SplatView {
    /// A view that holds nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Bytes of the largest buffer that a view of `n_gaussians` needs.
    pub fn record_bytes(n_gaussians: usize) -> u64 {
        (HALF_RECORD * n_gaussians as u64).max(SortBuffers::largest(n_gaussians))
    }

    /// Bytes of GPU memory that a view of `n_gaussians` takes.
    pub fn bytes(n_gaussians: usize) -> u64 {
        let per_slot = 2 * HALF_RECORD + 4 * size_of::<u32>() as u64;
        per_slot * n_gaussians as u64 + 1024 * (n_gaussians as u64).div_ceil(u64::from(TILE))
    }

    /// The largest buffer that can be bound, in bytes.
    pub(crate) fn binding_limit(device: &wgpu::Device) -> u64 {
        let limits = device.limits();
        // Past that many tiles the sort would need a second dimension.
        let sortable = MAX_TILES * u64::from(TILE) * HALF_RECORD;
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(sortable)
    }

    /// Counts of this view on the GPU: `u32` slots, `u32` visible splats; can be copied from. `None` before the first
    /// frame that shows something.
    pub fn counts(&self) -> Option<&wgpu::Buffer> {
        self.buffers.as_ref().map(|buffers| &buffers.sort.counts)
    }

    /// Forgets what was prepared.
    pub(super) fn clear(&mut self) {
        self.viewport = None;
        self.chunks.clear();
        self.staging.clear();
        self.sources.clear();
        self.bindings.values_mut().for_each(|cached| cached.in_use = false);
    }

    /// Lets go of everything that the last frame was made from: nothing is shown.
    pub(super) fn forget_all(&mut self) {
        self.drawn.clear();
        self.forget_unused();
    }

    /// Lets go of everything that was not bound since [`clear`](Self::clear).
    pub(super) fn forget_unused(&mut self) {
        self.bindings.retain(|_, cached| cached.in_use);
    }

    /// Sees to it that there is room for `n_slots` records.
    pub(super) fn reserve(
        &mut self,
        device: &wgpu::Device,
        pass: &SplatPass,
        n_slots: usize,
    ) -> Result<(), SplatError> {
        let (found, limit) = (Self::record_bytes(n_slots), Self::binding_limit(device));
        if found > limit {
            return Err(SplatError::TooManyGaussians { n_gaussians: n_slots, found, limit });
        }
        if self.buffers.as_ref().is_none_or(|buffers| buffers.n_slots < n_slots) {
            self.buffers = None;
            self.drawn.clear();
            // Its bindings name the old buffers.
            self.chunk_uniforms = None;
            self.buffers = Some(ViewBuffers::new(device, pass, n_slots));
        }
        Ok(())
    }

    /// Tells the GPU how many slots are in use and where the picture is.
    pub(super) fn set_camera(&mut self, queue: &wgpu::Queue, camera: &Camera, n_slots: u32) {
        self.viewport = Some(camera.viewport);
        let Some(buffers) = &mut self.buffers else { return };
        let now = Some((n_slots, camera.viewport));
        if buffers.told != now {
            let counts = SplatCounts { n_slots, n_visible: 0 };
            queue.write_buffer(&buffers.sort.counts, 0, bytemuck::bytes_of(&counts));
            let draw = SplatDraw { viewport: camera.viewport.as_vec4().to_array() };
            queue.write_buffer(&buffers.draw_uniforms, 0, bytemuck::bytes_of(&draw));
            buffers.told = now;
        }
    }

    /// Sees to it that there is room for the uniforms of `n_chunks`.
    pub(super) fn reserve_chunks(&mut self, device: &wgpu::Device, project: &Project, n_chunks: usize) {
        let size = (UNIFORM_STRIDE * n_chunks) as u64;
        let fits = |uniforms: &ChunkUniforms| uniforms.buffer.size() >= size;
        let Some(buffers) = &self.buffers else { return };
        if !self.chunk_uniforms.as_ref().is_some_and(fits) {
            self.chunk_uniforms = Some(ChunkUniforms::new(device, project, buffers, size));
        }
    }

    /// Adds a chunk to this frame; `bind` makes its bindings where there are none yet.
    pub(super) fn push_chunk(
        &mut self,
        uniforms: &SplatChunk,
        key: ChunkBindings,
        colors: [u64; 2],
        bind: impl FnOnce(&ChunkBindings) -> wgpu::BindGroup,
    ) {
        self.staging.resize(self.chunks.len() * UNIFORM_STRIDE, 0);
        self.staging.extend_from_slice(bytemuck::bytes_of(uniforms));
        self.sources.push(ChunkSource { uniforms: *uniforms, buffers: key.clone(), colors });
        let cached = self.bindings.entry(key);
        let cached = cached.or_insert_with_key(|key| Cached { group: bind(key), in_use: true });
        cached.in_use = true;
        self.chunks.push((uniforms.n_gaussians, cached.group.clone()));
    }

    /// Hands the uniforms of this frame's chunks to the GPU, where they changed.
    pub(super) fn write_chunks(&mut self, queue: &wgpu::Queue) -> Change {
        let change = self.change();
        if change != Change::Nothing
            && let Some(uniforms) = &self.chunk_uniforms
        {
            queue.write_buffer(&uniforms.buffer, 0, &self.staging);
        }
        std::mem::swap(&mut self.sources, &mut self.drawn);
        self.forget_unused();
        change
    }

    fn change(&self) -> Change {
        let mut pairs = self.sources.iter().zip(&self.drawn);
        if self.sources == self.drawn {
            Change::Nothing
        } else if self.sources.len() == self.drawn.len() && pairs.all(|(new, old)| new.is_placed_like(old)) {
            Change::Colors
        } else {
            Change::Order
        }
    }

    /// This frame's dispatches of the project kernel, with the group that goes with each.
    pub(super) fn chunk_dispatches(&self) -> impl Iterator<Item = (&wgpu::BindGroup, ChunkDispatch<'_>)> {
        self.chunk_uniforms.iter().flat_map(|uniforms| {
            self.chunks.iter().enumerate().map(|(i, (n_gaussians, bind_group))| {
                let offset = (i * UNIFORM_STRIDE) as u32;
                (&uniforms.group, ChunkDispatch { offset, n_gaussians: *n_gaussians, bind_group })
            })
        })
    }

    /// The sort's buffers, once there are any.
    pub(super) fn sort(&self) -> Option<&SortBuffers> {
        self.buffers.as_ref().map(|buffers| &buffers.sort)
    }

    /// What the draw binds and where it draws; `None` where nothing was prepared.
    pub(super) fn to_draw(&self) -> Option<(&wgpu::BindGroup, &wgpu::Buffer, glam::UVec4)> {
        let buffers = self.buffers.as_ref()?;
        Some((&buffers.draw_group, &buffers.sort.commands, self.viewport?))
    }

    /// The lists for the picture's cells, and the draw for what does not fit; `None` where nothing was prepared.
    pub(super) fn lists(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        cells: &Cells,
    ) -> Option<&mut CellBuffers> {
        let (buffers, viewport) = (self.buffers.as_mut()?, self.viewport?);
        if buffers.cells.as_ref().is_none_or(|lists| !lists.fits(viewport)) {
            let records = [buffers.places.clone(), buffers.looks.clone()];
            let (sort, n_slots) = (&buffers.sort, buffers.n_slots);
            buffers.cells = Some(CellBuffers::new(device, cells, sort, records, n_slots, viewport));
        }
        let lists = buffers.cells.as_mut()?;
        lists.set_viewport(queue, viewport);
        Some(lists)
    }

    /// Says that the order of the splats is about to be another.
    pub(super) fn empty_cells(&mut self) {
        if let Some(lists) = self.buffers.as_mut().and_then(|buffers| buffers.cells.as_mut()) {
            lists.empty();
        }
    }

    /// Everything that was allocated: buffers, and bindings of chunks.
    #[cfg(test)]
    pub(super) fn resources(&self) -> (Vec<wgpu::Buffer>, std::collections::BTreeSet<wgpu::BindGroup>) {
        let uniforms = self.chunk_uniforms.iter().map(|uniforms| &uniforms.buffer);
        let of_view = self.buffers.iter().flat_map(|b| [&b.places, &b.looks, &b.draw_uniforms, &b.sort.keys]);
        let groups = self.bindings.values().map(|cached| cached.group.clone());
        (uniforms.chain(of_view).cloned().collect(), groups.collect())
    }

    /// Both halves of the records.
    #[cfg(test)]
    pub(super) fn records(&self) -> Option<(&wgpu::Buffer, &wgpu::Buffer)> {
        self.buffers.as_ref().map(|buffers| (&buffers.places, &buffers.looks))
    }
}

impl ViewBuffers {
    fn new(device: &wgpu::Device, pass: &SplatPass, n_slots: usize) -> Self {
        let buffer = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let records = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let places = buffer("splat_places", HALF_RECORD * n_slots as u64, records);
        let looks = buffer("splat_looks", HALF_RECORD * n_slots as u64, records);
        let uniforms = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let draw_uniforms = buffer("splat_draw", size_of::<SplatDraw>() as u64, uniforms);
        let sort = SortBuffers::new(device, &pass.sort, n_slots);
        let resources = [&draw_uniforms, &sort.counts, &sort.slots, &places, &looks].map(whole);
        let draw_group = bind_group(device, "splat_draw", &pass.draw.layout, &resources);
        Self { n_slots, places, looks, draw_uniforms, sort, draw_group, told: None, cells: None }
    }
}

impl ChunkUniforms {
    fn new(device: &wgpu::Device, project: &Project, buffers: &ViewBuffers, size: u64) -> Self {
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("splat_project_view"),
            size,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let one_chunk = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &buffer,
            offset: 0,
            size: wgpu::BufferSize::new(size_of::<SplatChunk>() as u64),
        });
        let records = [&buffers.sort.keys, &buffers.places, &buffers.looks].map(whole);
        let [keys, places, looks] = records;
        let resources = [one_chunk, keys, places, looks];
        let group = bind_group(device, "splat_project_view", &project.view_layout, &resources);
        Self { buffer, group }
    }
}
