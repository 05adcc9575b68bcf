//! The strokes stage on the GPU: `splat_strokes`, and the bindings of draws with strokes.
//!
//! Nothing of it is compiled or allocated before a cloud with strokes is drawn.

use std::{ops::Range, sync::OnceLock};

use glam::Vec3;
use stylegaussian::strokes::{KIND_FLOW, MAX_CURVE_POINTS, MotionNow, StrokeKnobs, StrokeMotion as Motion};
use stylegaussian_shaders::splat::{
    SplatChunk,
    strokes::{
        self as shaders, CurvePoint, MAX_CHANGES, MAX_MOTIONS, NO_MOTION, OWN_MOTION, StrokeChange,
        StrokeChunk, StrokeDraw, StrokeMotion,
    },
};

use crate::{
    bindings::{
        bind_group, compute_pipeline, group_layout, one_of, pipeline_layout, storage_binding,
        texture_binding, uniform_binding, uniforms_binding,
    },
    buffers::{self, Uniforms},
    colors::GaussianColors,
    strokes::{GaussianStrokes, StrokeStore, TextureArrays},
};

/// Colors with strokes over them.
#[derive(Clone, Copy, Debug)]
pub struct PaintedColors<'a> {
    /// The colors below; `None` for the captured ones.
    pub below: Option<&'a GaussianColors>,
    /// The strokes, whose textures are in the store of the [`SplatPass`](super::SplatPass).
    pub strokes: &'a GaussianStrokes,
    /// Settings that may be changed without computing strokes anew. A view takes `near` and `screen_stable`,
    /// and with this `stroke_scale`, from the first of its clouds that has strokes.
    pub knobs: StrokeKnobs,
    /// The time at which strokes that move are shown, in seconds.
    pub seconds: f64,
}

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
    /// Group 1: uniforms, records, fine and wide detail, the sampler, the light on records.
    pub layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

/// `splat_strokes`.
#[derive(Debug)]
pub(super) struct StrokeKernel {
    pub pipeline: wgpu::ComputePipeline,
    /// Group 0: the chunk's uniforms, keys, the records of strokes, and the light on them.
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
        let filterable = wgpu::TextureSampleType::Float { filterable: true };
        let texture = texture_binding(filterable, wgpu::TextureViewDimension::D2Array);
        let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
        let records = storage_binding(true);
        let bindings = [uniform_binding::<StrokeDraw>(), records, texture, texture, sampler, records];
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

    /// Binds uniforms, records and relief, and the textures.
    fn bind(
        &self,
        device: &wgpu::Device,
        [uniforms, records, relief]: [&wgpu::Buffer; 3],
        arrays: &TextureArrays,
    ) -> wgpu::BindGroup {
        let [fine, wide] = arrays.views();
        let resources = [
            uniforms.as_entire_binding(),
            records.as_entire_binding(),
            wgpu::BindingResource::TextureView(&fine),
            wgpu::BindingResource::TextureView(&wide),
            wgpu::BindingResource::Sampler(&self.sampler),
            relief.as_entire_binding(),
        ];
        bind_group(device, "splat_stroke_draw", &self.layout, &resources)
    }
}

impl StrokeKernel {
    fn new(device: &wgpu::Device) -> Self {
        let (label, compute) = ("splat_strokes", wgpu::ShaderStages::COMPUTE);
        let uniforms = uniforms_binding::<StrokeChunk>();
        let read = storage_binding(true);
        let write = storage_binding(false);
        let view_layout = group_layout(device, label, compute, &[uniforms, read, write, write]);
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

    fn bind_view(&self, device: &wgpu::Device, bound: [&wgpu::Buffer; 4]) -> wgpu::BindGroup {
        let [uniforms, keys, records, relief] = bound;
        let [keys, records, relief] = [keys, records, relief].map(wgpu::Buffer::as_entire_binding);
        let resources = [one_of::<StrokeChunk>(uniforms), keys, records, relief];
        bind_group(device, "splat_stroke_view", &self.view_layout, &resources)
    }
}

/// The strokes of a view's records.
#[derive(Debug)]
pub(super) struct ViewStrokes {
    pub records: wgpu::Buffer,
    /// The light on each, once there was relief; a buffer of one record before.
    relief: wgpu::Buffer,
    n_records: usize,
    uniforms: Uniforms<StrokeDraw>,
    /// The buffers that the kernel's group was made of, and the group.
    view: Option<([wgpu::Buffer; 3], wgpu::BindGroup)>,
    /// The buffer and the textures that the draws' group was made of, and the group.
    draw: Option<((wgpu::Buffer, TextureArrays), wgpu::BindGroup)>,
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
        let relief = relief_records(device, 1);
        let uniforms = Uniforms::new(device, "splat_stroke_draw");
        Self { records, relief, n_records, uniforms, view: None, draw: None }
    }

