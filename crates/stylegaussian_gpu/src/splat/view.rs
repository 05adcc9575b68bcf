//! The state that one view keeps from frame to frame: buffers that only grow, and bindings for the clouds it
//! shows.

use std::collections::HashMap;

use stylegaussian_shaders::splat::{
    ANTIALIASED, BY_DISTANCE, CROPPED, HALF_SIZE, SORT_BATCH, SplatChunk, SplatCounts, SplatDraw, SplatEdges,
    strokes::{StrokeChunk, StrokeDraw},
};

use super::{
    camera::Camera,
    cloud::Cloud,
    edges::edges_of,
    error::SplatError,
    light::{LightBuffers, LitView, ViewLight},
    memory::{HALF_RECORD, record_bytes, record_limit},
    sort::{Sort, SortBuffers},
    strokes::{StrokeStage, ViewStrokes},
    tiles::{TileLists, Tiles},
};
use crate::{
    bindings::stride,
    buffers::{TooLarge, Uniforms},
};

mod eyes;
mod fades;
mod half;
mod records;

use self::half::HalfState;
use eyes::EyeState;
use fades::Fades;
pub(super) use fades::faded_flags;
use records::{ChunkUniforms, ViewBuffers};

/// Bytes from one chunk's uniforms to the next one's.
const UNIFORM_STRIDE: usize = stride::<StrokeChunk>();

/// One view of the splat pass: a camera, or one of its pictures. Memory grows to the largest number of
/// Gaussians seen and stays. Drop the view to give it back.
#[derive(Debug, Default)]
pub struct SplatView {
    buffers: Option<ViewBuffers>,
    chunk_uniforms: Option<ChunkUniforms>,
    bindings: HashMap<ChunkBindings, Cached>,
    /// This frame's chunks: Gaussians and bindings of each, and whether a mask is among these.
    chunks: Vec<(u32, ChunkGroups, bool)>,
    /// This frame's uniforms, one chunk every `UNIFORM_STRIDE` bytes.
    staging: Vec<u8>,
    /// The sources of this frame's records.
    sources: Vec<ChunkSource>,
    /// The sources of the records that are on the GPU.
    drawn: Vec<ChunkSource>,
    /// Left, top, width and height in pixels; `None` if there is nothing to draw.
    pub(super) viewport: Option<glam::UVec4>,
    /// Whether this frame shows clouds with strokes.
    is_painted: bool,
    /// Tints, shadows, fog and atmosphere.
    pub(super) lit: LitView,
    /// Shares of opacities that are faded out.
    fades: Fades,
    /// A number that differs after each change of the visible splats or their order.
    order: u64,
    /// The limits of edges, once a layer with several samples per pixel was drawn.
    edges: Option<Uniforms<SplatEdges>>,
    /// The state that this view shares with that of another eye.
    eyes: EyeState,
    /// The state of a view at half its width and height.
    half: HalfState,
}

/// The buffers that a chunk is projected from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct ChunkBindings {
    /// Gaussians, spherical harmonics, colors.
    pub buffers: [wgpu::Buffer; 3],
    /// The weights that hide Gaussians.
    pub mask: Option<wgpu::Buffer>,
    /// Words and seeds of strokes.
    pub strokes: Option<[wgpu::Buffer; 2]>,
}

/// The bindings of a chunk.
#[derive(Clone, Debug)]
pub(super) struct ChunkGroups {
    /// For the project kernel.
    pub project: wgpu::BindGroup,
    /// For `splat_strokes`.
    pub strokes: Option<wgpu::BindGroup>,
}

/// Numbers that differ after each change of a chunk's inputs to projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChunkVersions {
    /// Version of the colors.
    pub colors: u64,
    /// Version of the mask.
    pub mask: u64,
    /// Version of the strokes.
    pub strokes: u64,
}

/// Everything that determines a chunk's records.
#[derive(Clone, Debug, PartialEq)]
struct ChunkSource {
    uniforms: StrokeChunk,
    bindings: ChunkBindings,
    versions: ChunkVersions,
}

