//! The strokes stage on the GPU: `splat_strokes`, and the bindings of draws with strokes.
//!
//! Nothing of it is compiled or allocated before a cloud with strokes is drawn.

use std::{ops::Range, sync::OnceLock};

use stylegaussian::strokes::{KIND_FLOW, MotionNow, StrokeKnobs};
use stylegaussian_shaders::splat::strokes::{
    self as shaders, MAX_MOTIONS, StrokeChunk, StrokeDraw, StrokeMotion,
};

use super::cloud::PaintedColors;
use crate::{
    bindings::{
        bind_group, compute_pipeline, group_layout, pipeline_layout, storage_binding, uniform_binding,
    },
    buffers,
    strokes::{StrokeStore, TextureArrays},
};

/// Bytes of a splat's strokes.
const RECORD: u64 = 16;

/// The stage, and the textures of all strokes.
#[derive(Debug, Default)]
pub(super) struct StrokeStage {
    pub store: StrokeStore,
    draws: OnceLock<StrokeDraws>,
    kernel: OnceLock<StrokeKernel>,
}

/// Resources that all draws with strokes bind.
#[derive(Debug)]
pub(super) struct StrokeDraws {
    /// Group 1: uniforms, records, fine and wide detail, the sampler.
    pub layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

/// `splat_strokes`.
#[derive(Debug)]
pub(super) struct StrokeKernel {
    pub pipeline: wgpu::ComputePipeline,
    /// Group 0: the chunk's uniforms, keys, and the records of strokes.
    view_layout: wgpu::BindGroupLayout,
    /// Group 1: Gaussians, words, seeds.
    chunk_layout: wgpu::BindGroupLayout,
}

impl StrokeStage {
    pub fn new(store: StrokeStore) -> Self {
        Self { store, ..Self::default() }
    }

    /// The kernel, which is compiled unless it is there.
    pub fn kernel(&self, device: &wgpu::Device) -> &StrokeKernel {
        self.kernel.get_or_init(|| StrokeKernel::new(device))
    }

    /// The layout of draws with strokes, which is made unless it is there.
    pub fn draws(&self, device: &wgpu::Device) -> &StrokeDraws {
        self.draws.get_or_init(|| StrokeDraws::new(device))
    }
}

impl StrokeDraws {
    fn new(device: &wgpu::Device) -> Self {
        let texture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: true },
            view_dimension: wgpu::TextureViewDimension::D2Array,
            multisampled: false,
        };
        let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
        let bindings = [uniform_binding::<StrokeDraw>(), storage_binding(true), texture, texture, sampler];
        // Quads read records in the vertex stage and textures in the fragment stage, tiles both by compute.
        let stages = wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE;
        let layout = group_layout(device, "splat_stroke_draw", stages, &bindings);
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("splat_stroke_draw"),
            address_mode_u: wgpu::AddressMode::MirrorRepeat,
            address_mode_v: wgpu::AddressMode::MirrorRepeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self { layout, sampler }
    }

    fn bind(
        &self,
        device: &wgpu::Device,
        uniforms: &wgpu::Buffer,
        records: &wgpu::Buffer,
        arrays: &TextureArrays,
    ) -> wgpu::BindGroup {
        let [fine, wide] = arrays.views();
        let resources = [
            uniforms.as_entire_binding(),
            records.as_entire_binding(),
            wgpu::BindingResource::TextureView(&fine),
            wgpu::BindingResource::TextureView(&wide),
            wgpu::BindingResource::Sampler(&self.sampler),
        ];
        bind_group(device, "splat_stroke_draw", &self.layout, &resources)
    }
}

impl StrokeKernel {
    fn new(device: &wgpu::Device) -> Self {
        let (label, compute) = ("splat_strokes", wgpu::ShaderStages::COMPUTE);
        let uniforms = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: true,
            min_binding_size: wgpu::BufferSize::new(size_of::<StrokeChunk>() as u64),
        };
        let read = storage_binding(true);
        let view_layout = group_layout(device, label, compute, &[uniforms, read, storage_binding(false)]);
        let chunk_layout = group_layout(device, label, compute, &[read; 3]);
        let layout = pipeline_layout(device, label, &[&view_layout, &chunk_layout]);
        let options = wgpu::PipelineCompilationOptions::default();
        let pipeline = compute_pipeline(device, shaders::records(), &layout, options);
        Self { pipeline, view_layout, chunk_layout }
    }

    /// Binds a chunk's Gaussians, words and seeds.
    pub fn bind_chunk(&self, device: &wgpu::Device, buffers: [&wgpu::Buffer; 3]) -> wgpu::BindGroup {
        let resources = buffers.map(wgpu::Buffer::as_entire_binding);
        bind_group(device, "splat_stroke_chunk", &self.chunk_layout, &resources)
    }

    fn bind_view(&self, device: &wgpu::Device, bound: [&wgpu::Buffer; 3]) -> wgpu::BindGroup {
        let [uniforms, keys, records] = bound;
        // One chunk; a dynamic offset selects which.
        let one_chunk = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: uniforms,
            offset: 0,
            size: wgpu::BufferSize::new(size_of::<StrokeChunk>() as u64),
        });
        let resources = [one_chunk, keys.as_entire_binding(), records.as_entire_binding()];
        bind_group(device, "splat_stroke_view", &self.view_layout, &resources)
    }
}

