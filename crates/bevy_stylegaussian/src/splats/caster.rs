//! The component of clouds that cast shadows.

use bevy::prelude::*;
use stylegaussian::splat::CAST_THRESHOLD;

/// Lets a [`GaussianSplats`](crate::GaussianSplats) cast shadows: into the shadow maps of directional lights,
/// spot lights and point lights, so on meshes, and on splats with [`SplatShadows`](super::SplatShadows). A
/// component of the entity; without it, splats cast none. It needs the feature `pbr`.
///
/// A splat takes the light where its alpha is `threshold` or more, and none elsewhere. So surfaces cast
/// shadows, and haze does not. Splats that no camera sees cast shadows, too, and hidden ones do not. As with
/// meshes, a light's `RenderLayers` must have one of the entity's.
///
/// A shadow map of which neither the light nor a caster changes keeps the shadows of splats, and takes 4 bytes
/// more per texel for that. Those of a light that moves, and of a sun whose maps follow a camera that moves,
/// are drawn anew.
///
/// A cloud that receives shadows, too, also shades itself: a tree its ground, and not a surface itself, since
/// the shadow of a splat begins at its far end. That is as far behind it as `threshold` says.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::splats::SplatCaster;
/// # fn system(mut commands: Commands, garden: Entity) {
/// commands.entity(garden).insert(SplatCaster::default());
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SplatCaster {
    /// Least alpha of a splat where it casts a shadow, 1/255 to 0.99; 0.25 by default. Less closes holes in
    /// the shadows of faint splats, and makes all shadows wider.
    pub threshold: f32,
}

impl Default for SplatCaster {
    fn default() -> Self {
        Self { threshold: CAST_THRESHOLD }
    }
}
