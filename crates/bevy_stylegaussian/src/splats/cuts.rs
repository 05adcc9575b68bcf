//! Cuts: what weak GPUs leave out.

use bevy::{prelude::*, render::extract_component::ExtractComponent};
use stylegaussian_gpu::splat;

/// Splats that a camera leaves out, so that a weak GPU draws less. Without this component, and by default, all
/// splats are drawn at the target's size. A component of the camera.
#[derive(Component, ExtractComponent, Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[extract_component_filter(With<Camera3d>)]
#[require(Camera3d)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SplatCuts {
    /// Splats of a smaller radius are left out, in pixels of the target: the root of the variances along and
    /// across the footprint. Far parts lose detail first. On the demo scene at 320x240 pixels, 0.5 leaves 79 dB
    /// to the whole picture, and 1 leaves 43 dB.
    pub least_radius: f32,
    /// Splats of less opacity are left out, 0..1. Haze and soft edges go first. Splats under 1/255 are never
    /// drawn.
    pub least_opacity: f32,
    /// Splats that add less to the picture are left out at the edge of view, in pixels of the target: opacity
    /// times the area of the footprint. For headsets, whose lenses blur the edge. The bound is 0 on the image
    /// axis, also of an off-axis projection, and grows with the square of the distance from it; this is its
    /// value half a picture away. On the demo scene at 320x240 pixels, 4 leaves 58 dB to the whole picture, and
    /// 8 leaves 36 dB.
    pub least_at_edge: f32,
    /// Whether splats are drawn at half the width and height of the target: at a quarter of its pixels, and
    /// once with MSAA, too. They become as soft as pixels of twice the size are, and keep their light; strokes
    /// lose what is finer. Meshes keep their edges, before splats and behind them: each pixel takes the splats
    /// of the surface that it shows. It takes 3 bytes more per pixel of the target, and one more pass over it,
    /// which is little beside splats that overlap many times. Depth of [`SplatDepth`](super::SplatDepth) has
    /// steps of two pixels. Of two [eyes](super::SplatEyes), both have it, or each is drawn by itself.
    pub half_size: bool,
}

impl SplatCuts {
    /// The cuts as the splat pass takes them.
    pub(super) fn for_pass(self) -> splat::SplatCuts {
        let Self { least_radius, least_opacity, least_at_edge, half_size: _ } = self;
        splat::SplatCuts { least_radius, least_opacity, least_at_edge }
    }
}
