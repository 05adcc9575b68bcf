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
}

impl Default for SplatSettings {
    /// Sorted by view depth, drawn from 0.2 on: the original rasterizer's rules.
    fn default() -> Self {
        Self { sort_key: SortKey::ViewZ, near: stylegaussian::Camera::NEAR }
    }
}
