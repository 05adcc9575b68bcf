//! Looks in space on the GPU: `mix_layers` mixes their colors, and `mix_strokes` their strokes. CPU twins:
//! [`stylegaussian::layers::mix_layers`], [`stylegaussian::strokes::mix_strokes`].
//!
//! All layers that fit into one dispatch are mixed by it, in the blocks of Gaussians that differ from the last
//! mix (`plan`). Each block names the layers that reach it, and only on the edge of a region, the region is
//! evaluated (`pack`).

use std::sync::{Mutex, OnceLock, PoisonError};

use stylegaussian_shaders::{
    Source,
    layers::{self as shaders, MixLayer, MixStack},
};

use crate::{
    bindings::{
        at_strides, bind_group, compute_pass, compute_pipeline, group_layout, one_of, pipeline_layout,
        storage_binding, stride, uniforms_binding,
    },
    buffers,
    colors::GaussianColors,
    device::GpuEncoder,
    splat::GpuScene,
};

mod layer;
mod pack;
mod plan;
mod strokes;
#[cfg(test)]
mod tests;

pub use crate::mask::GaussianMask;
pub use layer::GpuLayer;
pub use plan::MixedLayers;
use plan::{Dispatch, Values};
pub use strokes::StrokeMix;

/// Workgroups in one dimension of a dispatch, by WebGPU's default limits.
const MAX_WORKGROUPS: u32 = 65_535;

/// The kernels that mix layers.
#[derive(Debug)]
pub struct LayerMixer {
    /// For colors, without noise and with it.
    of_colors: Pipelines,
    /// For strokes, compiled when they are asked for, or when the first are mixed.
    of_strokes: OnceLock<Pipelines>,
    layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
    /// Bound in place of looks and masks that are not read.
    absent: wgpu::Buffer,
    pool: Mutex<Pool>,
}

/// A kernel without noise, and with it.
type Pipelines = [wgpu::ComputePipeline; 2];

/// Buffers of former submissions, to be used again in the next one.
#[derive(Debug, Default)]
struct Pool {
    /// Uniforms and blocks, for one mix each.
    buffers: Vec<[wgpu::Buffer; 2]>,
    /// Number of those that the present submission uses.
    n_used: usize,
}

impl LayerMixer {
    /// Compiles the kernel for colors.
    pub fn new(device: &wgpu::Device) -> Self {
        let (label, compute) = ("mix_layers", wgpu::ShaderStages::COMPUTE);
        let read = storage_binding(true);
        // All dispatches of a mix share a buffer, each at an offset of its own: one write costs less than many.
        let uniforms = uniforms_binding::<MixStack>();
        let bindings = [uniforms, storage_binding(false), read, read, read, read, read, read, read];
        let layout = group_layout(device, label, compute, &bindings);
        let pipeline_layout = pipeline_layout(device, label, &[&layout]);
        let of_colors = pipelines(device, shaders::mix_layers, &pipeline_layout);
        let absent = buffers::create(device, "mix_absent", 16, wgpu::BufferUsages::STORAGE);
        let (of_strokes, pool) = (OnceLock::new(), Mutex::default());
        Self { of_colors, of_strokes, layout, pipeline_layout, absent, pool }
    }

    /// Compiles the kernel for strokes, in any thread, while others mix. Without this call, the first mix of
    /// strokes compiles it.
    pub fn prepare_strokes(&self, device: &wgpu::Device) {
        self.strokes_pipelines(device);
    }

    fn strokes_pipelines(&self, device: &wgpu::Device) -> &Pipelines {
        self.of_strokes.get_or_init(|| pipelines(device, shaders::mix_strokes, &self.pipeline_layout))
    }

    /// Uses the buffers of the last submission again. They are written before a submission and not within it,
    /// so each of its mixes needs its own.
    pub fn begin_submission(&self) {
        self.pool.lock().unwrap_or_else(PoisonError::into_inner).n_used = 0;
    }

