//! Fits masks to the scenes of their entities.

use std::sync::Arc;

use bevy::{
    asset::LoadState,
    ecs::{
        entity::{EntityHash, EntityHashMap},
        system::SystemParam,
    },
    platform::collections::hash_map::Entry,
    prelude::*,
    window::RequestRedraw,
};
use stylegaussian::{Mask, Scene, StoredMask, mask::MaskError};

use crate::{
    scene::LoadedScene,
    work::{Lane, Running, Workers},
};

use super::{
    asset::SavedMask,
    component::{Painted, StyleMask},
    weights::Weights,
};

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
#[non_exhaustive]
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

/// A saved mask that is being brought into the order of a scene, which takes longer than a frame if that is
/// large.
pub(super) struct Fitting {
    scene: Arc<Scene>,
    saved: Arc<StoredMask>,
    mask: Running<Result<Mask, MaskError>>,
}

impl Fitting {
    fn start(scene: &Arc<Scene>, saved: &Arc<StoredMask>, workers: &Workers) -> Self {
        let (scene, saved) = (Arc::clone(scene), Arc::clone(saved));
        let of = (Arc::clone(&scene), Arc::clone(&saved));
        let mask = workers.start(Lane::Scenes, move |work| of.1.mask_for_if_wanted(&of.0, work));
        Self { mask, scene, saved }
    }

    fn is_of(&self, scene: &Arc<Scene>, saved: &Arc<StoredMask>) -> bool {
        Arc::ptr_eq(&self.scene, scene) && Arc::ptr_eq(&self.saved, saved)
    }
}

/// Makes masks ready whose scene and file are there, and begins them anew if the entity shows other Gaussians.
/// Asks for another frame while any of them is on its way.
pub(super) fn fit_masks(
    mut masks: Query<(Entity, &mut StyleMask, &LoadedScene)>,
    saved: Res<Assets<SavedMask>>,
    server: Res<AssetServer>,
    workers: Res<Workers>,
    mut fitting: Local<EntityHashMap<Fitting>>,
    mut failures: MaskFailures,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    // Of entities that are gone, and of masks that are ready.
    fitting.retain(|&entity, _| masks.get(entity).is_ok_and(|(_, mask, scene)| !mask.is_of(scene.scene())));
    let mut has_failed = false;
    for (entity, mut mask, loaded) in &mut masks {
        let scene = loaded.scene();
        if mask.is_of(scene) {
            continue;
        }
        // An asset that changed without moving a Gaussian keeps its painted weights, and the steps to undo.
        let is_same =
            (mask.weights.painted.as_ref()).is_some_and(|painted| painted.scene.means == scene.means);
        if is_same && let Some(painted) = &mut mask.weights.painted {
            painted.scene = Arc::clone(scene);
            continue;
        }
        let fitting = fitting.entry(entity);
        let Some(first) = first_mask(&mask, scene, (&*saved, &*server, &*workers), fitting) else { continue };
        let first = first.unwrap_or_else(|error| {
            has_failed = true;
            failures.send(entity, error);
            Mask::new(scene.len())
        });
        mask.weights = Weights::of(Painted::new(Arc::clone(scene), first));
    }
    // One that ended while the loop ran is taken in the next frame, and one that panicked never is.
    let is_being_fitted = fitting.values().any(|fitting| !matches!(fitting.mask.get(), Some(Err(_))));
    let is_being_loaded = |(_, mask, loaded): (Entity, &StyleMask, &LoadedScene)| {
        let saved = mask.saved.as_ref().filter(|_| !mask.is_of(loaded.scene()));
        saved.is_some_and(|saved| matches!(server.get_load_state(saved), Some(LoadState::Loading)))
    };
    // After a failure, for the systems that hear of it.
    if has_failed || is_being_fitted || masks.iter().any(is_being_loaded) {
        redraw.write(RequestRedraw);
    }
}

/// The mask that an entity of `scene` begins with, or `None` if its file is still on its way.
fn first_mask(
    mask: &StyleMask,
    scene: &Arc<Scene>,
    (saved, server, workers): (&Assets<SavedMask>, &AssetServer, &Workers),
    fitting: Entry<Entity, Fitting, EntityHash>,
) -> Option<Result<Mask, StyleMaskError>> {
    // What was painted before the world was saved counts for more than the file that it began as.
    let stored = match (&mask.weights.loaded, &mask.saved) {
        (Some(loaded), _) => loaded,
        (None, None) => return Some(Ok(scene.mask.clone().unwrap_or_else(|| Mask::new(scene.len())))),
        (None, Some(handle)) => match (saved.get(handle), server.get_load_state(handle)) {
            (Some(SavedMask(stored)), _) => stored,
            (None, Some(LoadState::Failed(error))) => {
                return Some(Err(StyleMaskError::Load(error.to_string())));
            }
            (None, _) => return None,
        },
    };
    let fitting = fitting.or_insert_with(|| Fitting::start(scene, stored, workers));
    if !fitting.is_of(scene, stored) {
        *fitting = Fitting::start(scene, stored, workers);
    }
    let path = || match (&mask.weights.loaded, &mask.saved) {
        (Some(_), _) => "the mask of a saved world".into(),
        (None, handle) => (handle.as_ref().and_then(Handle::path))
            .map_or_else(|| "a mask made by the program".into(), ToString::to_string),
    };
    let named = |&error: &MaskError| StyleMaskError::Scene { path: path(), error };
    // A panic, which the log tells of, leaves the mask unfitted.
    let fitted = fitting.mask.get()?.as_ref().ok()?;
    Some(fitted.as_ref().cloned().map_err(named))
}
