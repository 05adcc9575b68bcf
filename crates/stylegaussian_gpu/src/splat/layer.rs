//! The layer: the texture in which splats blend among themselves.

use crate::drawing::cleared_color;

/// The format of a layer. Stylized colors are not clamped, and 8 bits would round each of the thousands of
/// blends.
pub const LAYER_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// The textures that splats are drawn into.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// The layer itself, in [`LAYER_FORMAT`].
    pub color: &'a wgpu::TextureView,
    /// Depths of the objects that are drawn already, reverse z; only read.
    pub depth: Option<&'a wgpu::TextureView>,
}

impl Layer<'_> {
    /// Whether compute can draw into the layer: single samples, and a depth texture that shaders may read.
    pub(super) fn takes_tiles(&self) -> bool {
        let color = self.color.texture();
        let is_readable = |depth: &wgpu::TextureView| {
            depth.texture().usage().contains(wgpu::TextureUsages::TEXTURE_BINDING)
        };
        color.sample_count() == 1
            && color.usage().contains(wgpu::TextureUsages::STORAGE_BINDING)
            && self.depth.is_none_or(is_readable)
    }

    /// A pass over the cleared layer.
    pub(super) fn cleared<'a>(&self, encoder: &'a mut wgpu::CommandEncoder) -> wgpu::RenderPass<'a> {
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("splat_draw"),
            color_attachments: &[cleared_color(self.color)],
            // An attachment without operations is read only, so that later passes may still sample it.
            depth_stencil_attachment: self.depth.map(|view| wgpu::RenderPassDepthStencilAttachment {
                view,
                depth_ops: None,
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}
