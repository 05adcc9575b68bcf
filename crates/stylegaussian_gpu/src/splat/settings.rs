//! Settings of the splat pass.

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
}

/// Splats that weak GPUs leave out. By default, none are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatCuts {
    /// Splats of a smaller radius are left out, in pixels: the root of the sum of the variances along x and y,
    /// before the low-pass.
    pub least_radius: f32,
    /// Splats of less opacity are left out, 0..1. Those under 1/255 always are.
    pub least_opacity: f32,
}

impl Default for SplatSettings {
    /// Sorted by view depth, drawn from 0.2 on: the original rasterizer's rules.
    fn default() -> Self {
        Self { sort_key: SortKey::ViewZ, near: stylegaussian::Camera::NEAR, cuts: SplatCuts::default() }
    }
}