/// The difference between a frame and the one that made the records on the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Change {
    /// There is none.
    Nothing,
    /// Only colors or strokes differ. The visible splats and their order are the same.
    Colors,
    /// Anything else differs, so that the order may, too.
    Order,
}

impl ChunkSource {
    /// The uniforms without those that only colors depend on.
    fn geometry(&self) -> SplatChunk {
        // The other flag is about colors.
        let chunk = self.uniforms.chunk;
        let flags = chunk.flags & (BY_DISTANCE | ANTIALIASED | CROPPED | HALF_SIZE);
        SplatChunk { eye: [0.0; 4], flags, ..chunk }
    }

    fn has_geometry_of(&self, other: &Self) -> bool {
        let faded = |source: &Self| fades::of_flags(source.uniforms.chunk.flags);
        self.geometry() == other.geometry()
            && faded(self) == faded(other)
            && self.bindings.buffers[0] == other.bindings.buffers[0]
            && self.bindings.mask == other.bindings.mask
            && self.versions.mask == other.versions.mask
    }
}

#[derive(Debug)]
struct Cached {
    groups: ChunkGroups,
    in_use: bool,
}

/// One dispatch of a kernel over a chunk.
pub(super) struct ChunkDispatch<'a> {
    /// Offset of the chunk's uniforms, in bytes.
    pub offset: u32,
    pub n_gaussians: u32,
    pub bind_group: &'a wgpu::BindGroup,
    /// Whether a mask is bound.
    pub is_masked: bool,
}

/// The input of the draw by quads.
pub(super) struct DrawSource<'a> {
    /// The group of the draw's layout.
    pub bind_group: &'a wgpu::BindGroup,
    /// The group of draws with strokes, if there are any.
    pub strokes: Option<&'a wgpu::BindGroup>,
    /// `SplatCommands` for all visible splats.
    pub commands: &'a wgpu::Buffer,
    /// Left, top, width and height in pixels.
    pub viewport: glam::UVec4,
}

/// The sorted records of a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sorted<'a> {
    pub counts: &'a wgpu::Buffer,
    pub record_indices: &'a wgpu::Buffer,
    pub color_halves: &'a wgpu::Buffer,
}

impl SplatView {
    /// A view that holds nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Bytes of the largest buffer that a view of `n_gaussians` needs.
    pub fn record_bytes(n_gaussians: usize) -> u64 {
        record_bytes(n_gaussians)
    }

    /// Bytes of GPU memory that a view of `n_gaussians` takes. Strokes take 16 more for each of them, and 32
    /// with relief.
    pub fn bytes(n_gaussians: usize) -> u64 {
        // Both halves, then keys and values, twice each.
        let per_record = 2 * HALF_RECORD + 4 * size_of::<u32>() as u64;
        // A count of 4 bytes for each of 256 digits of a batch.
        per_record * n_gaussians as u64 + 1024 * (n_gaussians as u64).div_ceil(u64::from(SORT_BATCH))
    }

    /// Sets tints, shadows, fog and atmosphere for all frames until the next call. Without any, which is the
    /// default, they cost nothing.
    pub fn set_light(&mut self, light: Option<ViewLight>) {
        self.lit.set(light);
    }

    /// Fades clouds, for all frames until the next call: the shares of their opacities that are left out, 0..1,
    /// in the order in which clouds are given. Those beyond the last one, and by default all, are drawn whole.
    pub fn set_faded(&mut self, shares: Vec<f32>) {
        self.fades.wanted = shares;
    }

    /// Notes which of the clouds are drawn in this frame.
    pub(super) fn note_drawn(&mut self, clouds: &[Cloud]) {
        self.fades.note_drawn(clouds);
    }

    /// The flags of a chunk of the i-th cloud that is drawn, with its fade.
    pub(super) fn with_fade(&self, i: usize, flags: u32) -> u32 {
        self.fades.on(i, flags)
    }

