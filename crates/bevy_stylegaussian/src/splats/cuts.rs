//! Cuts: splats that weak GPUs leave out.

use bevy::{prelude::*, render::extract_component::ExtractComponent};
use stylegaussian_gpu::splat;

/// Splats that a camera leaves out, so that a weak GPU draws fewer. Without this component, and by default, all
/// are drawn. A component of the camera.
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
}

impl SplatCuts {
    /// The cuts as the splat pass takes them.
    pub(super) fn for_pass(self) -> splat::SplatCuts {
        let Self { least_radius, least_opacity } = self;
        splat::SplatCuts { least_radius, least_opacity }
    }
}
