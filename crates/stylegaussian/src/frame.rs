//! The ball that chosen cameras frame.

use glam::Vec3;

/// A ball that chosen cameras frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Its center, in scene units.
    pub center: Vec3,
    /// Its radius, in scene units; above 0.
    pub radius: f32,
}

impl Frame {
    /// The corners of the cube in it.
    pub(crate) fn corners(self) -> [Vec3; 2] {
        let half_size = Vec3::splat(self.radius / 3.0_f32.sqrt());
        [self.center - half_size, self.center + half_size]
    }
}
