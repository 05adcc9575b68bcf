//! Components of cameras that see splats.

use bevy::{prelude::*, render::extract_component::ExtractComponent};

/// Compositing of splats by an HDR camera with tonemapping. Splat colors are display-referred, so tonemapping
/// them again would change them. A component of the camera; cameras without `Hdr` or without `Tonemapping`
/// ignore it.
#[derive(Component, ExtractComponent, Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[extract_component_filter(With<Camera3d>)]
#[require(Camera3d)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub enum SplatTonemapping {
    /// Applies the inverse of the camera's tonemapping before it, so that it restores the splats' colors.
    /// Bloom, transparent meshes and other effects see the splats. Very bright and saturated colors come out
    /// slightly duller if they lie outside the range of the tonemapping. White becomes 8 times the scene's 1 at
    /// most, so that styled whites do not glow under bloom like lamps; under curves that never reach 1 it is
    /// shown as 242 of 255.
    #[default]
    Invert,
    /// Draws the splats after tonemapping. Colors are exact, but transparent meshes in front of splats do not
    /// cover them, and effects after tonemapping, such as FXAA, may not see the splats.
    Bypass,
}

/// The order in which splats blend. A component of the camera.
#[derive(Component, ExtractComponent, Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[extract_component_filter(With<Camera3d>)]
#[require(Camera3d)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum SplatSortKey {
    /// Depth along the camera's axis, as in training.
    #[default]
    ViewZ,
    /// Distance from the camera, which does not change if the camera turns. Use it for scenes that were
    /// trained with it (glTF's `KHR_gaussian_splatting`). Two eyes have [`SplatEyes`](super::SplatEyes).
    Distance,
}