    /// What is an edge for `camera`, and the whole picture's viewport; `None` if there is nothing to draw.
    pub(super) fn edges(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        camera: &Camera,
    ) -> Option<(&wgpu::Buffer, glam::UVec4)> {
        let drawn = self.viewport?;
        let viewport = self.half_of().unwrap_or(drawn);
        let edges = self.edges.get_or_insert_with(|| Uniforms::new(device, "splat_edges"));
        edges.write(queue, edges_of(camera));
        Some((&edges.buffer, viewport))
    }

    /// The state of light, and the buffers that it changes.
    pub(super) fn light_parts(&mut self) -> Option<(&mut LitView, LightBuffers<'_>)> {
        let ViewBuffers { geometry_halves, color_halves, sort, strokes, .. } = self.buffers.as_ref()?;
        let strokes = strokes.as_ref().filter(|_| self.is_painted).map(|strokes| &strokes.records);
        Some((&mut self.lit, LightBuffers { keys: &sort.keys, geometry_halves, color_halves, strokes }))
    }

    /// Starts a frame that shows nothing yet.
    pub(super) fn clear(&mut self) {
        self.viewport = None;
        self.is_painted = false;
        self.chunks.clear();
        self.staging.clear();
        self.sources.clear();
        self.bindings.values_mut().for_each(|cached| cached.in_use = false);
    }

    /// Ends a frame that shows nothing: releases everything that the last frame was made from.
    pub(super) fn forget_all(&mut self) {
        self.drawn.clear();
        self.forget_unused();
    }

    /// Releases the bindings that were not used since [`clear`](Self::clear).
    pub(super) fn forget_unused(&mut self) {
        self.bindings.retain(|_, cached| cached.in_use);
    }

    /// Makes room for `n_records` records. `draw_layout` is the layout of the draw's group.
    pub(super) fn reserve(
        &mut self,
        device: &wgpu::Device,
        sort: &Sort,
        draw_layout: &wgpu::BindGroupLayout,
        n_records: usize,
    ) -> Result<(), SplatError> {
        let (found, limit) = (record_bytes(n_records), record_limit(device));
        TooLarge::check("splats", found, limit)
            .map_err(|too_large| SplatError::TooManyGaussians { n_gaussians: n_records, too_large })?;
        let is_own = |buffers: &ViewBuffers| !buffers.is_sorted_by_other && buffers.n_records >= n_records;
        if !self.buffers.as_ref().is_some_and(is_own) {
            self.release();
            let sort = SortBuffers::new(device, sort, n_records);
            self.buffers = Some(ViewBuffers::new(device, sort, draw_layout, n_records));
        }
        Ok(())
    }

    /// Releases all buffers, e.g. before new ones, so that both are never in memory together.
    fn release(&mut self) {
        self.buffers = None;
        self.drawn.clear();
        // Their group names the old buffers.
        self.chunk_uniforms = None;
    }

    /// Uploads the number of records in use and the viewport, if they changed.
    pub(super) fn set_camera(&mut self, queue: &wgpu::Queue, camera: &Camera, n_records: u32) {
        self.viewport = Some(camera.viewport);
        let Some(buffers) = &mut self.buffers else { return };
        let now = Some((n_records, camera.viewport));
        if buffers.uploaded != now {
            let counts = SplatCounts { n_records, n_visible: 0 };
            queue.write_buffer(&buffers.sort.counts, 0, bytemuck::bytes_of(&counts));
            let draw = SplatDraw { viewport: camera.viewport.as_vec4().to_array() };
            queue.write_buffer(&buffers.draw_uniforms, 0, bytemuck::bytes_of(&draw));
            buffers.uploaded = now;
        }
    }

    /// Makes room for the uniforms of `n_chunks`, in a group of `layout`.
    pub(super) fn reserve_chunks(
        &mut self,
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
        n_chunks: usize,
    ) {
        let size = (UNIFORM_STRIDE * n_chunks) as u64;
        let fits = |uniforms: &ChunkUniforms| uniforms.buffer.size() >= size;
        let Some(buffers) = &self.buffers else { return };
        if !self.chunk_uniforms.as_ref().is_some_and(fits) {
            self.chunk_uniforms = Some(ChunkUniforms::new(device, layout, buffers, size));
        }
    }

