//! Settings of the splat pass.

use std::borrow::Cow;

use glam::UVec4;

use super::camera::Camera;

/// The key that splats are sorted by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SortKey {
    /// Depth along the camera's axis, as in the original rasterizer.
    #[default]
    ViewZ,
    /// Distance from the camera. It does not change when the camera turns.
    Distance,
}

/// Settings of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatSettings {
    /// The key that splats are sorted by.
    pub sort_key: SortKey,
    /// Perspective cameras do not draw Gaussians with a mean at this view depth or nearer, in world units.
    pub near: f32,
    /// Splats that are left out.
    pub cuts: SplatCuts,
    /// Whether splats are drawn at half the width and height:
    /// [`draw_half_layer`](super::SplatPass::draw_half_layer). Their footprints are widened as much as a pixel
    /// of twice the size asks for, and keep the sums that they have in the whole picture.
    pub half_size: bool,
}

impl SplatSettings {
    /// The camera that splats are projected with, for a picture of `camera`.
    pub(super) fn camera<'a>(&self, camera: &'a Camera) -> Cow<'a, Camera> {
        if self.half_size { Cow::Owned(camera.halved()) } else { Cow::Borrowed(camera) }
    }

    /// The viewport of the whole picture, if splats are drawn at half its width and height.
    pub(super) fn whole(&self, camera: &Camera) -> Option<UVec4> {
        self.half_size.then_some(camera.viewport)
    }
}

/// Splats that weak GPUs leave out. By default, none are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatCuts {
    /// Splats of a smaller radius are left out, in pixels of the whole picture: the root of the sum of the
    /// variances along x and y, before the low-pass.
    pub least_radius: f32,
    /// Splats of less opacity are left out, 0..1. Those under 1/255 always are.
    pub least_opacity: f32,
    /// Splats that add less to the picture are left out at the edge of view, in pixels of the whole picture:
    /// opacity times the area `2 pi sqrt(det)` of the footprint with its covariance's determinant, which is the
    /// sum of the splat's alphas. The bound is 0 on the image axis and grows with the square of the distance
    /// from it; this is its value half a picture away.
    pub least_at_edge: f32,
}

impl Default for SplatSettings {
    /// Sorted by view depth, drawn from 0.2 on: the original rasterizer's rules.
    fn default() -> Self {
        let near = stylegaussian::Camera::NEAR;
        Self { sort_key: SortKey::ViewZ, near, cuts: SplatCuts::default(), half_size: false }
    }
}
