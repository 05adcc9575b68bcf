//! Layers of half the width and height.

use glam::UVec2;

use super::SplatPass;
use crate::{
    device::GpuEncoder,
    splat::{
        camera::Camera,
        draw::SplatPipeline,
        edges::EdgeLayers,
        half::{Half, HalfLayer},
        layer::Layer,
        view::SplatView,
    },
};

impl SplatPass {
    /// Compiles what [`draw_half_layer`](Self::draw_half_layer) needs, in any thread, while others draw.
    /// Without this call, the first such frame compiles it.
    pub fn prepare_half(&self, device: &wgpu::Device) {
        self.half.get_or_init(|| Half::new(device));
    }

    /// The textures for layers of `size` in pixels that are drawn at half of it.
    pub fn half_layer(&self, device: &wgpu::Device, size: UVec2) -> HalfLayer {
        HalfLayer::new(device, size, self.layer_usages())
    }

    /// Draws `view` into `layer` as [`draw_layer`](Self::draw_layer) does, but at half the width and height.
    /// [`project_and_sort`](Self::project_and_sort) with `camera` and with settings of
    /// [`half_size`](crate::splat::SplatSettings::half_size) comes before. Shaders may read the layer's depth,
    /// which is there. `pipeline` is that of one sample and `Depth32Float`.
    pub fn draw_half_layer(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut SplatView,
        camera: &Camera,
        (half, color, depth): (&HalfLayer, &wgpu::TextureView, &wgpu::TextureView),
        pipeline: &SplatPipeline,
    ) {
        let sides = ([depth, depth], half);
        self.draw_low(gpu, view, camera, sides, pipeline, &[(color, depth)]);
    }

    /// Draws `view` into the layers of a target with several samples per pixel, as
    /// [`draw_edge_layers`](Self::draw_edge_layers) does, but once and at half the width and height, under the
    /// conditions of both.
    pub fn draw_half_edge_layers(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut SplatView,
        camera: &Camera,
        (half, layers, depth): (&HalfLayer, &EdgeLayers, &wgpu::TextureView),
        pipeline: &SplatPipeline,
    ) {
        self.split_depth(gpu, view, camera, (layers, depth));
        let EdgeLayers { farther, nearer, farther_depth, nearer_depth, .. } = layers;
        let sides = ([farther_depth, nearer_depth], half);
        let targets = [(farther, farther_depth), (nearer, nearer_depth)];
        self.draw_low(gpu, view, camera, sides, pipeline, &targets);
    }

    /// Draws the low layer against the depths of both sides, and makes whole layers for the depths beside them.
    fn draw_low(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut SplatView,
        camera: &Camera,
        (sides, half): ([&wgpu::TextureView; 2], &HalfLayer),
        pipeline: &SplatPipeline,
        targets: &[(&wgpu::TextureView, &wgpu::TextureView)],
    ) {
        let Some((uniforms, viewport)) = view.half(gpu.device, gpu.queue, camera) else {
            for (color, _) in targets {
                Layer { color, depth: None }.cleared(gpu.encoder);
            }
            return;
        };
        let stage = self.half.get_or_init(|| Half::new(gpu.device));
        stage.encode_depth(gpu, (&uniforms, viewport), sides, half);
        let low = Layer { color: &half.color, depth: Some(&half.depth) };
        self.draw_layer(gpu, view, &low, pipeline);
        for &target in targets {
            stage.encode_whole(gpu, (&uniforms, viewport), half, target);
        }
    }
}
