//! The stage *cast*: the cores of splats in the shadow maps of lights. Scenes without casters have none of
//! this.
//!
//! A shadow map knows light and dark alone, so a splat either casts or does not: it does where its alpha is
//! above a threshold. That takes no order and no sums. A core is small: for opacity 1 and a threshold of 0.25
//! it has a quarter of the footprint's area. Its shadow begins at its far end, so that surfaces do not shade
//! themselves.
//!
//! 1. `splat_cores` projects each Gaussian once, by the rules of *project*, and keeps the cores that cover a
//!    pixel of the map;
//! 2. `splat_cast` draws them into depths that belong to the map, by one indirect draw;
//! 3. `splat_cast_write` writes these depths into the map, over the meshes that are there.
//!
//! While nothing changes that cores depend on (`CastKey`), the depths stay, and the third step is all that a
//! frame does. Cores are found in batches, in memory that all maps share one after another. So casting takes 4
//! bytes per texel of a map, and [`BATCH`] cores at most, for any number of Gaussians and maps.

use std::{
    ops::Range,
    sync::{Mutex, OnceLock, PoisonError},
};

use glam::{UVec2, UVec4, Vec4Swizzles};
use stylegaussian::splat::cast_threshold;
use stylegaussian_shaders::{
    Source,
    splat::{
        ANTIALIASED, CAPTURED_COLORS, PackedGaussian, SplatChunk, UNCLIPPED,
        cast::{self as shaders, CoreCommand, SplatCore},
    },
};
use wgpu::util::DeviceExt;

use super::{
    camera::Camera,
    cloud::{self, Cloud},
    dispatch::dispatch,
    error::SplatError,
    project::cloud_uniforms,
    settings::{SplatCuts, SplatSettings},
    view::faded_flags,
};
use crate::{
    bindings::{
        at_strides, bind_group, compute_pass, compute_pipeline, group_layout, one_of, pipeline_layout,
        shader_module, storage_binding, stride, texture_binding, uniforms_binding,
    },
    buffers,
    device::GpuEncoder,
    drawing::{Drawing, attachment, depth_state, set_viewport},
};

#[cfg(test)]
mod tests;

/// The format of shadow maps.
pub const SHADOW_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Gaussians in a batch, at most: 24 MiB of cores. Each batch costs a pass of kernels and one of drawing.
const BATCH: u32 = 1 << 20;

/// A cloud that casts shadows.
#[derive(Clone, Copy, Debug)]
pub struct Caster<'a> {
    /// The cloud. Its colors do not matter.
    pub cloud: Cloud<'a>,
    /// Least alpha of a splat where it casts a shadow, as [`cast_threshold`] limits it.
    pub threshold: f32,
    /// Share of all opacities that is faded out, 0..1.
    pub faded: f32,
}

/// The pipelines, made when a cloud casts shadows.
#[derive(Debug)]
pub(super) struct Cast {
    /// Gaussians in a batch, at most.
    batch: u32,
    /// Bound where nothing is read.
    absent: wgpu::Buffer,
    /// Group 0 of the kernel: the uniforms of a piece.
    map_layout: wgpu::BindGroupLayout,
    /// Group 2 of the kernel: cores, and the command of their draw.
    found_layout: wgpu::BindGroupLayout,
    /// The kernel for clouds without a mask, and with one.
    kernels: [OnceLock<CoreKernel>; 2],
    draw: wgpu::RenderPipeline,
    /// Cores.
    draw_layout: wgpu::BindGroupLayout,
    write: wgpu::RenderPipeline,
    /// The depths of cores.
    write_layout: wgpu::BindGroupLayout,
    /// The memory of a batch, which grows to the largest one.
    cores: Mutex<Option<Cores>>,
}

/// The kernel with or without a mask.
#[derive(Debug)]
struct CoreKernel {
    pipeline: wgpu::ComputePipeline,
    /// Group 1: Gaussians, two buffers that are not read, and the mask if there is one.
    piece_layout: wgpu::BindGroupLayout,
}

/// Memory for the cores of a batch.
#[derive(Debug)]
struct Cores {
    /// The number of cores that it holds.
    capacity: u32,
    /// `CoreCommand`.
    command: wgpu::Buffer,
    found: wgpu::BindGroup,
    drawn: wgpu::BindGroup,
}

/// The casters of one shadow map from frame to frame.
#[derive(Debug, Default)]
pub struct CastView {
    /// The key of the depths. If it has no pieces, nothing is written.
    key: CastKey,
    /// The bindings of the key's pieces.
    groups: Vec<wgpu::BindGroup>,
    uniforms: Option<(wgpu::Buffer, wgpu::BindGroup)>,
    depths: Option<CoreDepths>,
    n_projections: u64,
}

