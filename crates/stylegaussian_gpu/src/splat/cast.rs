//! The stage *cast*: the cores of splats in the shadow maps of lights. Scenes without casters have none of
//! this.
//!
//! A shadow map knows light and dark alone, so a splat either casts or does not: it does where its alpha is
//! above a threshold. That takes no order and no sums, and so no records: the vertices of a quad project its
//! Gaussian by the rules of *project*, and a light needs no memory but uniforms. A core is small: for opacity 1
//! and a threshold of 0.25 it has a quarter of the footprint's area. Its shadow begins at its far end, so that
//! surfaces do not shade themselves.

use std::sync::OnceLock;

use glam::UVec4;
use stylegaussian::splat::cast_threshold;
use stylegaussian_shaders::splat::{self as shaders, ANTIALIASED, SplatChunk, UNCLIPPED};

use super::{
    camera::Camera,
    cloud::{self, Cloud},
    error::SplatError,
    project::cloud_uniforms,
    settings::{SplatCuts, SplatSettings},
};
use crate::{
    bindings::{
        at_strides, bind_group, group_layout, one_of, pipeline_layout, shader_module, storage_binding,
        stride, uniforms_binding,
    },
    buffers,
    drawing::{Drawing, depth_state, set_viewport},
};

#[cfg(test)]
mod tests;

/// The format of shadow maps.
pub const SHADOW_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// A cloud that casts shadows.
#[derive(Clone, Copy, Debug)]
pub struct Caster<'a> {
    /// The cloud. Its colors do not matter.
    pub cloud: Cloud<'a>,
    /// Least alpha of a splat where it casts a shadow, as [`cast_threshold`] limits it.
    pub threshold: f32,
}

/// The pipelines, made when a cloud casts shadows.
#[derive(Debug)]
pub(super) struct Cast {
    /// The uniforms of a chunk.
    map_layout: wgpu::BindGroupLayout,
    /// Clouds without a mask, and with one.
    variants: [OnceLock<Variant>; 2],
}

/// The draw with or without a mask.
#[derive(Debug)]
pub(super) struct Variant {
    pipeline: wgpu::RenderPipeline,
    /// Gaussians, two buffers that are not read, and the mask if there is one.
    chunk_layout: wgpu::BindGroupLayout,
}

/// The casters of one shadow map from frame to frame.
#[derive(Debug, Default)]
pub struct CastView {
    uniforms: Option<(wgpu::Buffer, wgpu::BindGroup)>,
    /// The bytes that the uniforms hold.
    written: Vec<u8>,
    viewport: UVec4,
    chunks: Vec<CastChunk>,
}

/// A chunk of a cloud, and its group.
#[derive(Debug)]
struct CastChunk {
    gaussians: wgpu::Buffer,
    mask: Option<wgpu::Buffer>,
    n_gaussians: u32,
    group: wgpu::BindGroup,
}

impl CastView {
    /// Without casters.
    pub fn new() -> Self {
        Self::default()
    }
}

