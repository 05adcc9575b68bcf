//! The event of scenes that can be drawn.

use bevy::{prelude::*, render::renderer::RenderAdapterInfo, window::RequestRedraw};

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

/// Asks for another frame until all entities show the colors that they should have, while strokes move, and
/// after an event, for the systems that hear of it. Otherwise an app that draws on demand would draw no more
/// before its next input.
pub(super) fn ask_for_frames(
    clouds: Query<(&LoadedScene, &ColorLayers)>,
    game: Res<Time<Virtual>>,
    // Bevy puts a copy into the main world. It is absent if the app does not render.
    renderer: Option<Res<RenderAdapterInfo>>,
    mut ready: MessageReader<GaussianSceneReady>,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    let is_waiting = |(scene, layers): (&LoadedScene, &ColorLayers)| {
        // One that is not on the GPU yet asks by itself.
        let may_be_drawn = scene.asset.is_on_gpu() && !scene.asset.is_refused();
        let is_moving = layers.are_moving() && !game.is_paused();
        may_be_drawn && (is_moving || !layers.is_drawn(layers.generation))
    };
    let n_ready = ready.read().count();
    if n_ready > 0 || (renderer.is_some() && clouds.iter().any(is_waiting)) {
        redraw.write(RequestRedraw);
    }
}