/// The depths of the cores in a shadow map, as large as its viewport.
#[derive(Debug)]
struct CoreDepths {
    size: UVec2,
    texture: wgpu::TextureView,
    group: wgpu::BindGroup,
}

/// Everything that determines the depths of the cores in a shadow map: those of equal keys are equal.
#[derive(Clone, Debug, Default, PartialEq)]
struct CastKey {
    viewport: UVec4,
    pieces: Vec<Piece>,
}

/// Consecutive Gaussians of a chunk, no more than a batch, with everything that determines their cores.
#[derive(Clone, Debug, PartialEq)]
struct Piece {
    uniforms: SplatChunk,
    gaussians: wgpu::Buffer,
    /// Index of the first one in that buffer.
    first: u32,
    /// The mask, and its version.
    mask: Option<(wgpu::Buffer, u64)>,
}

/// Gaussians, the first of them and their number, and the mask: what a piece binds.
type Bound<'a> = (&'a wgpu::Buffer, u32, u32, Option<&'a wgpu::Buffer>);

impl CastView {
    /// Without casters.
    pub fn new() -> Self {
        Self::default()
    }

    /// How often the casters were projected so far: they are not while nothing changes.
    pub fn n_projections(&self) -> u64 {
        self.n_projections
    }

    /// Forgets the casters, and gives their memory back.
    fn clear(&mut self) {
        *self = Self { n_projections: self.n_projections, ..Self::default() };
    }
}

impl CastKey {
    /// The key of `casters` in the shadow map of a light at `camera`, in pieces of at most `batch` Gaussians.
    fn new(batch: u32, (camera, near): (&Camera, f32), casters: &[Caster]) -> Self {
        let mut pieces = Vec::new();
        let drawn = casters.iter().filter(|caster| camera.is_drawable() && caster.cloud.is_drawable());
        for Caster { cloud, threshold, faded } in drawn {
            let cuts = SplatCuts { least_opacity: cast_threshold(*threshold), ..SplatCuts::default() };
            let settings = SplatSettings { near, cuts, ..SplatSettings::default() };
            let mut of_cloud = cloud_uniforms((camera, None), cloud, &settings);
            // A shadow must not fade as its map gets coarser, and does not change with colors.
            of_cloud.flags &= !(ANTIALIASED | CAPTURED_COLORS);
            of_cloud.flags |= faded_flags(*faded);
            if camera.is_orthographic() {
                of_cloud.flags |= UNCLIPPED;
            }
            let mask = cloud.mask().map(|visibility| {
                let mask = visibility.mask;
                (mask.buffer.clone(), mask.version())
            });
            for chunk in cloud.scene.chunks() {
                for first in (0..chunk.n_gaussians).step_by(batch as usize) {
                    let n_gaussians = batch.min(chunk.n_gaussians - first);
                    let first_gaussian = chunk.first + first;
                    pieces.push(Piece {
                        uniforms: SplatChunk { n_gaussians, first_gaussian, ..of_cloud },
                        gaussians: chunk.gaussians.clone(),
                        first,
                        mask: mask.clone(),
                    });
                }
            }
        }
        Self { viewport: camera.viewport, pieces }
    }
}

impl Piece {
    fn n_gaussians(&self) -> u32 {
        self.uniforms.n_gaussians
    }

    fn mask_buffer(&self) -> Option<&wgpu::Buffer> {
        self.mask.as_ref().map(|(buffer, _)| buffer)
    }

    /// Everything that its bindings are made of.
    fn bound(&self) -> Bound<'_> {
        (&self.gaussians, self.first, self.n_gaussians(), self.mask_buffer())
    }
}

/// As many consecutive pieces to a batch as fit, with the number of their Gaussians.
fn batches(pieces: &[Piece], batch: u32) -> Vec<(Range<usize>, u32)> {
    let mut batches: Vec<(Range<usize>, u32)> = Vec::new();
    for (i, piece) in pieces.iter().enumerate() {
        let n_gaussians = piece.n_gaussians();
        match batches.last_mut() {
            Some((range, n)) if *n + n_gaussians <= batch => {
                range.end = i + 1;
                *n += n_gaussians;
            }
            _ => batches.push((i..i + 1, n_gaussians)),
        }
    }
    batches
}

impl Cast {
    /// Compiles the draws. `absent` is bound where nothing is read.
    pub(super) fn new(device: &wgpu::Device, absent: &wgpu::Buffer) -> Self {
        Self::in_batches(device, absent, BATCH)
    }

