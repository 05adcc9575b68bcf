//! The project stage on the GPU: `splat_project`.

use std::{f32::consts::TAU, sync::OnceLock};

use bytemuck::Zeroable;
use glam::{Affine3A, DVec3};
use stylegaussian::{mask::MaskUse, scene::ScreenFilter};
use stylegaussian_shaders::splat::{
    self as shaders, ANTIALIASED, BY_DISTANCE, CAPTURED_COLORS, CROPPED, HALF_SIZE, NO_SH, SplatChunk,
};

use super::{
    camera::Camera,
    cloud::Cloud,
    dispatch::dispatch,
    eyes::{EyeStage, eye_between},
    scene::Chunk,
    settings::{SortKey, SplatCuts, SplatSettings},
    strokes::{StrokeStage, draw_uniforms, with_knobs},
    view::{Change, ChunkBindings, ChunkDispatch, ChunkGroups, ChunkVersions, SplatView},
};
use crate::{
    bindings::{
        bind_group, compute_pipeline, group_layout, pipeline_layout, storage_binding, uniforms_binding,
    },
    buffers,
    colors::GaussianColors,
    strokes::StrokeStore,
};

/// The pipelines and the layouts of their bindings.
#[derive(Debug)]
pub(super) struct Project {
    /// Group 0: the chunk's uniforms, keys, and both halves of the records.
    pub(super) view_layout: wgpu::BindGroupLayout,
    /// Clouds without a mask.
    pub(super) plain: Variant,
    /// Clouds with one; compiled when it is asked for, or when the first is drawn.
    masked: OnceLock<Variant>,
    /// Bound if a scene has no spherical harmonics, or if its captured colors are shown.
    pub(super) absent: wgpu::Buffer,
    /// The kernel that follows for clouds with strokes.
    pub(super) strokes: StrokeStage,
    /// The kernel for two eyes.
    pub(super) eyes: EyeStage,
}

/// The kernel with or without a mask.
#[derive(Debug)]
pub(super) struct Variant {
    pipeline: wgpu::ComputePipeline,
    /// Group 1: Gaussians, spherical harmonics, colors, and the mask if there is one.
    pub(super) chunk_layout: wgpu::BindGroupLayout,
}

impl Variant {
    fn new(device: &wgpu::Device, view_layout: &wgpu::BindGroupLayout, masked: bool) -> Self {
        let label = "splat_project";
        let bindings = [storage_binding(true); 4];
        let bindings = if masked { &bindings[..] } else { &bindings[..3] };
        let chunk_layout = group_layout(device, label, wgpu::ShaderStages::COMPUTE, bindings);
        let layout = pipeline_layout(device, label, &[view_layout, &chunk_layout]);
        let options = wgpu::PipelineCompilationOptions::default();
        let pipeline = compute_pipeline(device, shaders::project(masked), &layout, options);
        Self { pipeline, chunk_layout }
    }
}

impl Project {
    /// `store` has the textures of strokes.
    pub fn new(device: &wgpu::Device, store: StrokeStore) -> Self {
        let (label, compute) = ("splat_project", wgpu::ShaderStages::COMPUTE);
        let write = storage_binding(false);
        let view_layout =
            group_layout(device, label, compute, &[uniforms_binding::<SplatChunk>(), write, write, write]);
        let absent = buffers::create(device, "splat_absent", 16, wgpu::BufferUsages::STORAGE);
        let plain = Variant::new(device, &view_layout, false);
        let (strokes, eyes) = (StrokeStage::new(store), EyeStage::default());
        Self { view_layout, plain, masked: OnceLock::new(), absent, strokes, eyes }
    }

    /// The kernel for clouds with a mask, which is compiled unless it is there.
    pub(super) fn masked(&self, device: &wgpu::Device) -> &Variant {
        self.masked.get_or_init(|| Variant::new(device, &self.view_layout, true))
    }

    /// Uploads the uniforms of every chunk of `clouds`, and makes bindings for chunks that have none. Returns
    /// the difference from the frame that made the records. If `middle` is given, colors are seen from that
    /// place in the world, and not from the camera's.
    pub fn write(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        view: &mut SplatView,
        (camera, middle): (&Camera, Option<DVec3>),
        clouds: &[&Cloud],
        settings: &SplatSettings,
    ) -> Change {
        let n_chunks = clouds.iter().map(|cloud| cloud.scene.chunks().len()).sum();
        view.reserve_chunks(device, &self.view_layout, n_chunks);
        let mut first_record = 0;
        let painted = clouds.iter().filter_map(|cloud| cloud.colors.painted());
        let draw = draw_uniforms(painted);
        for (i, cloud) in clouds.iter().enumerate() {
            let painted = cloud.colors.painted();
            let of_cloud = cloud_uniforms((camera, middle), cloud, settings);
            let of_cloud = SplatChunk { flags: view.with_fade(i, of_cloud.flags), ..of_cloud };
            let versions = ChunkVersions {
                colors: cloud.colors.own().map_or(0, GaussianColors::version),
                mask: cloud.mask().map_or(0, |visibility| visibility.mask.version()),
                strokes: painted.map_or(0, |painted| painted.strokes.version()),
            };
            for chunk in cloud.scene.chunks() {
                let uniforms = SplatChunk {
                    n_gaussians: chunk.n_gaussians,
                    first_gaussian: chunk.first,
                    first_record,
                    ..of_cloud
                };
                let key = self.bindings(chunk, cloud);
                let uniforms = with_knobs(uniforms, painted.as_ref(), draw.as_ref());
                view.push_chunk(&uniforms, key, versions, |key| self.bind(device, key));
                first_record += chunk.n_gaussians;
            }
        }
        view.update_strokes(device, queue, &self.strokes, draw);
        view.write_chunks(queue)
    }

