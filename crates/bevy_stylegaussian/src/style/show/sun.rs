//! The light on paint that the game has already.

use bevy::prelude::*;

/// Direction to the game's first directional light in world space, or `None` if there is none.
#[derive(Resource, Default)]
pub(crate) struct Sun(pub(crate) Option<Vec3>);

/// Looks for the light.
#[cfg(feature = "pbr")]
pub(crate) fn find_sun(
    lights: Query<(Entity, &GlobalTransform), With<DirectionalLight>>,
    mut sun: ResMut<Sun>,
) {
    let first = lights.iter().min_by_key(|(entity, _)| *entity);
    // It shines forward.
    sun.0 = first.map(|(_, transform)| transform.back().into());
}