    /// [`new`](Self::new) with at most `batch` Gaussians in a batch, a multiple of 8, so that ranges of their
    /// buffers can be bound.
    fn in_batches(device: &wgpu::Device, absent: &wgpu::Buffer, batch: u32) -> Self {
        let (compute, vertex) = (wgpu::ShaderStages::COMPUTE, wgpu::ShaderStages::VERTEX);
        let label = "splat_cores";
        let map_layout = group_layout(device, label, compute, &[uniforms_binding::<SplatChunk>()]);
        let found_layout = group_layout(device, label, compute, &[storage_binding(false); 2]);
        let draw_layout = group_layout(device, "splat_cast", vertex, &[storage_binding(true)]);
        let depths = texture_binding(wgpu::TextureSampleType::Depth, wgpu::TextureViewDimension::D2);
        let write_layout = group_layout(device, "splat_cast_write", wgpu::ShaderStages::FRAGMENT, &[depths]);
        Self {
            batch,
            absent: absent.clone(),
            map_layout,
            found_layout,
            kernels: Default::default(),
            draw: render_pipeline(device, shaders::draw(), &draw_layout),
            draw_layout,
            write: render_pipeline(device, shaders::write(), &write_layout),
            write_layout,
            cores: Mutex::new(None),
        }
    }

    /// Compiles the kernel for clouds with a mask or without, unless it is there.
    pub(super) fn prepare(&self, device: &wgpu::Device, masked: bool) {
        self.kernel(device, masked);
    }

    fn kernel(&self, device: &wgpu::Device, masked: bool) -> &CoreKernel {
        self.kernels[usize::from(masked)].get_or_init(|| {
            let bindings = [storage_binding(true); 4];
            let bindings = if masked { &bindings[..] } else { &bindings[..1] };
            let source = shaders::cores(masked);
            let piece_layout = group_layout(device, source.label, wgpu::ShaderStages::COMPUTE, bindings);
            let groups = [&self.map_layout, &piece_layout, &self.found_layout];
            let layout = pipeline_layout(device, source.label, &groups);
            let options = wgpu::PipelineCompilationOptions::default();
            CoreKernel { pipeline: compute_pipeline(device, source, &layout, options), piece_layout }
        })
    }

    /// Projects `casters` and draws their cores into the depths of `view`, unless these hold them already.
    pub(super) fn project(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut CastView,
        light: (&Camera, f32),
        casters: &[Caster],
    ) -> Result<(), SplatError> {
        if let Err(error) = cloud::check(casters.iter().map(|caster| &caster.cloud)) {
            view.clear();
            return Err(error);
        }
        let key = CastKey::new(self.batch, light, casters);
        if key.pieces.is_empty() {
            view.clear();
        } else if view.key != key {
            self.bind(gpu, view, key);
            self.encode(gpu, view);
            view.n_projections += 1;
        }
        Ok(())
    }

    /// Uploads the uniforms of every piece of `key`, and makes what is missing for it.
    fn bind(&self, gpu: &GpuEncoder, view: &mut CastView, key: CastKey) {
        // Sorted, because a world casts with thousands of pieces.
        let mut known: Vec<(Bound, &wgpu::BindGroup)> =
            view.key.pieces.iter().map(Piece::bound).zip(&view.groups).collect();
        known.sort_unstable_by_key(|(bound, _)| *bound);
        let group_of = |piece: &Piece| match known.binary_search_by(|(known, _)| known.cmp(&piece.bound())) {
            Ok(i) => known[i].1.clone(),
            Err(_) => self.bind_piece(gpu.device, piece),
        };
        let groups: Vec<_> = key.pieces.iter().map(group_of).collect();
        view.groups = groups;
        let bytes = at_strides(key.pieces.iter().map(|piece| piece.uniforms));
        let size = bytes.len() as u64;
        if view.uniforms.as_ref().is_none_or(|(buffer, _)| buffer.size() < size) {
            let buffer = buffers::uniforms(gpu.device, "splat_cores", size);
            let resources = [one_of::<SplatChunk>(&buffer)];
            let group = bind_group(gpu.device, "splat_cores", &self.map_layout, &resources);
            view.uniforms = Some((buffer, group));
        }
        if let Some((buffer, _)) = &view.uniforms {
            gpu.queue.write_buffer(buffer, 0, &bytes);
        }
        let size = key.viewport.zw();
        if view.depths.as_ref().is_none_or(|depths| depths.size != size) {
            let none = wgpu::TextureUsages::empty();
            let texture = attachment(gpu.device, "splat_cast", size, SHADOW_FORMAT, none);
            let resources = [wgpu::BindingResource::TextureView(&texture)];
            let group = bind_group(gpu.device, "splat_cast_write", &self.write_layout, &resources);
            view.depths = Some(CoreDepths { size, texture, group });
        }
        view.key = key;
    }