    /// Dispatches every chunk that was written.
    pub fn encode(&self, pass: &mut wgpu::ComputePass, view: &SplatView) {
        let mut was_masked = None;
        for (of_view, ChunkDispatch { offset, n_gaussians, bind_group, is_masked }) in view.chunk_dispatches()
        {
            if was_masked != Some(is_masked) {
                // Bindings with a mask were made with the variant for masks.
                let variant = self.masked.get().filter(|_| is_masked).unwrap_or(&self.plain);
                pass.set_pipeline(&variant.pipeline);
                was_masked = Some(is_masked);
            }
            pass.set_bind_group(0, of_view, &[offset]);
            pass.set_bind_group(1, bind_group, &[]);
            dispatch(pass, n_gaussians);
        }
    }

    /// Dispatches the strokes of every chunk that has any, after [`encode`](Self::encode).
    pub fn encode_strokes(&self, device: &wgpu::Device, pass: &mut wgpu::ComputePass, view: &SplatView) {
        let mut dispatches = view.stroke_dispatches().peekable();
        if dispatches.peek().is_none() {
            return;
        }
        pass.set_pipeline(&self.strokes.kernel(device).pipeline);
        for (of_view, ChunkDispatch { offset, n_gaussians, bind_group, .. }) in dispatches {
            pass.set_bind_group(0, of_view, &[offset]);
            pass.set_bind_group(1, bind_group, &[]);
            dispatch(pass, n_gaussians);
        }
    }

    /// The buffers that a chunk is projected from.
    fn bindings(&self, chunk: &Chunk, cloud: &Cloud) -> ChunkBindings {
        let or_absent = |buffer: Option<&wgpu::Buffer>| buffer.unwrap_or(&self.absent).clone();
        let buffers = [
            chunk.gaussians.clone(),
            or_absent(chunk.sh.as_ref()),
            or_absent(cloud.colors.own().map(GaussianColors::buffer)),
        ];
        ChunkBindings {
            buffers,
            mask: cloud.mask().map(|visibility| visibility.mask.buffer.clone()),
            strokes: cloud.colors.painted().map(|painted| {
                let strokes = painted.strokes;
                [strokes.words().clone(), strokes.seeds().clone()]
            }),
        }
    }

    fn bind(&self, device: &wgpu::Device, bindings: &ChunkBindings) -> ChunkGroups {
        let ChunkBindings { buffers, mask, strokes } = bindings;
        let variant = match mask {
            None => &self.plain,
            Some(_) => self.masked(device),
        };
        let resources: Vec<_> = buffers.iter().chain(mask).map(wgpu::Buffer::as_entire_binding).collect();
        let project = bind_group(device, "splat_project_chunk", &variant.chunk_layout, &resources);
        let strokes = strokes.as_ref().map(|[words, seeds]| {
            self.strokes.kernel(device).bind_chunk(device, [&buffers[0], words, seeds])
        });
        ChunkGroups { project, strokes }
    }
}

/// The uniforms that the chunks of a cloud share.
pub(super) fn cloud_uniforms(
    (camera, middle): (&Camera, Option<DVec3>),
    cloud: &Cloud,
    settings: &SplatSettings,
) -> SplatChunk {
    let [view_from_scene_x, view_from_scene_y, view_from_scene_z] =
        rows(&camera.view_from(&cloud.world_from_scene));
    let SplatCuts { least_radius, least_opacity, least_at_edge } = settings.cuts;
    // Pixels of the whole picture in one that is drawn.
    let pixels = if settings.half_size { 4.0 } else { 1.0 };
    let clip_row = |i| camera.clip_from_view.row(i).to_array();
    let flag = |set: bool, flag: u32| if set { flag } else { 0 };
    let place = &cloud.world_from_scene;
    let eye = match middle {
        Some(middle) => eye_between(middle, place),
        None => camera.eye_in(place),
    };
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
        sh_degree: cloud.scene.sh_degree().map_or(NO_SH, u32::from),
        flags: flag(cloud.colors.own().is_none(), CAPTURED_COLORS)
            | flag(settings.sort_key == SortKey::Distance, BY_DISTANCE)
            | flag(cloud.scene.filter() == ScreenFilter::Antialiased, ANTIALIASED)
            | flag(settings.half_size, HALF_SIZE)
            | flag(cloud.mask().is_some_and(|visibility| visibility.is == MaskUse::Crop), CROPPED),
        mask_shift: cloud.mask().map_or(0, |visibility| 8 * visibility.channel as u32),
        least_variance: finite(least_radius.max(0.0).powi(2) / pixels),
        least_opacity: finite(least_opacity),
        least_at_edge: finite(least_at_edge.max(0.0) / (TAU * pixels)),
        ..SplatChunk::zeroed()
    }
}

/// A bound, 0 if it is none.
fn finite(bound: f32) -> f32 {
    if bound.is_finite() { bound } else { 0.0 }
}

fn rows(affine: &Affine3A) -> [[f32; 4]; 3] {
    let columns = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis, affine.translation];
    [0, 1, 2].map(|i| columns.map(|column| column[i]))
}

#[cfg(test)]
mod tests;
