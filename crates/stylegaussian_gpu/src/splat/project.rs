//! The project stage on the GPU: `splat_project`.

use bytemuck::Zeroable;
use glam::Affine3A;
use stylegaussian::scene::ScreenFilter;
use stylegaussian_shaders::splat::{
    self as shaders, ANTIALIASED, BY_DISTANCE, FROM_CAPTURED_COLORS, NO_SH, SplatChunk, TO_CAPTURED_COLORS,
    WORKGROUP,
};

use super::{
    camera::Camera,
    cloud::Cloud,
    scene::Chunk,
    settings::{SortKey, SplatSettings},
    view::{Change, ChunkBindings, ChunkDispatch, SplatView},
};
use crate::{
    bindings::{bind_group, compute_pipeline, group_layout, pipeline_layout, storage_binding},
    buffers,
    colors::GaussianColors,
};

/// Workgroups in one dimension of a dispatch, by WebGPU's default limits.
const MAX_WORKGROUPS: u32 = 65_535;

/// The pipeline and the layouts of its bindings.
#[derive(Debug)]
pub(super) struct Project {
    pipeline: wgpu::ComputePipeline,
    /// Group 0: the chunk's uniforms, keys, and both halves of the records.
    view_layout: wgpu::BindGroupLayout,
    /// Group 1: Gaussians, spherical harmonics, both color sources.
    chunk_layout: wgpu::BindGroupLayout,
    /// Bound if a scene has no spherical harmonics, or if a color source is not read.
    absent: wgpu::Buffer,
}

impl Project {
    pub fn new(device: &wgpu::Device) -> Self {
        let uniforms = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: true,
            min_binding_size: wgpu::BufferSize::new(size_of::<SplatChunk>() as u64),
        };
        let (label, compute) = ("splat_project", wgpu::ShaderStages::COMPUTE);
        let write = storage_binding(false);
        let view_layout = group_layout(device, label, compute, &[uniforms, write, write, write]);
        let chunk_layout = group_layout(device, label, compute, &[storage_binding(true); 4]);
        let absent = buffers::create(device, "splat_absent", 16, wgpu::BufferUsages::STORAGE);
        let layout = pipeline_layout(device, label, &[&view_layout, &chunk_layout]);
        let options = wgpu::PipelineCompilationOptions::default();
        let pipeline = compute_pipeline(device, shaders::project(), &layout, options);
        Self { pipeline, view_layout, chunk_layout, absent }
    }

    /// Uploads the uniforms of every chunk of `clouds`, and makes bindings for chunks that have none. Returns the
    /// difference from the frame that made the records.
    pub fn write(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        view: &mut SplatView,
        camera: &Camera,
        clouds: &[&Cloud],
        settings: &SplatSettings,
    ) -> Change {
        let n_chunks = clouds.iter().map(|cloud| cloud.scene.chunks().len()).sum();
        view.reserve_chunks(device, &self.view_layout, n_chunks);
        let mut first_record = 0;
        for cloud in clouds {
            let of_cloud = cloud_uniforms(camera, cloud, settings);
            let (from, to, _) = cloud.colors.ends();
            let colors = [from, to].map(|colors| colors.map_or(0, GaussianColors::version));
            for chunk in cloud.scene.chunks() {
                let uniforms = SplatChunk {
                    n_gaussians: chunk.n_gaussians,
                    first_gaussian: chunk.first,
                    first_record,
                    ..of_cloud
                };
                let key = self.bindings(chunk, cloud);
                view.push_chunk(&uniforms, key, colors, |key| self.bind(device, key));
                first_record += chunk.n_gaussians;
            }
        }
        view.write_chunks(queue)
    }

    /// Dispatches every chunk that was written.
    pub fn encode(&self, pass: &mut wgpu::ComputePass, view: &SplatView) {
        pass.set_pipeline(&self.pipeline);
        for (of_view, ChunkDispatch { offset, n_gaussians, bind_group }) in view.chunk_dispatches() {
            let n = n_gaussians.div_ceil(WORKGROUP);
            // Workgroups beyond the limit go into a second dimension.
            let x = n.min(MAX_WORKGROUPS);
            pass.set_bind_group(0, of_view, &[offset]);
            pass.set_bind_group(1, bind_group, &[]);
            pass.dispatch_workgroups(x, n.div_ceil(x.max(1)), 1);
        }
    }

    /// The buffers that a chunk is projected from.
    fn bindings(&self, chunk: &Chunk, cloud: &Cloud) -> ChunkBindings {
        let (from, to, _) = cloud.colors.ends();
        let or_absent = |buffer: Option<&wgpu::Buffer>| buffer.unwrap_or(&self.absent).clone();
        ChunkBindings([
            chunk.gaussians.clone(),
            or_absent(chunk.sh.as_ref()),
            or_absent(from.map(|colors| colors.buffer())),
            or_absent(to.map(|colors| colors.buffer())),
        ])
    }

    fn bind(&self, device: &wgpu::Device, ChunkBindings(buffers): &ChunkBindings) -> wgpu::BindGroup {
        bind_group(
            device,
            "splat_project_chunk",
            &self.chunk_layout,
            &buffers.each_ref().map(wgpu::Buffer::as_entire_binding),
        )
    }
}

/// The uniforms that the chunks of a cloud share.
fn cloud_uniforms(camera: &Camera, cloud: &Cloud, settings: &SplatSettings) -> SplatChunk {
    let [view_from_scene_x, view_from_scene_y, view_from_scene_z] =
        rows(&camera.view_from(&cloud.world_from_scene));
    let clip_row = |i| camera.clip_from_view.row(i).to_array();
    let (from, to, fade) = cloud.colors.ends();
    let flag = |set: bool, flag: u32| if set { flag } else { 0 };
    let eye = camera.eye_in(&cloud.world_from_scene);
    SplatChunk {
        view_from_scene_x,
        view_from_scene_y,
        view_from_scene_z,
        clip_from_view_x: clip_row(0),
        clip_from_view_y: clip_row(1),
        clip_from_view_z: clip_row(2),
        clip_from_view_w: clip_row(3),
        viewport: camera.viewport.as_vec4().to_array(),
        // The eye of a nearly flat cloud can overflow. Any finite direction will do for its colors then.
        eye: if eye.is_finite() { eye.to_array() } else { [0.0; 4] },
        axis: camera.axis().to_array(),
        // Parallel rays have no singularity at the camera, so the near plane alone culls.
        near: if camera.is_orthographic() { f32::MIN } else { settings.near },
        scale_unit: cloud.scene.scale_unit(),
        fade,
        sh_degree: cloud.scene.sh_degree().map_or(NO_SH, u32::from),
        flags: flag(from.is_none(), FROM_CAPTURED_COLORS)
            | flag(to.is_none(), TO_CAPTURED_COLORS)
            | flag(settings.sort_key == SortKey::Distance, BY_DISTANCE)
            | flag(cloud.scene.filter() == ScreenFilter::Antialiased, ANTIALIASED),
        ..SplatChunk::zeroed()
    }
}

fn rows(affine: &Affine3A) -> [[f32; 4]; 3] {
    let columns = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis, affine.translation];
    [0, 1, 2].map(|i| columns.map(|column| column[i]))
}

#[cfg(test)]
mod tests;
