//! Looks in space on the GPU: `mix_layers`. CPU twin: [`stylegaussian::layers::mix_layers`].

use std::sync::{Mutex, PoisonError};

use bytemuck::Zeroable;
use glam::{Affine3A, Vec3, Vec4};
use stylegaussian::layers::{Region, Shape};
use stylegaussian_shaders::layers::{self as shaders, LayerMix, MAX_LAYERS, MAX_LOOKS, MixLayer};

use crate::{
    bindings::{
        bind_group, compute_pipeline, group_layout, pipeline_layout, storage_binding, uniform_binding,
    },
    buffers,
    colors::GaussianColors,
    splat::GpuScene,
};

pub use crate::mask::GaussianMask;

/// Workgroups in one dimension of a dispatch, by WebGPU's default limits.
const MAX_WORKGROUPS: u32 = 65_535;

/// Sizes and distances beyond this are drawn in to it: their squares stay within f32, and no scene reaches there.
const FAR: f32 = 1e9;

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
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Bound in place of looks and masks that are not read.
    absent: wgpu::Buffer,
    uniforms: Mutex<Uniforms>,
}

/// Uniforms of dispatches, one for each, to be used again in the next submission.
#[derive(Debug, Default)]
struct Uniforms {
    buffers: Vec<wgpu::Buffer>,
    /// Number of those that the present submission uses.
    n_used: usize,
}

impl LayerMixer {
    /// Compiles the kernel.
    pub fn new(device: &wgpu::Device) -> Self {
        let (label, compute) = ("mix_layers", wgpu::ShaderStages::COMPUTE);
        let read = storage_binding(true);
        let bindings =
            [uniform_binding::<LayerMix>(), storage_binding(false), read, read, read, read, read, read];
        let layout = group_layout(device, label, compute, &bindings);
        let pipelines = pipeline_layout(device, label, &[&layout]);
        let options = wgpu::PipelineCompilationOptions::default();
        let pipeline = compute_pipeline(device, shaders::mix_layers(), &pipelines, options);
        let absent = buffers::create(device, "mix_absent", 16, wgpu::BufferUsages::STORAGE);
        Self { pipeline, layout, absent, uniforms: Mutex::default() }
    }

    /// Uses the uniforms again. They are written before a submission and not within it, so each of its dispatches needs its
    /// own.
    pub fn begin_submission(&self) {
        self.uniforms.lock().unwrap_or_else(PoisonError::into_inner).n_used = 0;
    }

    /// Encodes the mix of `layers` into `colors`, from the captured colors up. Any number of layers, looks and masks takes as
    /// many dispatches as they need. The colors count as changed.
    ///
    /// Before the first mix of a submission, call [`begin_submission`](Self::begin_submission).
    ///
    /// # Panics
    /// If `colors`, a look or a mask is not of the scene's Gaussians, or if a look is `colors` itself.
    pub fn encode(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        layers: &[GpuLayer],
        colors: &GaussianColors,
    ) {
        check(scene, layers, colors);
        let batches = batches(layers);
        let mut uniforms = self.uniforms.lock().unwrap_or_else(PoisonError::into_inner);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("mix_layers"),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        for (i, batch) in batches.iter().enumerate() {
            for chunk in scene.chunks() {
                let values = LayerMix {
                    n_gaussians: chunk.n_gaussians,
                    first_gaussian: chunk.first,
                    continues: u32::from(i > 0),
                    ..batch.uniforms
                };
                let buffer = uniforms.next(device);
                queue.write_buffer(buffer, 0, bytemuck::bytes_of(&values));
                let group = self.bind(device, buffer, &chunk.gaussians, batch, colors);
                let n = chunk.n_gaussians.div_ceil(shaders::MIX_WORKGROUP);
                // Workgroups beyond the limit go into a second dimension.
                let x = n.min(MAX_WORKGROUPS);
                pass.set_bind_group(0, &group, &[]);
                pass.dispatch_workgroups(x, n.div_ceil(x.max(1)), 1);
            }
        }
        drop(pass);
        colors.mark_changed();
    }

    fn bind(
        &self,
        device: &wgpu::Device,
        uniforms: &wgpu::Buffer,
        gaussians: &wgpu::Buffer,
        batch: &Batch,
        colors: &GaussianColors,
    ) -> wgpu::BindGroup {
        let mask = batch.mask.map_or(&self.absent, |mask| &mask.buffer);
        let look = |i: usize| batch.looks.get(i).map_or(&self.absent, |look| look.buffer());
        let buffers = [uniforms, colors.buffer(), gaussians, mask, look(0), look(1), look(2), look(3)];
        bind_group(device, "mix_layers", &self.layout, &buffers.map(wgpu::Buffer::as_entire_binding))
    }
}

impl Uniforms {
    fn next(&mut self, device: &wgpu::Device) -> &wgpu::Buffer {
        if self.buffers.len() == self.n_used {
            self.buffers.push(buffers::uniforms(device, "mix_layers", size_of::<LayerMix>() as u64));
        }
        self.n_used += 1;
        &self.buffers[self.n_used - 1]
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

/// The layers of one dispatch.
#[derive(Default)]
struct Batch<'a> {
    uniforms: LayerMix,
    looks: Vec<&'a GaussianColors>,
    mask: Option<&'a GaussianMask>,
}

/// Layers in their order, as many in a dispatch as its uniforms and bindings hold. At least one dispatch: without layers it
/// writes the captured colors.
fn batches<'a>(layers: &[GpuLayer<'a>]) -> Vec<Batch<'a>> {
    let mut batches = vec![Batch::default()];
    for layer in layers {
        let Some(packed) = packed(layer) else { continue };
        if !batches.last().is_some_and(|batch| batch.takes(layer)) {
            batches.push(Batch::default());
        }
        if let Some(batch) = batches.last_mut() {
            batch.push(layer, packed);
        }
    }
    batches
}