impl Cast {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let uniforms = uniforms_binding::<SplatChunk>();
        let map_layout = group_layout(device, "splat_cast", wgpu::ShaderStages::VERTEX, &[uniforms]);
        Self { map_layout, variants: Default::default() }
    }

    /// The draw of clouds with a mask or without, which is compiled unless it is there.
    pub(super) fn variant(&self, device: &wgpu::Device, masked: bool) -> &Variant {
        self.variants[usize::from(masked)].get_or_init(|| {
            let bindings = [storage_binding(true); 4];
            let bindings = if masked { &bindings[..] } else { &bindings[..1] };
            let chunk_layout = group_layout(device, "splat_cast", wgpu::ShaderStages::VERTEX, bindings);
            let pipeline = render_pipeline(device, masked, &[&self.map_layout, &chunk_layout]);
            Variant { pipeline, chunk_layout }
        })
    }

    /// Uploads the uniforms of every chunk of `casters`, and binds chunks that were not bound. `absent` is
    /// bound where nothing is read.
    pub(super) fn write(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        view: &mut CastView,
        absent: &wgpu::Buffer,
        (camera, near): (&Camera, f32),
        casters: &[Caster],
    ) -> Result<(), SplatError> {
        let last = std::mem::take(&mut view.chunks);
        cloud::check(casters.iter().map(|caster| &caster.cloud))?;
        if !camera.is_drawable() {
            return Ok(());
        }
        view.viewport = camera.viewport;
        let mut uniforms = Vec::new();
        for Caster { cloud, threshold } in casters.iter().filter(|caster| caster.cloud.is_drawable()) {
            let cuts = SplatCuts { least_opacity: cast_threshold(*threshold), ..SplatCuts::default() };
            let settings = SplatSettings { near, cuts, ..SplatSettings::default() };
            let mut of_cloud = cloud_uniforms((camera, None), cloud, &settings);
            // A shadow must not fade as its map gets coarser.
            of_cloud.flags &= !ANTIALIASED;
            if camera.is_orthographic() {
                of_cloud.flags |= UNCLIPPED;
            }
            let mask = cloud.mask().map(|visibility| visibility.mask.buffer.clone());
            for chunk in cloud.scene.chunks() {
                let (n_gaussians, first_gaussian) = (chunk.n_gaussians, chunk.first);
                uniforms.push(SplatChunk { n_gaussians, first_gaussian, ..of_cloud });
                let gaussians = chunk.gaussians.clone();
                let is_bound = |last: &&CastChunk| last.gaussians == gaussians && last.mask == mask;
                let group = match last.iter().find(is_bound) {
                    Some(last) => last.group.clone(),
                    None => self.bind(device, &gaussians, mask.as_ref(), absent),
                };
                view.chunks.push(CastChunk { gaussians, mask: mask.clone(), n_gaussians, group });
            }
        }
        let bytes = at_strides(uniforms);
        let size = bytes.len() as u64;
        if size > 0 && view.uniforms.as_ref().is_none_or(|(buffer, _)| buffer.size() < size) {
            let buffer = buffers::uniforms(device, "splat_cast", size);
            let resources = [one_of::<SplatChunk>(&buffer)];
            let group = bind_group(device, "splat_cast", &self.map_layout, &resources);
            view.uniforms = Some((buffer, group));
            view.written.clear();
        }
        if let Some((buffer, _)) = view.uniforms.as_ref().filter(|_| view.written != bytes) {
            queue.write_buffer(buffer, 0, &bytes);
            view.written = bytes;
        }
        Ok(())
    }

    fn bind(
        &self,
        device: &wgpu::Device,
        gaussians: &wgpu::Buffer,
        mask: Option<&wgpu::Buffer>,
        absent: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let with_mask = mask.map(|mask| [absent, absent, mask]);
        let buffers = std::iter::once(gaussians).chain(with_mask.into_iter().flatten());
        let resources: Vec<_> = buffers.map(wgpu::Buffer::as_entire_binding).collect();
        let layout = &self.variant(device, mask.is_some()).chunk_layout;
        bind_group(device, "splat_cast_chunk", layout, &resources)
    }

    /// Draws the chunks that were written.
    pub(super) fn encode(&self, pass: &mut wgpu::RenderPass, view: &CastView) {
        let Some((_, uniforms)) = view.uniforms.as_ref().filter(|_| !view.chunks.is_empty()) else { return };
        set_viewport(pass, view.viewport);
        for (i, chunk) in view.chunks.iter().enumerate() {
            // Compiled when the chunk was bound.
            let Some(variant) = self.variants[usize::from(chunk.mask.is_some())].get() else { continue };
            pass.set_pipeline(&variant.pipeline);
            pass.set_bind_group(0, uniforms, &[(i * stride::<SplatChunk>()) as u32]);
            pass.set_bind_group(1, &chunk.group, &[]);
            pass.draw(0..4, 0..chunk.n_gaussians);
        }
    }
}

fn render_pipeline(
    device: &wgpu::Device,
    masked: bool,
    groups: &[&wgpu::BindGroupLayout],
) -> wgpu::RenderPipeline {
    let source = shaders::cast(masked);
    let layout = pipeline_layout(device, source.label, groups);
    let module = shader_module(device, source);
    let topology = wgpu::PrimitiveTopology::TriangleStrip;
    // Reverse z: what is nearer to the light is larger.
    let depth = Some(depth_state(SHADOW_FORMAT, true, wgpu::CompareFunction::Greater));
    let drawing = Drawing::new("splat_cast", &module, &layout);
    Drawing { topology, depth, ..drawing }.pipeline(device)
}
