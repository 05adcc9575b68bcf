//! Depth of splats, for views that ask for it.

use super::SplatPass;
use crate::{
    device::GpuEncoder,
    splat::{
        depth::{Depth, DepthPipeline, IsoDepth},
        view::SplatView,
    },
};

impl SplatPass {
    /// Compiles the kernels of [`find_depth`](Self::find_depth), in any thread, while others draw. Without this
    /// call, the first frame that asks for depth compiles them.
    pub fn prepare_depth(&self, device: &wgpu::Device) {
        self.depth(device).prepare(device, self.tiles.is_some(), &self.draw.layout);
    }

    /// The pipeline that writes depths into attachments of `format` at `samples` samples.
    pub fn depth_pipeline(
        &self,
        device: &wgpu::Device,
        samples: u32,
        format: wgpu::TextureFormat,
    ) -> DepthPipeline {
        self.depth(device).pipeline(device, samples, format)
    }

    /// Finds the iso depths of `view` by the fastest way of the adapter, unless `iso` has them already.
    /// [`project_and_sort`](Self::project_and_sort) comes before, and `iso` belongs to this view alone.
    ///
    /// `threshold` is the share of the light, as [`iso_threshold`](stylegaussian::splat::iso_threshold)
    /// limits it. A viewport with more pixels than the device can bind numbers has no depths, nor has one
    /// whose lists of tiles overflow.
    pub fn find_depth(&self, gpu: &mut GpuEncoder, view: &mut SplatView, threshold: f32, iso: &mut IsoDepth) {
        let by = (self.tiles.as_ref(), &self.draw.layout);
        self.depth(gpu.device).find(gpu, view, by, threshold, iso);
    }

    /// Writes the depths of `iso` into the depth attachment of `pass`, where they are nearer. `pipeline` must
    /// fit the attachment, which has the size of the camera's target. Nothing is written if there are none.
    pub fn write_depth(&self, pass: &mut wgpu::RenderPass, iso: &IsoDepth, pipeline: &DepthPipeline) {
        iso.write(pass, pipeline);
    }

    fn depth(&self, device: &wgpu::Device) -> &Depth {
        self.depth.get_or_init(|| Depth::new(device))
    }
}
