//! The event of scenes that can be drawn.

use bevy::prelude::*;

use crate::scene::LoadedScene;

use super::layers::ColorLayers;

/// Sent once an entity's scene can be drawn: it is on the GPU, and so is everything that the cameras need to
/// draw splats. Sent again if the entity shows another scene. An app that does not render sends none.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct GaussianSceneReady {
    /// The entity.
    pub entity: Entity,
}

/// Makes the colors of entities with a new scene count as new.
pub(super) fn renew_layers(mut changed: Query<&mut ColorLayers, Changed<LoadedScene>>) {
    for mut layers in &mut changed {
        layers.renew();
    }
}

/// Sends the events.
pub(super) fn report_ready_scenes(
    mut commands: Commands,
    mut clouds: Query<(Entity, &mut ColorLayers), With<LoadedScene>>,
    mut messages: MessageWriter<GaussianSceneReady>,
) {
    for (entity, mut layers) in &mut clouds {
        if layers.is_announced || !layers.is_drawn(layers.first) {
            continue;
        }
        // Only this system reads it, and the render world must not hear of a change.
        layers.bypass_change_detection().is_announced = true;
        let event = GaussianSceneReady { entity };
        messages.write(event.clone());
        commands.trigger(event);
    }
}
