//! State of a view that is drawn at half its width and height.

use glam::UVec4;
use stylegaussian_shaders::splat::half::SplatHalf;

use super::SplatView;
use crate::{
    buffers::Uniforms,
    splat::{camera::Camera, half::half_of},
};

/// The state of a view that is drawn at half its width and height, or may be.
#[derive(Debug, Default)]
pub(super) struct HalfState {
    /// The viewport of the whole picture, if splats are drawn at half its width and height.
    whole: Option<UVec4>,
    /// Uniforms, once such a layer was drawn.
    uniforms: Option<Uniforms<SplatHalf>>,
}

impl SplatView {
    /// Tells of which whole viewport this frame is drawn at half the width and height, if it is.
    pub(in crate::splat) fn set_half_of(&mut self, whole: Option<UVec4>) {
        self.half.whole = whole;
    }

    /// The viewport of the whole picture, if this frame is drawn at half its width and height.
    pub(in crate::splat) fn half_of(&self) -> Option<UVec4> {
        self.half.whole
    }

    /// The uniforms for `camera`, that of the whole picture, and its viewport; `None` if there is nothing to
    /// draw, or not at half the width and height.
    pub(in crate::splat) fn half(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        camera: &Camera,
    ) -> Option<(wgpu::Buffer, UVec4)> {
        let whole = self.half.whole.filter(|_| self.viewport.is_some())?;
        let uniforms = self.half.uniforms.get_or_insert_with(|| Uniforms::new(device, "splat_half"));
        uniforms.write(queue, half_of(camera));
        Some((uniforms.buffer.clone(), whole))
    }
}