/// The strokes of a view's records.
#[derive(Debug)]
pub(super) struct ViewStrokes {
    pub records: wgpu::Buffer,
    uniforms: wgpu::Buffer,
    /// The number that the uniforms hold.
    near: Option<f32>,
    /// The buffers that the kernel's group was made of, and the group.
    view: Option<([wgpu::Buffer; 2], wgpu::BindGroup)>,
    /// The textures that the draws' group was made of, and the group.
    draw: Option<(TextureArrays, wgpu::BindGroup)>,
}

impl ViewStrokes {
    /// Bytes of the strokes of `n_records`.
    pub fn bytes(n_records: usize) -> u64 {
        RECORD * n_records as u64
    }

    /// Room for the strokes of `n_records`, none of which shows any yet.
    pub fn new(device: &wgpu::Device, n_records: usize) -> Self {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let records = buffers::create(device, "splat_stroke_records", Self::bytes(n_records), usage);
        let uniforms = buffers::uniforms(device, "splat_stroke_draw", size_of::<StrokeDraw>() as u64);
        Self { records, uniforms, near: None, view: None, draw: None }
    }

    /// Binds changed resources: the uniforms of chunks, keys, the store's textures.
    pub fn update(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        stage: &StrokeStage,
        bound: [&wgpu::Buffer; 2],
        knobs: &StrokeKnobs,
    ) {
        let near = if knobs.near.is_finite() { knobs.near } else { 0.0 };
        if self.near != Some(near) {
            let draw = StrokeDraw { near, padding_0: 0, padding_1: 0, padding_2: 0 };
            queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&draw));
            self.near = Some(near);
        }
        if self.view.as_ref().is_none_or(|(of, _)| of.each_ref() != bound) {
            let group = stage.kernel(device).bind_view(device, [bound[0], bound[1], &self.records]);
            self.view = Some((bound.map(wgpu::Buffer::clone), group));
        }
        let arrays = stage.store.arrays(device);
        if self.draw.as_ref().is_none_or(|(of, _)| *of != arrays) {
            let group = stage.draws(device).bind(device, &self.uniforms, &self.records, &arrays);
            self.draw = Some((arrays, group));
        }
    }

    /// The kernel's group 0.
    pub fn view_group(&self) -> Option<&wgpu::BindGroup> {
        self.view.as_ref().map(|(_, group)| group)
    }

    /// Group 1 of draws.
    pub fn draw_group(&self) -> Option<&wgpu::BindGroup> {
        self.draw.as_ref().map(|(_, group)| group)
    }
}

/// A chunk with the knobs and motions of its strokes, or with none. Numbers that are not finite show no strokes.
pub(super) fn with_knobs(
    chunk: stylegaussian_shaders::splat::SplatChunk,
    painted: Option<&PaintedColors>,
) -> StrokeChunk {
    let none = StrokeKnobs { amount: 0.0, ..StrokeKnobs::DEFAULT };
    let is_usable = |painted: &&PaintedColors| {
        let StrokeKnobs { amount, protection, stroke_scale, .. } = painted.knobs;
        amount.is_finite() && protection.is_finite() && stroke_scale.is_finite() && stroke_scale > 0.0
    };
    let painted = painted.filter(is_usable);
    let knobs = painted.map_or(none, |painted| painted.knobs);
    let (motions, n_motions) = painted.map_or_else(Default::default, motions_now);
    StrokeChunk {
        chunk,
        amount: knobs.amount,
        protection: knobs.protection,
        stroke_scale: knobs.stroke_scale,
        n_motions,
        motions,
    }
}

/// The motions of strokes at their time, and how many count: none that stands still, so that time changes
/// nothing then.
fn motions_now(painted: &PaintedColors) -> ([StrokeMotion; MAX_MOTIONS], u32) {
    let mut motions = [StrokeMotion::default(); MAX_MOTIONS];
    let moving = painted.strokes.motions().iter().filter(|(_, motion)| !motion.is_still());
    let mut n_motions = 0;
    for (place, (seeds, motion)) in motions.iter_mut().zip(moving) {
        let MotionNow { kind, drawing, part, amount, toward } = motion.at(painted.seconds);
        let phase = if kind == KIND_FLOW { part.to_bits() } else { drawing };
        let Range { start, end } = *seeds;
        *place = StrokeMotion { toward: toward.to_array(), first: start, end, kind, phase, amount };
        n_motions += 1;
    }
    (motions, n_motions)
}

#[cfg(test)]
mod tests;
