//! Looks in space on the GPU: `mix_layers`. CPU twin: [`stylegaussian::layers::mix_layers`].
//!
//! Each layer takes a dispatch or two over the blocks of Gaussians that it touches ([`plan`]): one over those within its region,
//! and one over those on its edge, where the region is evaluated ([`pack`]).

use std::sync::{Mutex, PoisonError};

use stylegaussian::layers::Region;
use stylegaussian_shaders::layers::{self as shaders, MixLayer};

use crate::{
    bindings::{
        bind_group, compute_pipeline, group_layout, pipeline_layout, storage_binding, uniform_binding,
    },
    buffers,
    colors::GaussianColors,
    splat::GpuScene,
};

mod pack;
mod plan;
#[cfg(test)]
mod tests;

pub use crate::mask::GaussianMask;
use plan::Dispatch;
pub use plan::MixedLayers;

/// Workgroups in one dimension of a dispatch, by WebGPU's default limits.
const MAX_WORKGROUPS: u32 = 65_535;

/// Colors in a region. The lowest layer comes first.
#[derive(Clone, Copy, Debug)]
pub struct GpuLayer<'a> {
    /// One color per Gaussian, or `None` for the captured colors.
    pub look: Option<&'a GaussianColors>,
    /// The part of the scene that gets them.
    pub region: Region,
    /// Share of the colors below that is replaced within the region, 0..1.
    pub strength: f32,
    /// Painted weights, and the channel of them that counts here; `None` if all of the region counts.
    pub mask: Option<(&'a GaussianMask, u32)>,
}

/// The kernel that mixes layers.
#[derive(Debug)]
pub struct LayerMixer {
    /// One for each shape, by its number.
    pipelines: Vec<wgpu::ComputePipeline>,
    layout: wgpu::BindGroupLayout,
    /// Bound in place of looks and masks that are not read.
    absent: wgpu::Buffer,
    pool: Mutex<Pool>,
}

/// Buffers of former submissions, to be used again in the next one.
#[derive(Debug, Default)]
struct Pool {
    /// Uniforms, one for each dispatch.
    uniforms: Vec<wgpu::Buffer>,
    /// Indices of blocks, one for each mix.
    blocks: Vec<wgpu::Buffer>,
    /// Number of uniforms and of blocks that the present submission uses.
    n_used: [usize; 2],
}

impl LayerMixer {
    /// Compiles the kernel, once for each shape.
    pub fn new(device: &wgpu::Device) -> Self {
        let (label, compute) = ("mix_layers", wgpu::ShaderStages::COMPUTE);
        let read = storage_binding(true);
        let bindings = [uniform_binding::<MixLayer>(), storage_binding(false), read, read, read, read];
        let layout = group_layout(device, label, compute, &bindings);
        let groups = pipeline_layout(device, label, &[&layout]);
        let pipeline = |shape: u32| {
            let constants = [("shape", f64::from(shape))];
            let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
            compute_pipeline(device, shaders::mix_layers(), &groups, options)
        };
        let pipelines = (0..=shaders::SHAPE_NOISE).map(pipeline).collect();
        let absent = buffers::create(device, "mix_absent", 16, wgpu::BufferUsages::STORAGE);
        Self { pipelines, layout, absent, pool: Mutex::default() }
    }

    /// Uses the buffers of the last submission again. They are written before a submission and not within it, so each of its
    /// dispatches needs its own.
    pub fn begin_submission(&self) {
        self.pool.lock().unwrap_or_else(PoisonError::into_inner).n_used = [0; 2];
    }