    /// Encodes the mix of any number of `layers` into `colors`, from the captured colors up. `mixed` says which
    /// layers `colors` hold, and only what differs is encoded; a new one stands for colors that hold anything.
    /// If something is encoded, the colors count as changed.
    ///
    /// Before the first mix of a submission, call [`begin_submission`](Self::begin_submission).
    ///
    /// # Panics
    /// If `colors`, a look or a mask is not of the scene's Gaussians, or if a look is `colors` itself.
    pub fn encode(
        &self,
        gpu: &mut GpuEncoder,
        scene: &GpuScene,
        layers: &[GpuLayer],
        colors: &GaussianColors,
        mixed: &mut MixedLayers,
    ) {
        check(scene, layers, colors);
        let values = |layer: &GpuLayer| {
            let look = layer.look?;
            Some(Values { buffer: Some(look.buffer().clone()), version: look.version(), first_seed: 0 })
        };
        let of_colors = layers.iter().filter(|layer| layer.factors.is_none());
        let layers: Vec<_> = of_colors.map(|layer| (layer, values(layer))).collect();
        if self.encode_values(gpu, &self.of_colors, scene, layers, colors.buffer(), mixed) {
            colors.mark_changed();
        }
    }

    /// Encodes the mix of `layers` and their values into `target`. Returns whether there was anything to do.
    fn encode_values(
        &self,
        gpu: &mut GpuEncoder,
        pipelines: &Pipelines,
        scene: &GpuScene,
        layers: Vec<(&GpuLayer, Option<Values>)>,
        target: &wgpu::Buffer,
        mixed: &mut MixedLayers,
    ) -> bool {
        // Layers that cover nothing are left out.
        let seen = layers.into_iter().filter_map(|layer| Some((pack::packed(layer.0)?, layer)));
        let (packed, seen): (Vec<_>, Vec<_>) = seen.unzip();
        let (dispatches, blocks) = mixed.update(scene, &seen, target);
        if dispatches.is_empty() {
            return false;
        }
        let stacks: Vec<_> = dispatches
            .iter()
            .map(|dispatch| {
                let range = dispatch.layers.clone();
                Stack::new(scene, dispatch, &packed[range.clone()], &seen[range])
            })
            .collect();
        let mut pool = self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        let uniforms = at_strides(stacks.iter().map(|stack| stack.uniforms));
        let [uniforms, blocks] = pool.next(gpu, [&uniforms, bytemuck::cast_slice(&blocks)]);
        let mut pass = compute_pass(gpu.encoder, "mix_layers");
        for (i, (dispatch, stack)) in dispatches.iter().zip(&stacks).enumerate() {
            let gaussians = &scene.chunks()[dispatch.chunk].gaussians;
            let masks = stack.mask.map_or(&self.absent, |mask| &mask.buffer);
            let look = |i: usize| stack.looks.get(i).copied().unwrap_or(&self.absent);
            let buffers = [target, gaussians, masks, &blocks, look(0), look(1), look(2), look(3)];
            let uniforms = std::iter::once(one_of::<MixStack>(&uniforms));
            let resources: Vec<_> = uniforms.chain(buffers.map(wgpu::Buffer::as_entire_binding)).collect();
            let has_noise = stack.uniforms.layers.iter().any(|layer| layer.shape == shaders::SHAPE_NOISE);
            pass.set_pipeline(&pipelines[usize::from(has_noise)]);
            let group = bind_group(gpu.device, "mix_layers", &self.layout, &resources);
            pass.set_bind_group(0, &group, &[(i * stride::<MixStack>()) as u32]);
            // Workgroups beyond the limit go into a second dimension.
            let n = (dispatch.blocks.len() as u32).div_ceil(shaders::MIX_WORKGROUP / shaders::MIX_BLOCK);
            let x = n.min(MAX_WORKGROUPS);
            pass.dispatch_workgroups(x, n.div_ceil(x), 1);
        }
        true
    }
}