    /// Adds a chunk to this frame. `bind` makes its bindings if there are none yet.
    pub(super) fn push_chunk(
        &mut self,
        uniforms: &StrokeChunk,
        key: ChunkBindings,
        versions: ChunkVersions,
        bind: impl FnOnce(&ChunkBindings) -> ChunkGroups,
    ) {
        // Padding up to the offset of this chunk.
        self.staging.resize(self.chunks.len() * UNIFORM_STRIDE, 0);
        self.staging.extend_from_slice(bytemuck::bytes_of(uniforms));
        self.sources.push(ChunkSource { uniforms: *uniforms, bindings: key.clone(), versions });
        let is_masked = key.mask.is_some();
        let cached = self.bindings.entry(key);
        let cached = cached.or_insert_with_key(|key| Cached { groups: bind(key), in_use: true });
        cached.in_use = true;
        self.chunks.push((uniforms.chunk.n_gaussians, cached.groups.clone(), is_masked));
    }

    /// Uploads the uniforms of this frame's chunks, if they changed.
    pub(super) fn write_chunks(&mut self, queue: &wgpu::Queue) -> Change {
        let change = self.change();
        if change != Change::Nothing
            && let Some(uniforms) = &self.chunk_uniforms
        {
            queue.write_buffer(&uniforms.buffer, 0, &self.staging);
        }
        // Swapping keeps both allocations for the next frames.
        std::mem::swap(&mut self.sources, &mut self.drawn);
        self.forget_unused();
        change
    }

    fn change(&self) -> Change {
        let mut pairs = self.sources.iter().zip(&self.drawn);
        if self.sources == self.drawn {
            Change::Nothing
        } else if self.sources.len() == self.drawn.len() && pairs.all(|(new, old)| new.has_geometry_of(old)) {
            Change::Colors
        } else {
            Change::Order
        }
    }

    /// This frame's dispatches of the project kernel, each with the group of its uniforms.
    pub(super) fn chunk_dispatches(&self) -> impl Iterator<Item = (&wgpu::BindGroup, ChunkDispatch<'_>)> {
        self.chunk_uniforms.iter().flat_map(|uniforms| {
            self.chunks.iter().enumerate().map(|(i, (n_gaussians, groups, is_masked))| {
                let (offset, n_gaussians) = ((i * UNIFORM_STRIDE) as u32, *n_gaussians);
                let (bind_group, is_masked) = (&groups.project, *is_masked);
                (&uniforms.group, ChunkDispatch { offset, n_gaussians, bind_group, is_masked })
            })
        })
    }

    /// This frame's dispatches of `splat_strokes`, likewise.
    pub(super) fn stroke_dispatches(&self) -> impl Iterator<Item = (&wgpu::BindGroup, ChunkDispatch<'_>)> {
        let of_view = self.strokes().and_then(ViewStrokes::view_group);
        of_view.into_iter().flat_map(|of_view| {
            self.chunks.iter().enumerate().filter_map(move |(i, (n_gaussians, groups, is_masked))| {
                let (offset, n_gaussians) = ((i * UNIFORM_STRIDE) as u32, *n_gaussians);
                let (bind_group, is_masked) = (groups.strokes.as_ref()?, *is_masked);
                Some((of_view, ChunkDispatch { offset, n_gaussians, bind_group, is_masked }))
            })
        })
    }

    /// Makes room for strokes and binds changed resources, if this frame shows any. `draw` are the uniforms of
    /// all draws.
    pub(super) fn update_strokes(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        stage: &StrokeStage,
        draw: Option<StrokeDraw>,
    ) {
        let (Some(buffers), Some(uniforms), Some(draw)) = (&mut self.buffers, &self.chunk_uniforms, draw)
        else {
            return;
        };
        let strokes = buffers.strokes.get_or_insert_with(|| ViewStrokes::new(device, buffers.n_records));
        strokes.update(device, queue, stage, [&uniforms.buffer, &buffers.sort.keys], draw);
        self.is_painted = true;
    }

