//! Two eyes of one head: one kernel projects for both.
//!
//! What costs most does not depend on the eye: the reads, the spherical harmonics, the sort. Eyes are a few
//! centimeters apart, so one order, by the distance from their middle, and one color, seen from there, serve
//! both. Then no splat changes its color or its place in the order between the eyes: both views hold the same
//! list on the GPU, however the head moves. Footprints are each eye's own.

use std::sync::OnceLock;

use glam::{Affine3A, DVec3, Vec4};
use stylegaussian_shaders::splat::{self as shaders, SplatChunk};

use super::{
    camera::{Camera, in_f64},
    dispatch::dispatch,
    project::Project,
    view::{ChunkDispatch, SplatView},
};
use crate::bindings::{compute_pipeline, group_layout, pipeline_layout, storage_binding, uniforms_binding};

/// Storage buffers that the kernel binds for clouds with a mask: keys, records of both eyes, Gaussians,
/// spherical harmonics, colors, mask. WebGPU's default limit is one less.
const MASKED_BINDINGS: u32 = 9;

/// The kernels, for clouds without and with a mask, each compiled when it is asked for.
#[derive(Debug, Default)]
pub(super) struct EyeStage {
    layout: OnceLock<wgpu::BindGroupLayout>,
    kernels: [OnceLock<wgpu::ComputePipeline>; 2],
}

impl Project {
    /// Group 2: the second eye's uniforms, and both halves of its records.
    pub(super) fn eye_layout(&self, device: &wgpu::Device) -> &wgpu::BindGroupLayout {
        self.eyes.layout.get_or_init(|| {
            let write = storage_binding(false);
            let bindings = [uniforms_binding::<SplatChunk>(), write, write];
            group_layout(device, "splat_second_eye", wgpu::ShaderStages::COMPUTE, &bindings)
        })
    }

    pub(super) fn eye_kernel(&self, device: &wgpu::Device, is_masked: bool) -> &wgpu::ComputePipeline {
        self.eyes.kernels[usize::from(is_masked)].get_or_init(|| {
            let variant = if is_masked { self.masked(device) } else { &self.plain };
            let groups = [&self.view_layout, &variant.chunk_layout, self.eye_layout(device)];
            let source = shaders::project_eyes(is_masked);
            let layout = pipeline_layout(device, source.label, &groups);
            compute_pipeline(device, source, &layout, wgpu::PipelineCompilationOptions::default())
        })
    }

    /// Dispatches every chunk that was written for both eyes.
    pub(super) fn encode_eyes(
        &self,
        device: &wgpu::Device,
        pass: &mut wgpu::ComputePass,
        first: &SplatView,
        second: &wgpu::BindGroup,
    ) {
        for (of_view, ChunkDispatch { offset, n_gaussians, bind_group, is_masked }) in
            first.chunk_dispatches()
        {
            pass.set_pipeline(self.eye_kernel(device, is_masked));
            pass.set_bind_group(0, of_view, &[offset]);
            pass.set_bind_group(1, bind_group, &[]);
            pass.set_bind_group(2, second, &[offset]);
            dispatch(pass, n_gaussians);
        }
    }
}

/// Whether the kernel can bind clouds with a mask.
pub(super) fn binds_masks(device: &wgpu::Device) -> bool {
    device.limits().max_storage_buffers_per_shader_stage >= MASKED_BINDINGS
}

/// The place between two cameras, in world space.
pub(super) fn middle(cameras: [&Camera; 2]) -> DVec3 {
    let [first, second] = cameras.map(|camera| in_f64(&camera.world_from_view).translation);
    0.5 * (first + second)
}

/// Origin of the rays of both eyes in a space that `world_from_scene` places in the world: (eye, 1), where the
/// eye is the `middle` between them.
pub(super) fn eye_between(middle: DVec3, world_from_scene: &Affine3A) -> Vec4 {
    in_f64(world_from_scene).inverse().transform_point3(middle).as_vec3().extend(1.0)
}

#[cfg(test)]
mod tests;