impl<'a> Batch<'a> {
    /// The index of a look among those that are bound.
    fn index_of(&self, look: &GaussianColors) -> Option<usize> {
        self.looks.iter().position(|bound| bound.buffer() == look.buffer())
    }

    /// Whether there is room for a layer.
    fn takes(&self, layer: &GpuLayer) -> bool {
        let has_look =
            layer.look.is_none_or(|look| self.looks.len() < MAX_LOOKS || self.index_of(look).is_some());
        let has_mask = match (self.mask, layer.mask) {
            (Some(bound), Some((mask, _))) => bound.buffer == mask.buffer,
            _ => true,
        };
        (self.uniforms.n_layers as usize) < MAX_LAYERS && has_look && has_mask
    }

    fn push(&mut self, layer: &GpuLayer<'a>, mut packed: MixLayer) {
        if let Some(look) = layer.look {
            let index = self.index_of(look).unwrap_or(self.looks.len());
            if index == self.looks.len() {
                self.looks.push(look);
            }
            packed.look = index as u32;
        }
        if let Some((mask, channel)) = layer.mask {
            self.mask = Some(mask);
            packed.mask = channel;
        }
        self.uniforms.layers[self.uniforms.n_layers as usize] = packed;
        self.uniforms.n_layers += 1;
    }
}

/// A layer without look and mask, or `None` if it covers nothing. WGSL leaves NaN and infinity undefined, so that they are
/// sorted out here, with the twin's meaning.
fn packed(layer: &GpuLayer) -> Option<MixLayer> {
    let Region { shape, shape_from_scene, softness } = layer.region;
    let (kind, sizes) = kind_and_sizes(shape);
    let everywhere = kind == shaders::SHAPE_EVERYTHING;
    // An ellipsoid and noise divide by their sizes. The comparisons are false for NaN as well.
    let divides = [shaders::SHAPE_ELLIPSOID, shaders::SHAPE_NOISE].contains(&kind);
    let n_divisors = if kind == shaders::SHAPE_ELLIPSOID { 3 } else { 1 };
    let has_size = sizes.iter().all(|&size| size >= 0.0)
        && (!divides || sizes[..n_divisors].iter().all(|&size| size > 0.0));
    let covers = everywhere || (shape_from_scene.is_finite() && has_size);
    let is_seen = layer.strength > 0.0;
    if !covers || softness.is_nan() || !is_seen {
        return None;
    }
    let Affine3A { matrix3, translation } = shape_from_scene;
    let row = |i: usize| {
        let row = Vec3::from(matrix3.row(i)).extend(translation[i]);
        row.clamp(Vec4::splat(-FAR), Vec4::splat(FAR)).to_array()
    };
    let rows = if everywhere { [[0.0; 4]; 3] } else { [row(0), row(1), row(2)] };
    let softness = softness.clamp(0.0, FAR);
    Some(MixLayer {
        shape_from_scene_x: rows[0],
        shape_from_scene_y: rows[1],
        shape_from_scene_z: rows[2],
        sizes: sizes.map(|size| size.min(FAR)),
        shape: kind,
        look: shaders::NO_LOOK,
        mask: shaders::NO_MASK,
        strength: layer.strength.min(1.0),
        softness,
        // The reciprocal of a width below 1e-38 is infinite. Such an edge is hard.
        inverse_softness: Some(softness.recip()).filter(|value| value.is_finite()).unwrap_or(0.0),
        ..MixLayer::zeroed()
    })
}

/// The number of a shape, and its sizes in the order of their names.
fn kind_and_sizes(shape: Shape) -> (u32, [f32; 4]) {
    match shape {
        Shape::Everything => (shaders::SHAPE_EVERYTHING, [0.0; 4]),
        Shape::HalfSpace => (shaders::SHAPE_HALF_SPACE, [0.0; 4]),
        Shape::Ellipsoid { radii } => (shaders::SHAPE_ELLIPSOID, radii.extend(0.0).to_array()),
        Shape::Cuboid { half_size } => (shaders::SHAPE_CUBOID, half_size.extend(0.0).to_array()),
        Shape::Cylinder { radius, half_height } => (shaders::SHAPE_CYLINDER, [radius, half_height, 0.0, 0.0]),
        Shape::Capsule { radius, half_length } => (shaders::SHAPE_CAPSULE, [radius, half_length, 0.0, 0.0]),
        Shape::Cone { radius, height } => (shaders::SHAPE_CONE, [radius, height, 0.0, 0.0]),
        Shape::Torus { major_radius, minor_radius } => {
            (shaders::SHAPE_TORUS, [major_radius, minor_radius, 0.0, 0.0])
        }
        Shape::Noise { size, level } => (shaders::SHAPE_NOISE, [size, level, 0.0, 0.0]),
    }
}

#[cfg(test)]
mod tests;
