//! Looks in space on the GPU: `mix_layers`. CPU twin: [`stylegaussian::layers::mix_layers`].
//!
//! All layers that fit into one dispatch are mixed by it, in the blocks of Gaussians that differ from the last mix (`plan`). Each
//! block names the layers that reach it, and only on the edge of a region, the region is evaluated (`pack`).

use std::sync::{Mutex, PoisonError};

use stylegaussian::layers::Region;
use stylegaussian_shaders::layers::{self as shaders, MixLayer, MixStack};

use crate::{
    bindings::{bind_group, compute_pipeline, group_layout, pipeline_layout, storage_binding},
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
    /// Without noise, and with it.
    pipelines: [wgpu::ComputePipeline; 2],
    layout: wgpu::BindGroupLayout,
    /// Bound in place of looks and masks that are not read.
    absent: wgpu::Buffer,
    pool: Mutex<Pool>,
}

/// Buffers of former submissions, to be used again in the next one.
#[derive(Debug, Default)]
struct Pool {
    /// Uniforms and blocks, for one mix each.
    buffers: Vec<[wgpu::Buffer; 2]>,
    /// Number of those that the present submission uses.
    n_used: usize,
}

impl LayerMixer {
    /// Compiles the kernel.
    pub fn new(device: &wgpu::Device) -> Self {
        let (label, compute) = ("mix_layers", wgpu::ShaderStages::COMPUTE);
        let read = storage_binding(true);
        // All dispatches of a mix share a buffer, each at an offset of its own: one write costs less than many.
        let uniforms = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: true,
            min_binding_size: wgpu::BufferSize::new(size_of::<MixStack>() as u64),
        };
        let bindings = [uniforms, storage_binding(false), read, read, read, read, read, read, read];
        let layout = group_layout(device, label, compute, &bindings);
        let groups = pipeline_layout(device, label, &[&layout]);
        let pipelines = [0.0, 1.0].map(|has_noise| {
            let constants = [("has_noise", has_noise)];
            let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
            compute_pipeline(device, shaders::mix_layers(), &groups, options)
        });
        let absent = buffers::create(device, "mix_absent", 16, wgpu::BufferUsages::STORAGE);
        Self { pipelines, layout, absent, pool: Mutex::default() }
    }

    /// Uses the buffers of the last submission again. They are written before a submission and not within it, so each of its
    /// mixes needs its own.
    pub fn begin_submission(&self) {
        self.pool.lock().unwrap_or_else(PoisonError::into_inner).n_used = 0;
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
        let stacks: Vec<_> = dispatches
            .iter()
            .map(|dispatch| Stack::new(scene, dispatch, &packed[dispatch.layers.clone()]))
            .collect();
        let mut pool = self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        let [uniforms, blocks] =
            pool.next(device, queue, [&at_offsets(&stacks), bytemuck::cast_slice(&blocks)]);
        let uniforms = uniforms.as_entire_buffer_binding();
        let uniforms =
            wgpu::BufferBinding { size: wgpu::BufferSize::new(size_of::<MixStack>() as u64), ..uniforms };
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("mix_layers"),
            ..Default::default()
        });
        for (i, (dispatch, stack)) in dispatches.iter().zip(&stacks).enumerate() {
            let gaussians = &scene.chunks()[dispatch.chunk].gaussians;
            let masks = stack.mask.map_or(&self.absent, |mask| &mask.buffer);
            let look = |i: usize| stack.looks.get(i).map_or(&self.absent, |look| look.buffer());
            let buffers = [colors.buffer(), gaussians, masks, &blocks, look(0), look(1), look(2), look(3)];
            let uniforms = wgpu::BindingResource::Buffer(uniforms.clone());
            let resources: Vec<_> =
                std::iter::once(uniforms).chain(buffers.map(wgpu::Buffer::as_entire_binding)).collect();
            let has_noise = stack.uniforms.layers.iter().any(|layer| layer.shape == shaders::SHAPE_NOISE);
            pass.set_pipeline(&self.pipelines[usize::from(has_noise)]);
            let group = bind_group(device, "mix_layers", &self.layout, &resources);
            pass.set_bind_group(0, &group, &[(i * OFFSET) as u32]);
            // Workgroups beyond the limit go into a second dimension.
            let n = (dispatch.blocks.len() as u32).div_ceil(shaders::MIX_WORKGROUP / shaders::MIX_BLOCK);
            let x = n.min(MAX_WORKGROUPS);
            pass.dispatch_workgroups(x, n.div_ceil(x), 1);
        }
        drop(pass);
        colors.mark_changed();
    }
}

/// A dispatch as the kernel takes it.
struct Stack<'a> {
    uniforms: MixStack,
    /// Its looks by their numbers.
    looks: Vec<&'a GaussianColors>,
    mask: Option<&'a GaussianMask>,
}

impl<'a> Stack<'a> {
    /// The dispatch of `layers`.
    fn new(scene: &GpuScene, dispatch: &Dispatch, layers: &[(&GpuLayer<'a>, MixLayer)]) -> Self {
        let (chunk, blocks) = (&scene.chunks()[dispatch.chunk], &dispatch.blocks);
        let mut looks: Vec<&GaussianColors> = Vec::new();
        let mut number = |look: &'a GaussianColors| {
            let known = looks.iter().position(|known| known.buffer() == look.buffer());
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
        for (place, (layer, values)) in uniforms.layers.iter_mut().zip(layers) {
            *place = MixLayer { look: layer.look.map_or(shaders::NO_LOOK, &mut number), ..*values };
        }
        let mask = layers.iter().find_map(|(layer, _)| layer.mask.map(|(mask, _)| mask));
        Self { uniforms, looks, mask }
    }
}

/// Distance of uniforms in their buffer: their size, and a multiple of the largest alignment that a device may ask for.
const OFFSET: usize = size_of::<MixStack>().next_multiple_of(256);

/// Uniforms as they lie in their buffer.
fn at_offsets(stacks: &[Stack]) -> Vec<u8> {
    let mut bytes = vec![0; OFFSET * stacks.len()];
    for (place, stack) in bytes.chunks_exact_mut(OFFSET).zip(stacks) {
        place[..size_of::<MixStack>()].copy_from_slice(bytemuck::bytes_of(&stack.uniforms));
    }
    bytes
}

impl Pool {
    /// Buffers that hold the uniforms and the blocks of one mix.
    fn next(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        contents: [&[u8]; 2],
    ) -> [wgpu::Buffer; 2] {
        let new = |i: usize| {
            let bytes = (contents[i].len() as u64).next_power_of_two();
            match i {
                0 => buffers::uniforms(device, "mix_layers", bytes),
                _ => buffers::storage(device, "mix_blocks", bytes),
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
            queue.write_buffer(&buffers[i], 0, contents[i]);
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
        assert!(layer.mask.is_none_or(|(mask, _)| mask.n_gaussians == n), "one weight per Gaussian");
    }
}
