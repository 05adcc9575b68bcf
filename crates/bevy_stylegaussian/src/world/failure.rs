//! Failures of files of worlds.

use bevy::{ecs::system::SystemParam, platform::collections::HashSet, prelude::*};

use super::component::GaussianWorldFailed;

/// Sends [`GaussianWorldFailed`].
#[derive(SystemParam)]
pub(super) struct WorldFailures<'w, 's> {
    commands: Commands<'w, 's>,
    messages: MessageWriter<'w, GaussianWorldFailed>,
}

impl WorldFailures<'_, '_> {
    /// Tells that a file of a world cannot be shown, unless that was `told`.
    pub(super) fn send(&mut self, entity: Entity, told: &mut HashSet<String>, file: String, error: String) {
        if !told.insert(file.clone()) {
            return;
        }
        let error = if error.contains(&file) { error } else { format!("{file}: {error}") };
        warn!("a part of a world is shown at another level, as captured, or not at all: {error}");
        let event = GaussianWorldFailed { entity, file, error };
        self.messages.write(event.clone());
        self.commands.trigger(event);
    }
}
