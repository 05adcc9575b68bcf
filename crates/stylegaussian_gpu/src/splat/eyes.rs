//! Two eyes of one head: one kernel projects for both.
//!
//! What costs most does not depend on the eye: the reads, the spherical harmonics, the sort. Eyes are a few
//! centimeters apart, so one order, by the distance from their middle, and one color, seen from there, serve
//! both. Then no splat changes its color or its place in the order between the eyes. Footprints are each eye's
//! own.

use std::sync::OnceLock;

use glam::DVec3;
use stylegaussian_shaders::splat::{self as shaders, SplatChunk};

use super::{
    camera::{Camera, in_f64},
    cloud::{self, Cloud},
    error::SplatError,
    pass::SplatPass,
    project::{Project, dispatch},
    settings::SplatSettings,
    view::{Change, ChunkDispatch, SplatView},
};
use crate::bindings::{compute_pipeline, group_layout, pipeline_layout, storage_binding};

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
    fn eye_layout(&self, device: &wgpu::Device) -> &wgpu::BindGroupLayout {
        self.eyes.layout.get_or_init(|| {
            let uniforms = wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: wgpu::BufferSize::new(size_of::<SplatChunk>() as u64),
            };
            let write = storage_binding(false);
            let bindings = [uniforms, write, write];
            group_layout(device, "splat_second_eye", wgpu::ShaderStages::COMPUTE, &bindings)
        })
    }

    fn eye_kernel(&self, device: &wgpu::Device, is_masked: bool) -> &wgpu::ComputePipeline {
        self.eyes.kernels[usize::from(is_masked)].get_or_init(|| {
            let variant = if is_masked { self.masked(device) } else { &self.plain };
            let groups = [&self.view_layout, &variant.chunk_layout, self.eye_layout(device)];
            let source = shaders::project_eyes(is_masked);
            let layout = pipeline_layout(device, source.label, &groups);
            compute_pipeline(device, source, &layout, wgpu::PipelineCompilationOptions::default())
        })
    }

    /// Dispatches every chunk that was written for both eyes.
    fn encode_eyes(
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

impl SplatPass {
    /// Compiles what [`project_and_sort_eyes`](Self::project_and_sort_eyes) needs, in any thread, while others
    /// draw. Without this call, the first such frame compiles it.
    pub fn prepare_eyes(&self, device: &wgpu::Device) {
        self.project.eye_kernel(device, false);
        if binds_masks(device) {
            self.project.eye_kernel(device, true);
        }
    }

    /// Projects and sorts the splats of `clouds` for two eyes of one head, as
    /// [`project_and_sort`](Self::project_and_sort) does for one camera. A splat that either eye sees is drawn
    /// for both, in the color that it has from the middle between them. Both draw in the order of the distance
    /// from there, whatever the sort key of `settings` says. Each view is then drawn as usual.
    ///
    /// Parallel projections, cameras without a picture, and clouds with a mask on devices that bind fewer than
    /// nine storage buffers take no part: each view is then made by itself.
    ///
    /// # Errors
    /// As for one camera. Nothing is encoded then, and neither view shows anything.
    #[expect(clippy::too_many_arguments, reason = "three of them are wgpu's own at every call")]
    pub fn project_and_sort_eyes(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        [first, second]: [&mut SplatView; 2],
        cameras: [&Camera; 2],
        clouds: &[Cloud],
        settings: &SplatSettings,
    ) -> Result<(), SplatError> {
        let is_eye = |camera: &Camera| camera.is_drawable() && !camera.is_orthographic();
        let binds = |cloud: &Cloud| cloud.mask().is_none() || binds_masks(device);
        if !cameras.into_iter().all(is_eye) || !clouds.iter().all(binds) {
            for (view, camera) in [first, second].into_iter().zip(cameras) {
                self.project_and_sort(device, queue, encoder, view, camera, clouds, settings)?;
            }
            return Ok(());
        }
        first.clear();
        second.clear();
        cloud::check(clouds)?;
        let drawn: Vec<&Cloud> = clouds.iter().filter(|cloud| cloud.is_drawable()).collect();
        let n_records = drawn.iter().map(|cloud| cloud.scene.n_gaussians()).sum();
        if n_records == 0 {
            first.forget_all();
            second.forget_all();
            return Ok(());
        }
        SplatView::reserve_eyes(first, second, device, &self.sort, &self.draw.layout, n_records)?;
        let middle = middle(cameras);
        let mut change = Change::Nothing;
        for (view, camera) in [&mut *first, &mut *second].into_iter().zip(cameras) {
            view.set_paired(true);
            view.set_camera(queue, camera, n_records as u32);
            let own = self.project.write(device, queue, view, (camera, Some(middle)), &drawn, settings);
            change = change.max(self.relight(device, queue, view, camera, clouds, own));
        }
        if change == Change::Nothing {
            return Ok(());
        }
        if change == Change::Order {
            first.empty_lists();
            second.empty_lists();
        }
        let second_eye = second.second_eye(device, self.project.eye_layout(device)).cloned();
        let (Some(sort), Some(second_eye)) = (first.sort(), second_eye) else { return Ok(()) };
        first.clear_strokes(encoder);
        second.clear_strokes(encoder);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("splat_eyes"),
            timestamp_writes: None,
        });
        self.project.encode_eyes(device, &mut pass, first, &second_eye);
        self.project.encode_strokes(device, &mut pass, first);
        self.project.encode_strokes(device, &mut pass, second);
        self.light.encode(device, &mut pass, &first.lit);
        self.light.encode(device, &mut pass, &second.lit);
        if change == Change::Order {
            self.sort.encode(&mut pass, sort, n_records as u32);
        }
        Ok(())
    }
}

/// Whether the kernel can bind clouds with a mask.
fn binds_masks(device: &wgpu::Device) -> bool {
    device.limits().max_storage_buffers_per_shader_stage >= MASKED_BINDINGS
}

/// The place between two cameras, in world space.
fn middle(cameras: [&Camera; 2]) -> DVec3 {
    let [first, second] = cameras.map(|camera| in_f64(&camera.world_from_view).translation);
    0.5 * (first + second)
}

#[cfg(test)]
mod tests;
