//! The buffers of a view, of which those of its records are large.

use stylegaussian_shaders::splat::{SplatChunk, SplatDraw};

use crate::{
    bindings::{bind_group, one_of},
    buffers,
    splat::{memory::HALF_RECORD, sort::SortBuffers, strokes::ViewStrokes, tiles::TileLists},
};

/// The buffers with a size that depends on the number of records.
#[derive(Debug)]
pub(super) struct ViewBuffers {
    pub n_records: usize,
    pub geometry_halves: wgpu::Buffer,
    pub color_halves: wgpu::Buffer,
    pub draw_uniforms: wgpu::Buffer,
    pub sort: SortBuffers,
    pub draw_group: wgpu::BindGroup,
    /// The number of records in use and the viewport that the uniforms hold, if they hold any.
    pub uploaded: Option<(u32, glam::UVec4)>,
    /// The lists of tiles, once a layer was drawn by them.
    pub lists: Option<TileLists>,
    /// The strokes of the records, once a cloud with strokes was seen.
    pub strokes: Option<ViewStrokes>,
    /// Whether `sort` is that of another view.
    pub is_sorted_by_other: bool,
}

#[derive(Debug)]
pub(super) struct ChunkUniforms {
    pub buffer: wgpu::Buffer,
    pub group: wgpu::BindGroup,
}

impl ViewBuffers {
    pub fn new(
        device: &wgpu::Device,
        sort: SortBuffers,
        draw_layout: &wgpu::BindGroupLayout,
        n_records: usize,
    ) -> Self {
        let [geometry_halves, color_halves] = ["splat_geometry_halves", "splat_color_halves"].map(|label| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            buffers::create(device, label, HALF_RECORD * n_records as u64, usage)
        });
        let draw_uniforms = buffers::uniforms(device, "splat_draw", size_of::<SplatDraw>() as u64);
        let bound = [&draw_uniforms, &sort.counts, &sort.record_indices, &geometry_halves, &color_halves];
        let resources = bound.map(wgpu::Buffer::as_entire_binding);
        let draw_group = bind_group(device, "splat_draw", draw_layout, &resources);
        Self {
            n_records,
            geometry_halves,
            color_halves,
            draw_uniforms,
            sort,
            draw_group,
            uploaded: None,
            lists: None,
            strokes: None,
            is_sorted_by_other: false,
        }
    }
}

impl ChunkUniforms {
    pub fn new(
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
        buffers: &ViewBuffers,
        size: u64,
    ) -> Self {
        let buffer = buffers::uniforms(device, "splat_project_view", size);
        let records = [&buffers.sort.keys, &buffers.geometry_halves, &buffers.color_halves];
        let [keys, geometry, color] = records.map(wgpu::Buffer::as_entire_binding);
        let resources = [one_of::<SplatChunk>(&buffer), keys, geometry, color];
        let group = bind_group(device, "splat_project_view", layout, &resources);
        Self { buffer, group }
    }
}