    /// Encodes the mix of any number of `layers` into `colors`, from the captured colors up. `mixed` says which layers `colors`
    /// hold, and only what differs is encoded; a new one stands for colors that hold anything. If something is encoded, the
    /// colors count as changed.
    ///
    /// Before the first mix of a submission, call [`begin_submission`](Self::begin_submission).
    ///
    /// # Panics
    /// If `colors`, a look or a mask is not of the scene's Gaussians, or if a look is `colors` itself.
    #[expect(clippy::too_many_arguments, reason = "three of them are the GPU")]
    pub fn encode(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        layers: &[GpuLayer],
        colors: &GaussianColors,
        mixed: &mut MixedLayers,
    ) {
        check(scene, layers, colors);
        // Layers that cover nothing are left out.
        let packed: Vec<_> = layers.iter().filter_map(|layer| Some((layer, pack::packed(layer)?))).collect();
        let seen: Vec<_> = packed.iter().map(|(layer, _)| **layer).collect();
        let (dispatches, blocks) = mixed.update(scene, &seen, colors);
        if dispatches.is_empty() {
            return;
        }
        let mut pool = self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        let blocks = pool.blocks(device, queue, &blocks);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("mix_layers"),
            ..Default::default()
        });
        for Dispatch { layer, is_edge, chunk, blocks: range } in dispatches {
            let chunk = &scene.chunks()[chunk];
            // Without a layer, the captured colors are written.
            let layer = layer.map(|index| &packed[index]);
            let (look, mask) = layer.map_or((None, None), |(layer, _)| (layer.look, layer.mask));
            let values = layer.map_or_else(pack::captured, |(_, (_, values))| *values);
            let shape = layer.filter(|_| is_edge).map_or(shaders::SHAPE_EVERYTHING, |(_, (shape, _))| *shape);
            let values = MixLayer {
                n_gaussians: chunk.n_gaussians,
                first_gaussian: chunk.first,
                first_block: range.start,
                n_blocks: range.len() as u32,
                ..values
            };
            let uniforms = pool.uniforms(device);
            queue.write_buffer(uniforms, 0, bytemuck::bytes_of(&values));
            let mask = mask.map_or(&self.absent, |(mask, _)| &mask.buffer);
            let look = look.map_or(&self.absent, GaussianColors::buffer);
            let buffers = [uniforms, colors.buffer(), &chunk.gaussians, mask, look, &blocks];
            let buffers = buffers.map(wgpu::Buffer::as_entire_binding);
            let group = bind_group(device, "mix_layers", &self.layout, &buffers);
            pass.set_pipeline(&self.pipelines[shape as usize]);
            pass.set_bind_group(0, &group, &[]);
            // Workgroups beyond the limit go into a second dimension.
            let x = (range.len() as u32).min(MAX_WORKGROUPS);
            pass.dispatch_workgroups(x, (range.len() as u32).div_ceil(x), 1);
        }
        drop(pass);
        colors.mark_changed();
    }
}

impl Pool {
    /// Uniforms of one dispatch.
    fn uniforms(&mut self, device: &wgpu::Device) -> &wgpu::Buffer {
        let index = self.n_used[0];
        if self.uniforms.len() == index {
            self.uniforms.push(buffers::uniforms(device, "mix_layers", size_of::<MixLayer>() as u64));
        }
        self.n_used[0] += 1;
        &self.uniforms[index]
    }

    /// A buffer that holds the blocks of one mix.
    fn blocks(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, blocks: &[u32]) -> wgpu::Buffer {
        let (index, bytes) = (self.n_used[1], size_of_val(blocks) as u64);
        let new = || buffers::storage(device, "mix_blocks", bytes.next_power_of_two().max(256));
        if self.blocks.len() == index {
            self.blocks.push(new());
        } else if self.blocks[index].size() < bytes {
            self.blocks[index] = new();
        }
        self.n_used[1] += 1;
        queue.write_buffer(&self.blocks[index], 0, bytemuck::cast_slice(blocks));
        self.blocks[index].clone()
    }
}

/// Checks that everything is of the scene's Gaussians.
fn check(scene: &GpuScene, layers: &[GpuLayer], colors: &GaussianColors) {
    let n = scene.n_gaussians();
    assert_eq!(colors.n_gaussians(), n, "one color per Gaussian");
    for layer in layers {
        assert!(layer.look.is_none_or(|look| look.n_gaussians() == n), "one color per Gaussian");
        assert!(layer.look.is_none_or(|look| look.buffer() != colors.buffer()), "a look is not the mix");
        assert!(layer.mask.is_none_or(|(mask, _)| mask.n_gaussians == n), "one weight per Gaussian");
    }
}
