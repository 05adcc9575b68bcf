//! Tints of entities, and of parts of them.

use bevy::{ecs::entity::EntityHashMap, prelude::*};
use stylegaussian::light::{Tint, TintVolume};

/// Changes the colors of a [`GaussianSplats`](crate::GaussianSplats) in the same frame: darker at night, redder
/// in the evening, gray where life has gone. A component of the entity, beside any style.
///
/// It works on linear light, before the exposure and the tone mapping of the camera: first the saturation, then
/// the color, then the exposure. So it changes splats as another lamp changes an unlit mesh. Numbers that are
/// not finite change nothing. Strokes lose or gain contrast with the colors below them.
///
/// [`StyleVolume::with_tint`](crate::StyleVolume::with_tint) does the same in a part of space.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::SplatTint;
/// # fn system(mut commands: Commands, garden: Entity) {
/// let dusk = SplatTint { color: Color::srgb(1.0, 0.7, 0.5), exposure: -1.5, ..default() };
/// commands.entity(garden).insert(dusk);
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SplatTint {
    /// Factors of red, green and blue, as a linear color. White, the default, changes nothing; alpha is not
    /// used.
    pub color: Color,
    /// Brightening in stops: 1 doubles the light, -1 halves it.
    pub exposure: f32,
    /// Distance from gray: 0 is gray, 1, the default, as it is, 2 twice as colorful.
    pub saturation: f32,
}

impl Default for SplatTint {
    fn default() -> Self {
        Self { color: Color::WHITE, exposure: 0.0, saturation: 1.0 }
    }
}

impl From<SplatTint> for Tint {
    fn from(tint: SplatTint) -> Self {
        let color = tint.color.to_linear().to_vec3();
        Self { color, exposure: tint.exposure, saturation: tint.saturation }
    }
}

/// The volumes that tint each entity in part, those that touch it, of points in the world. Found in each frame.
#[derive(Resource, Default)]
pub(crate) struct TintedParts(pub(crate) EntityHashMap<Vec<TintVolume>>);