    /// The strokes of this frame's records, if it shows any.
    pub(super) fn strokes(&self) -> Option<&ViewStrokes> {
        self.buffers.as_ref()?.strokes.as_ref().filter(|_| self.is_painted)
    }

    /// Clears the strokes of clouds that have none: other clouds may have had their records. Those of the
    /// others are written.
    pub(super) fn clear_strokes(&self, encoder: &mut wgpu::CommandEncoder) {
        let has_bare = self.chunks.iter().any(|(_, groups, _)| groups.strokes.is_none());
        if let Some(strokes) = self.strokes().filter(|_| has_bare) {
            encoder.clear_buffer(&strokes.records, 0, None);
        }
    }

    /// The sort's buffers, if there are any yet.
    pub(super) fn sort(&self) -> Option<&SortBuffers> {
        self.buffers.as_ref().map(|buffers| &buffers.sort)
    }

    /// The input of the draw; `None` if there is nothing to draw.
    pub(super) fn draw_source(&self) -> Option<DrawSource<'_>> {
        let buffers = self.buffers.as_ref()?;
        let (bind_group, commands) = (&buffers.draw_group, &buffers.sort.commands);
        let strokes = self.strokes().and_then(ViewStrokes::draw_group);
        Some(DrawSource { bind_group, strokes, commands, viewport: self.viewport? })
    }

    /// The lists of the picture's tiles; `None` if there is nothing to draw.
    pub(super) fn lists(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        tiles: &Tiles,
    ) -> Option<&mut TileLists> {
        let (buffers, viewport) = (self.buffers.as_mut()?, self.viewport?);
        if buffers.lists.as_ref().is_none_or(|lists| !lists.fits(viewport)) {
            let records = [buffers.geometry_halves.clone(), buffers.color_halves.clone()];
            let (sort, n_records) = (&buffers.sort, buffers.n_records);
            buffers.lists = Some(TileLists::new(device, tiles, sort, records, n_records, viewport));
        }
        let lists = buffers.lists.as_mut()?;
        lists.set_viewport(queue, viewport);
        Some(lists)
    }

    /// A number that differs after each change of the visible splats or their order.
    pub(super) fn order(&self) -> u64 {
        self.order
    }

    /// The sorted splats, if there are any buffers yet.
    pub(super) fn sorted(&self) -> Option<Sorted<'_>> {
        let buffers = self.buffers.as_ref()?;
        let SortBuffers { counts, record_indices, .. } = &buffers.sort;
        Some(Sorted { counts, record_indices, color_halves: &buffers.color_halves })
    }

    /// Marks the lists of tiles and iso depths as stale, because the order of the splats is about to change.
    pub(super) fn empty_lists(&mut self) {
        self.order += 1;
        if let Some(lists) = self.buffers.as_mut().and_then(|buffers| buffers.lists.as_mut()) {
            lists.empty();
        }
    }

    /// Everything that was allocated: buffers, and bindings of chunks.
    #[cfg(test)]
    pub(super) fn resources(&self) -> (Vec<wgpu::Buffer>, std::collections::BTreeSet<wgpu::BindGroup>) {
        let uniforms = self.chunk_uniforms.iter().map(|uniforms| &uniforms.buffer);
        let of_view = self
            .buffers
            .iter()
            .flat_map(|b| [&b.geometry_halves, &b.color_halves, &b.draw_uniforms, &b.sort.keys]);
        let groups = self.bindings.values().map(|cached| cached.groups.project.clone());
        (uniforms.chain(of_view).cloned().collect(), groups.collect())
    }

    /// Both halves of the records: geometry, then colors.
    #[cfg(test)]
    pub(super) fn records(&self) -> Option<(&wgpu::Buffer, &wgpu::Buffer)> {
        self.buffers.as_ref().map(|buffers| (&buffers.geometry_halves, &buffers.color_halves))
    }
}
