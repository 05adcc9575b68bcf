//! Fits masks to the scenes of their entities.

use std::sync::Arc;

use bevy::{asset::LoadState, ecs::system::SystemParam, prelude::*};
use stylegaussian::{Mask, Scene, mask::MaskError};

use crate::scene::LoadedScene;

use super::{SavedMask, StyleMask, component::Painted};

/// Sent if a saved mask cannot be used. The entity's mask is unpainted then.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct StyleMaskFailed {
    /// The entity.
    pub entity: Entity,
    /// The reason.
    #[reflect(ignore, default = "unknown_error")]
    pub error: Arc<StyleMaskError>,
}

/// The error of a [`StyleMaskFailed`] that was made by reflection: errors do not reflect.
fn unknown_error() -> Arc<StyleMaskError> {
    Arc::new(StyleMaskError::Load("unknown".into()))
}

/// A saved mask cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StyleMaskError {
    /// The asset could not be loaded. The message names it.
    #[error("{0}")]
    Load(String),
    /// It belongs to another scene.
    #[error("{path}: {error}")]
    Scene {
        /// The asset's path.
        path: String,
        /// The scene that it belongs to, and that of the entity.
        error: MaskError,
    },
}

/// Sends [`StyleMaskFailed`].
#[derive(SystemParam)]
pub(super) struct MaskFailures<'w, 's> {
    commands: Commands<'w, 's>,
    messages: MessageWriter<'w, StyleMaskFailed>,
    names: Query<'w, 's, NameOrEntity>,
}

impl MaskFailures<'_, '_> {
    fn send(&mut self, entity: Entity, error: StyleMaskError) {
        // `bevy_asset` has logged a failed load already.
        if !matches!(error, StyleMaskError::Load(_)) {
            match self.names.get(entity) {
                Ok(name) => error!("{name}: {error}"),
                Err(_) => error!("{entity}: {error}"),
            }
        }
        let event = StyleMaskFailed { entity, error: Arc::new(error) };
        self.messages.write(event.clone());
        self.commands.trigger(event);
    }
}

/// Makes masks ready whose scene and file are there, and begins them anew if the entity shows other Gaussians.
pub(super) fn fit_masks(
    mut masks: Query<(Entity, &mut StyleMask, &LoadedScene)>,
    saved: Res<Assets<SavedMask>>,
    server: Res<AssetServer>,
    mut failures: MaskFailures,
) {
    for (entity, mut mask, loaded) in &mut masks {
        let scene = loaded.scene();
        if mask.painted.as_ref().is_some_and(|painted| Arc::ptr_eq(&painted.scene, scene)) {
            continue;
        }
        // An asset that changed without moving a Gaussian keeps what is painted, and the steps to undo.
        let is_same = mask.painted.as_ref().is_some_and(|painted| painted.scene.means == scene.means);
        if let Some(painted) = mask.painted.as_mut().filter(|_| is_same) {
            painted.scene = Arc::clone(scene);
            continue;
        }
        let Some(first) = first_mask(mask.saved.as_ref(), scene, &saved, &server) else { continue };
        let first = first.unwrap_or_else(|error| {
            failures.send(entity, error);
            Mask::new(scene.len())
        });
        mask.painted = Some(Painted::new(Arc::clone(scene), first));
    }
}

/// The mask that an entity of `scene` begins with, or `None` if its file is still loading.
fn first_mask(
    handle: Option<&Handle<SavedMask>>,
    scene: &Scene,
    saved: &Assets<SavedMask>,
    server: &AssetServer,
) -> Option<Result<Mask, StyleMaskError>> {
    let Some(handle) = handle else {
        return Some(Ok(scene.mask.clone().unwrap_or_else(|| Mask::new(scene.len()))));
    };
    let Some(SavedMask(stored)) = saved.get(handle) else {
        return match server.get_load_state(handle) {
            Some(LoadState::Failed(error)) => Some(Err(StyleMaskError::Load(error.to_string()))),
            _ => None,
        };
    };
    let named = |error| StyleMaskError::Scene {
        path: handle.path().map_or_else(|| "a mask made by the program".into(), ToString::to_string),
        error,
    };
    Some(stored.mask_for(scene).map_err(named))
}
