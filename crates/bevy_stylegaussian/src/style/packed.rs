//! What styling takes of a scene on the GPU, packed once for each scene and decoder, in the background.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use bevy::prelude::*;
use stylegaussian::{Decoder, Scene, fold::StylizeError};
use stylegaussian_gpu::style::StyleInputs;

/// Packed inputs that a look still uses. Nothing here keeps them, or the scene, alive.
#[derive(Resource, Clone, Default)]
pub(super) struct PackedInputs(Arc<Mutex<Vec<Packed>>>);

struct Packed {
    scene: Weak<Scene>,
    decoder: Weak<Decoder>,
    inputs: Weak<StyleInputs>,
}

impl PackedInputs {
    /// The inputs of `scene` for `decoder`, packed now where they are not known. Takes a while: not for the main thread.
    ///
    /// # Errors
    /// When the decoder does not fit the scene.
    pub(super) fn get(
        &self,
        scene: &Arc<Scene>,
        decoder: &Arc<Decoder>,
    ) -> Result<Arc<StyleInputs>, StylizeError> {
        if let Some(inputs) = self.known(scene, decoder) {
            return Ok(inputs);
        }
        let inputs = Arc::new(StyleInputs::new(scene, decoder)?);
        let packed = Packed {
            scene: Arc::downgrade(scene),
            decoder: Arc::downgrade(decoder),
            inputs: Arc::downgrade(&inputs),
        };
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(packed);
        Ok(inputs)
    }

    fn known(&self, scene: &Arc<Scene>, decoder: &Arc<Decoder>) -> Option<Arc<StyleInputs>> {
        let mut packed = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        packed.retain(|packed| packed.inputs.strong_count() > 0);
        let is_of = |packed: &&Packed| {
            packed.scene.as_ptr() == Arc::as_ptr(scene) && packed.decoder.as_ptr() == Arc::as_ptr(decoder)
        };
        packed.iter().find(is_of)?.inputs.upgrade()
    }
}