    /// Makes room for relief if there is any, and binds changed resources: the uniforms of chunks, keys, the
    /// store's textures.
    pub fn update(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        stage: &StrokeStage,
        bound: [&wgpu::Buffer; 2],
        draw: StrokeDraw,
    ) {
        if draw.n_lights > 0 && self.relief.size() < Self::bytes(self.n_records) {
            self.relief = relief_records(device, self.n_records);
        }
        self.uniforms.write(queue, draw);
        let [chunks, keys] = bound;
        let bound = [chunks, keys, &self.relief];
        if self.view.as_ref().is_none_or(|(of, _)| of.each_ref() != bound) {
            let group = stage.kernel(device).bind_view(device, [chunks, keys, &self.records, &self.relief]);
            self.view = Some((bound.map(wgpu::Buffer::clone), group));
        }
        let of = (self.relief.clone(), stage.store.arrays(device));
        if self.draw.as_ref().is_none_or(|(last, _)| *last != of) {
            let buffers = [&self.uniforms.buffer, &self.records, &self.relief];
            let group = stage.draws(device).bind(device, buffers, &of.1);
            self.draw = Some((of, group));
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

/// Records of the light on paint.
fn relief_records(device: &wgpu::Device, n_records: usize) -> wgpu::Buffer {
    buffers::create(
        device,
        "splat_relief_records",
        ViewStrokes::bytes(n_records),
        wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
    )
}

/// The unit direction to the light, and the factor of the thickness of paint, which changes may add to; `None`
/// if all paint is flat.
fn light(painted: &PaintedColors) -> Option<(Vec3, f32)> {
    let StrokeKnobs { light, relief, .. } = painted.knobs;
    let relief = if relief.is_finite() { relief.max(0.0) } else { 0.0 };
    let adds = painted.strokes.changes().iter().any(|(_, factors)| factors.added_relief > 0.0);
    light.try_normalize().filter(|_| relief > 0.0 || adds).map(|to_light| (to_light, relief))
}

/// The uniforms of a view's draws with strokes.
pub(super) fn draw_uniforms<'a>(
    mut painted: impl Iterator<Item = PaintedColors<'a>> + Clone,
) -> Option<StrokeDraw> {
    let first = painted.clone().next()?.knobs;
    let is_stable = first.screen_stable && first.stroke_scale > 0.0 && first.stroke_scale.is_finite();
    Some(StrokeDraw {
        near: if first.near.is_finite() { first.near } else { 0.0 },
        n_lights: u32::from(painted.any(|painted| light(&painted).is_some())),
        is_stable: u32::from(is_stable),
        scale_octaves: if is_stable { first.stroke_scale.log2() } else { 0.0 },
    })
}

/// A chunk with the knobs and motions of its strokes, or with none. Numbers that are not finite show no
/// strokes. `draw` are the uniforms of the view's draws, if it shows strokes.
pub(super) fn with_knobs(
    chunk: SplatChunk,
    painted: Option<&PaintedColors>,
    draw: Option<&StrokeDraw>,
) -> StrokeChunk {
    let none = StrokeKnobs { amount: 0.0, ..StrokeKnobs::DEFAULT };
    let is_usable = |painted: &&PaintedColors| {
        let StrokeKnobs { amount, protection, stroke_scale, .. } = painted.knobs;
        amount.is_finite() && protection.is_finite() && stroke_scale.is_finite() && stroke_scale > 0.0
    };
    let painted = painted.filter(is_usable);
    let knobs = painted.map_or(none, |painted| painted.knobs);
    let is_stable = draw.is_some_and(|draw| draw.is_stable > 0);
    // All of a view have one size.
    let of_view = draw.filter(|_| is_stable).map(|draw| draw.scale_octaves.exp2());
    let (light, relief) = painted.and_then(light).unwrap_or_default();
    let mut motions = MotionsNow::default();
    let (changes, n_changes) =
        painted.map_or_else(Default::default, |painted| changes_now(painted, &mut motions));
    if let Some(painted) = painted {
        motions.add_all(painted);
    }
    StrokeChunk {
        chunk,
        amount: knobs.amount,
        protection: knobs.protection,
        stroke_scale: of_view.unwrap_or(knobs.stroke_scale),
        n_motions: motions.n,
        light: light.to_array(),
        relief,
        n_lights: draw.map_or(0, |draw| draw.n_lights),
        is_stable: u32::from(is_stable),
        n_changes,
        padding: 0,
        motions: motions.motions,
        changes,
    }
}

/// The motions of strokes at their time, and how many count: none that stands still, so that time changes
/// nothing then.
#[derive(Default)]
struct MotionsNow {
    motions: [StrokeMotion; MAX_MOTIONS],
    n: u32,
}

impl MotionsNow {
    /// Adds the motion of a range of seeds, unless they stand still or there is no room. Returns its index.
    fn add(&mut self, seeds: Range<u32>, motion: Motion, seconds: f64) -> Option<u32> {
        let place = self.motions.get_mut(self.n as usize).filter(|_| !motion.is_still())?;
        let MotionNow { kind, drawing, part, amount, toward } = motion.at(seconds);
        let phase = if kind == KIND_FLOW { part.to_bits() } else { drawing };
        let Range { start, end } = seeds;
        *place = StrokeMotion { toward: toward.to_array(), first: start, end, kind, phase, amount };
        self.n += 1;
        Some(self.n - 1)
    }

    /// Adds the motions of all seeds.
    fn add_all(&mut self, painted: &PaintedColors) {
        for (seeds, motion) in painted.strokes.motions() {
            self.add(seeds.clone(), *motion, painted.seconds);
        }
    }
}

/// The changes of strokes, and how many count. Their motions are added to `motions`, of no seeds by themselves.
fn changes_now(painted: &PaintedColors, motions: &mut MotionsNow) -> ([StrokeChange; MAX_CHANGES], u32) {
    let mut changes = [StrokeChange::default(); MAX_CHANGES];
    let mut n = 0;
    for (place, (first, factors)) in changes.iter_mut().zip(painted.strokes.changes()) {
        let motion = match factors.motion {
            Some(motion) => motions.add(0..0, motion, painted.seconds).unwrap_or(NO_MOTION),
            None => OWN_MOTION,
        };
        let mut points = [CurvePoint::default(); MAX_CURVE_POINTS];
        let mut n_points = 0;
        for (at, toward) in
            factors.curve.iter().flat_map(|curve| curve.points().iter().zip(curve.directions()))
        {
            let (at, toward) = (at.to_array(), toward.to_array());
            points[n_points] = CurvePoint { at, toward, ..CurvePoint::default() };
            n_points += 1;
        }
        *place = StrokeChange {
            direction: factors.direction.unwrap_or(Vec3::ZERO).to_array(),
            first: *first,
            gain: factors.amount.max(1.0),
            stroke_scale: factors.stroke_scale,
            relief: factors.relief,
            motion,
            added_relief: factors.added_relief,
            n_points: n_points as u32,
            points,
            ..StrokeChange::default()
        };
        n += 1;
    }
    (changes, n)
}

#[cfg(test)]
pub(super) mod tests;
