//! Layers of half the width and height.

use glam::UVec2;

use super::SplatPass;
use crate::splat::{
    camera::Camera,
    draw::SplatPipeline,
    edges::EdgeLayers,
    half::{Half, HalfLayer},
    layer::Layer,
    view::SplatView,
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
    #[expect(clippy::too_many_arguments, reason = "three of them are wgpu's own at every call")]
    pub fn draw_half_layer(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        view: &mut SplatView,
        camera: &Camera,
        (half, color, depth): (&HalfLayer, &wgpu::TextureView, &wgpu::TextureView),
        pipeline: &SplatPipeline,
    ) {
        let sides = ([depth, depth], half);
        self.draw_low(device, queue, encoder, view, camera, sides, pipeline, &[(color, depth)]);
    }

    /// Draws `view` into the layers of a target with several samples per pixel, as
    /// [`draw_edge_layers`](Self::draw_edge_layers) does, but once and at half the width and height, under the
    /// conditions of both.
    #[expect(clippy::too_many_arguments, reason = "three of them are wgpu's own at every call")]
    pub fn draw_half_edge_layers(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        view: &mut SplatView,
        camera: &Camera,
        (half, layers, depth): (&HalfLayer, &EdgeLayers, &wgpu::TextureView),
        pipeline: &SplatPipeline,
    ) {
        self.split_depth(device, queue, encoder, view, camera, (layers, depth));
        let EdgeLayers { farther, nearer, farther_depth, nearer_depth, .. } = layers;
        let sides = ([farther_depth, nearer_depth], half);
        let targets = [(farther, farther_depth), (nearer, nearer_depth)];
        self.draw_low(device, queue, encoder, view, camera, sides, pipeline, &targets);
    }

    /// Draws the low layer against the depths of both sides, and makes whole layers for the depths beside them.
    #[expect(clippy::too_many_arguments, reason = "three of them are wgpu's own at every call")]
    fn draw_low(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        view: &mut SplatView,
        camera: &Camera,
        (sides, half): ([&wgpu::TextureView; 2], &HalfLayer),
        pipeline: &SplatPipeline,
        targets: &[(&wgpu::TextureView, &wgpu::TextureView)],
    ) {
        let Some((uniforms, viewport)) = view.half(device, queue, camera) else {
            for (color, _) in targets {
                Layer { color, depth: None }.cleared(encoder);
            }
            return;
        };
        let stage = self.half.get_or_init(|| Half::new(device));
        stage.encode_depth(device, encoder, (&uniforms, viewport), sides, half);
        let low = Layer { color: &half.color, depth: Some(&half.depth) };
        self.draw_layer(device, queue, encoder, view, &low, pipeline);
        for &target in targets {
            stage.encode_whole(device, encoder, (&uniforms, viewport), half, target);
        }
    }
}