    fn bind_piece(&self, device: &wgpu::Device, piece: &Piece) -> wgpu::BindGroup {
        let bytes = |n: u32| u64::from(n) * size_of::<PackedGaussian>() as u64;
        let gaussians = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &piece.gaussians,
            offset: bytes(piece.first),
            size: wgpu::BufferSize::new(bytes(piece.n_gaussians())),
        });
        let mut resources = vec![gaussians];
        if let Some(mask) = piece.mask_buffer() {
            resources.extend([&self.absent, &self.absent, mask].map(wgpu::Buffer::as_entire_binding));
        }
        let layout = &self.kernel(device, piece.mask.is_some()).piece_layout;
        bind_group(device, "splat_cores_piece", layout, &resources)
    }

    /// Finds the cores of every piece of `view`, batch by batch, and draws them into its depths.
    fn encode(&self, gpu: &mut GpuEncoder, view: &CastView) {
        let (Some((_, uniforms)), Some(depths)) = (&view.uniforms, &view.depths) else { return };
        let batches = batches(&view.key.pieces, self.batch);
        let largest = batches.iter().map(|(_, n_gaussians)| *n_gaussians).max().unwrap_or(0);
        let mut memory = self.cores.lock().unwrap_or_else(PoisonError::into_inner);
        if memory.as_ref().is_none_or(|cores| cores.capacity < largest) {
            *memory = Some(Cores::new(gpu.device, self, largest));
        }
        let Some(cores) = &*memory else { return };
        for (i, (pieces, _)) in batches.into_iter().enumerate() {
            let n_vertices = std::mem::offset_of!(CoreCommand, n_vertices) as u64;
            gpu.encoder.clear_buffer(&cores.command, n_vertices, Some(size_of::<u32>() as u64));
            let mut pass = compute_pass(gpu.encoder, "splat_cores");
            for of_piece in pieces {
                let piece = &view.key.pieces[of_piece];
                // Compiled when the piece was bound.
                let Some(kernel) = self.kernels[usize::from(piece.mask.is_some())].get() else { continue };
                pass.set_pipeline(&kernel.pipeline);
                pass.set_bind_group(0, uniforms, &[(of_piece * stride::<SplatChunk>()) as u32]);
                pass.set_bind_group(1, &view.groups[of_piece], &[]);
                pass.set_bind_group(2, &cores.found, &[]);
                dispatch(&mut pass, piece.n_gaussians());
            }
            drop(pass);
            let load = if i == 0 { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load };
            let depth_ops = Some(wgpu::Operations { load, store: wgpu::StoreOp::Store });
            let mut pass = gpu.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("splat_cast"),
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &depths.texture,
                    depth_ops,
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            pass.set_pipeline(&self.draw);
            pass.set_bind_group(0, &cores.drawn, &[]);
            pass.draw_indirect(&cores.command, 0);
        }
    }

    /// Writes the depths of `view`.
    pub(super) fn write(&self, pass: &mut wgpu::RenderPass, view: &CastView) {
        let Some(depths) = &view.depths else { return };
        set_viewport(pass, view.key.viewport);
        pass.set_pipeline(&self.write);
        pass.set_bind_group(0, &depths.group, &[]);
        pass.draw(0..3, 0..1);
    }
}

impl Cores {
    fn new(device: &wgpu::Device, cast: &Cast, capacity: u32) -> Self {
        let size = u64::from(capacity) * size_of::<SplatCore>() as u64;
        let buffer = buffers::create(device, "splat_cores", size, wgpu::BufferUsages::STORAGE);
        let command = CoreCommand { n_vertices: 0, n_instances: 1, first_vertex: 0, first_instance: 0 };
        let command = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("splat_cores_command"),
            contents: bytemuck::bytes_of(&command),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST,
        });
        let resources = [buffer.as_entire_binding(), command.as_entire_binding()];
        let found = bind_group(device, "splat_cores", &cast.found_layout, &resources);
        let drawn = bind_group(device, "splat_cast", &cast.draw_layout, &resources[..1]);
        Self { capacity, command, found, drawn }
    }
}

/// A draw of triangles at depths that are compared with those that are there.
fn render_pipeline(
    device: &wgpu::Device,
    source: Source,
    group: &wgpu::BindGroupLayout,
) -> wgpu::RenderPipeline {
    let label = source.label;
    let layout = pipeline_layout(device, label, &[group]);
    let module = shader_module(device, source);
    // Reverse z: what is nearer to the light is larger.
    let depth = Some(depth_state(SHADOW_FORMAT, true, wgpu::CompareFunction::Greater));
    Drawing { depth, ..Drawing::new(label, &module, &layout) }.pipeline(device)
}
