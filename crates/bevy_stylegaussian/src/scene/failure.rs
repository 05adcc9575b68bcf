//! Failures of scenes: the event, and the way to it from the render world.

use std::sync::Arc;

use bevy::{ecs::system::SystemParam, prelude::*};

use crate::reports::Reports;

/// Sent if an entity's scene cannot be shown. The app goes on without it.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct GaussianSceneFailed {
    /// The entity.
    pub entity: Entity,
    /// The reason.
    #[reflect(ignore, default = "unknown_error")]
    pub error: Arc<GaussianSceneError>,
}

/// The error of a [`GaussianSceneFailed`] that was made by reflection: errors do not reflect.
fn unknown_error() -> Arc<GaussianSceneError> {
    Arc::new(GaussianSceneError::Gpu("unknown".into()))
}

/// A scene cannot be shown.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GaussianSceneError {
    /// The asset could not be loaded. The message names it.
    #[error("{0}")]
    Load(String),
    /// The parts of a scene made by a program do not fit together.
    #[error(transparent)]
    Scene(#[from] stylegaussian::scene::SceneError),
    /// The scene is too large for the GPU. The message has its size in bytes and the limit.
    #[error("the scene cannot be drawn on this GPU: {0}")]
    Gpu(String),
    /// No scene can be drawn, because the device's limits are below [`NEEDS`](stylegaussian_gpu::needs::NEEDS).
    /// The message has the limits that are, and what is needed. It is logged once, and not for every entity.
    #[error(transparent)]
    Device(stylegaussian_gpu::needs::TooWeak),
}

/// Report of the render world: the GPU cannot take the scene of an entity, or a view cannot draw it.
pub(crate) struct SceneRefused {
    pub(crate) entity: Entity,
    pub(crate) error: GaussianSceneError,
}

/// Sends [`GaussianSceneFailed`].
#[derive(SystemParam)]
pub(super) struct SceneFailures<'w, 's> {
    commands: Commands<'w, 's>,
    messages: MessageWriter<'w, GaussianSceneFailed>,
    names: Query<'w, 's, NameOrEntity>,
}

impl SceneFailures<'_, '_> {
    pub(super) fn send(&mut self, entity: Entity, error: GaussianSceneError) {
        // `bevy_asset` has logged a failed load already, and the render world what the device lacks.
        if !matches!(error, GaussianSceneError::Load(_) | GaussianSceneError::Device(_)) {
            match self.names.get(entity) {
                Ok(name) => error!("{name}: {error}"),
                Err(_) => error!("{entity}: {error}"),
            }
        }
        let event = GaussianSceneFailed { entity, error: Arc::new(error) };
        self.messages.write(event.clone());
        self.commands.trigger(event);
    }
}

/// Sends the failures that the render world reported.
pub(super) fn report_refused_scenes(reports: Res<Reports<SceneRefused>>, mut failures: SceneFailures) {
    for SceneRefused { entity, error } in reports.take() {
        failures.send(entity, error);
    }
}
