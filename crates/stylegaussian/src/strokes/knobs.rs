//! Settings of strokes as they are drawn.

use glam::Vec3;

/// Settings that may be changed without computing strokes anew. The kernel takes the same numbers as uniforms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeKnobs {
    /// Factor of all gains, at least 0.
    pub amount: f32,
    /// Factor of protection: above 1, more of the scene stays clear; below, more of it is painted. At least 0.
    pub protection: f32,
    /// Factor of the size of strokes, above 0.
    pub stroke_scale: f32,
    /// Share of finer strokes that are added where a painting is magnified, 0..1. Each octave has it of the one
    /// before.
    pub near: f32,
    /// Factor of the thickness of paint, which [`light`](Self::light) falls on. At 0 there is no relief.
    pub relief: f32,
    /// Direction to the light, in scene space, of any length but 0.
    pub light: Vec3,
    /// Whether strokes keep their size on screen, whatever the distance: octaves of the painting are
    /// crossfaded. They dissolve into one another while the camera moves.
    pub screen_stable: bool,
}

impl StrokeKnobs {
    /// Strokes as they were computed, without relief, and half of finer ones from near: more of them draw
    /// beads, and fewer blur.
    pub const DEFAULT: Self = Self {
        amount: 1.0,
        protection: 1.0,
        stroke_scale: 1.0,
        near: 0.5,
        relief: 0.0,
        light: Vec3::ZERO,
        screen_stable: false,
    };
}

impl Default for StrokeKnobs {
    fn default() -> Self {
        Self::DEFAULT
    }
}