/// The pipelines of a kernel.
fn pipelines(device: &wgpu::Device, source: fn() -> Source, layout: &wgpu::PipelineLayout) -> Pipelines {
    [0.0, 1.0].map(|has_noise| {
        let constants = [("has_noise", has_noise)];
        let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        compute_pipeline(device, source(), layout, options)
    })
}

/// A dispatch as the kernel takes it.
struct Stack<'a> {
    uniforms: MixStack,
    /// Its looks by their numbers.
    looks: Vec<&'a wgpu::Buffer>,
    mask: Option<&'a GaussianMask>,
}

impl<'a> Stack<'a> {
    /// The dispatch of `layers`.
    fn new(
        scene: &GpuScene,
        dispatch: &Dispatch,
        packed: &[MixLayer],
        layers: &'a [(&GpuLayer<'a>, Option<Values>)],
    ) -> Self {
        let (chunk, blocks) = (&scene.chunks()[dispatch.chunk], &dispatch.blocks);
        let mut looks: Vec<&wgpu::Buffer> = Vec::new();
        let mut number = |look: &'a wgpu::Buffer| {
            let known = looks.iter().position(|known| *known == look);
            known.unwrap_or_else(|| {
                looks.push(look);
                looks.len() - 1
            }) as u32
        };
        let mut uniforms = MixStack {
            layers: [MixLayer::default(); shaders::MIX_LAYERS as usize],
            n_gaussians: chunk.n_gaussians,
            first_gaussian: chunk.first,
            first_block: blocks.start,
            n_blocks: blocks.len() as u32,
        };
        for (place, (packed, (_, look))) in uniforms.layers.iter_mut().zip(packed.iter().zip(layers)) {
            let first_seed = look.as_ref().map_or(0, |look| look.first_seed);
            let look = look.as_ref().and_then(|look| look.buffer.as_ref());
            *place = MixLayer { look: look.map_or(packed.look, &mut number), first_seed, ..*packed };
        }
        let mask = layers.iter().find_map(|(layer, _)| layer.mask.map(|(mask, _)| mask));
        Self { uniforms, looks, mask }
    }
}

impl Pool {
    /// Buffers that hold the uniforms and the blocks of one mix.
    fn next(&mut self, gpu: &GpuEncoder, contents: [&[u8]; 2]) -> [wgpu::Buffer; 2] {
        let new = |i: usize| {
            let bytes = (contents[i].len() as u64).next_power_of_two();
            match i {
                0 => buffers::uniforms(gpu.device, "mix_layers", bytes),
                _ => buffers::storage(gpu.device, "mix_blocks", bytes),
            }
        };
        if self.buffers.len() == self.n_used {
            self.buffers.push([new(0), new(1)]);
        }
        let buffers = &mut self.buffers[self.n_used];
        self.n_used += 1;
        for i in 0..2 {
            if buffers[i].size() < contents[i].len() as u64 {
                buffers[i] = new(i);
            }
            gpu.queue.write_buffer(&buffers[i], 0, contents[i]);
        }
        buffers.clone()
    }
}

/// Checks that everything is of the scene's Gaussians.
fn check(scene: &GpuScene, layers: &[GpuLayer], colors: &GaussianColors) {
    let n = scene.n_gaussians();
    assert_eq!(colors.n_gaussians(), n, "one color per Gaussian");
    for layer in layers {
        assert!(layer.look.is_none_or(|look| look.n_gaussians() == n), "one color per Gaussian");
        assert!(layer.look.is_none_or(|look| look.buffer() != colors.buffer()), "a look is not the mix");
        check_mask(layer, n);
    }
}

/// Checks that a layer's mask is of `n` Gaussians.
fn check_mask(layer: &GpuLayer, n: usize) {
    assert!(layer.mask.is_none_or(|(mask, _)| mask.n_gaussians == n), "one weight per Gaussian");
}
