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
    /// Locked while they are packed: whoever wants the same waits instead of packing them twice.
    inputs: Arc<Mutex<Weak<StyleInputs>>>,
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
        let place = self.place(scene, decoder);
        let mut packed = place.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(inputs) = packed.upgrade() {
            return Ok(inputs);
        }
        let inputs = Arc::new(StyleInputs::new(scene, decoder)?);
        *packed = Arc::downgrade(&inputs);
        Ok(inputs)
    }

    /// Where the inputs of `scene` for `decoder` are, or will be. While both are alive, their addresses are theirs.
    fn place(&self, scene: &Arc<Scene>, decoder: &Arc<Decoder>) -> Arc<Mutex<Weak<StyleInputs>>> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|packed| packed.scene.strong_count() > 0 && packed.decoder.strong_count() > 0);
        let is_of = |packed: &&Packed| {
            packed.scene.as_ptr() == Arc::as_ptr(scene) && packed.decoder.as_ptr() == Arc::as_ptr(decoder)
        };
        if let Some(packed) = all.iter().find(is_of) {
            return Arc::clone(&packed.inputs);
        }
        let inputs = Arc::default();
        all.push(Packed {
            scene: Arc::downgrade(scene),
            decoder: Arc::downgrade(decoder),
            inputs: Arc::clone(&inputs),
        });
        inputs
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Barrier;

    use super::*;
    use crate::world::small_scene;

    /// The same scene twice, in two styles from the start.
    #[test]
    fn two_who_ask_at_once_share_what_is_packed() {
        let scene = Arc::new(small_scene(20_000, 1));
        let decoder = Arc::new(scene.decoder.clone().unwrap());
        let (packed, start) = (PackedInputs::default(), Barrier::new(2));
        let ask = || {
            start.wait();
            packed.get(&scene, &decoder).unwrap()
        };
        let (a, b) = std::thread::scope(|scope| {
            let b = scope.spawn(ask);
            (ask(), b.join().unwrap())
        });
        assert!(Arc::ptr_eq(&a, &b));
        drop((a, b));
        // Nobody uses them: nothing is kept.
        assert!(packed.place(&scene, &decoder).lock().unwrap().upgrade().is_none());
        drop(scene);
        assert!(packed.0.lock().unwrap().iter().all(|packed| packed.scene.upgrade().is_none()));
    }
}
