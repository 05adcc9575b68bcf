//! Inputs of the style pass, packed once for each scene and decoder, in a task.

use std::sync::{Arc, Weak};

use async_lock::Mutex;
use bevy::prelude::*;
use stylegaussian::{Decoder, Scene, fold::StylizeError};
use stylegaussian_gpu::style::{StyleInputs, StyleOptions};

use crate::work::pauses;

/// Packed inputs that are still in use. They are held weakly: nothing here keeps them or the scene alive.
#[derive(Resource, Clone, Default)]
// Shared with tasks, which cannot borrow resources.
pub(crate) struct PackedInputs(Arc<Mutex<Vec<Packed>>>);

struct Packed {
    scene: Weak<Scene>,
    decoder: Weak<Decoder>,
    inputs: Weak<StyleInputs>,
}

impl PackedInputs {
    /// The inputs of `scene` for `decoder`, packed now if nobody uses them yet. Takes a while, in slices.
    ///
    /// # Errors
    /// If the decoder does not fit the scene.
    pub(crate) async fn get(
        &self,
        scene: &Arc<Scene>,
        decoder: &Arc<Decoder>,
    ) -> Result<Arc<StyleInputs>, StylizeError> {
        // Locked while packing: a second task that needs the same inputs waits for them instead of packing them
        // twice. It waits as tasks do, since in a browser both may be on one thread.
        let mut all = self.0.lock().await;
        all.retain(|packed| packed.inputs.strong_count() > 0);
        // A weak pointer keeps its address taken, so equal addresses mean the same scene and decoder.
        let is_of = |packed: &&Packed| {
            packed.scene.as_ptr() == Arc::as_ptr(scene) && packed.decoder.as_ptr() == Arc::as_ptr(decoder)
        };
        if let Some(inputs) = all.iter().find(is_of).and_then(|packed| packed.inputs.upgrade()) {
            return Ok(inputs);
        }
        // No deadlock: packing takes no other lock of ours and waits for no task that could ask for this one.
        let inputs =
            Arc::new(StyleInputs::in_slices(scene, decoder, StyleOptions::default(), &mut pauses()).await?);
        all.push(Packed {
            scene: Arc::downgrade(scene),
            decoder: Arc::downgrade(decoder),
            inputs: Arc::downgrade(&inputs),
        });
        Ok(inputs)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Barrier;

    use bevy::tasks::block_on;

    use super::*;
    use crate::tests::world::small_scene;

    /// The same scene is styled twice from the start, in two styles.
    #[test]
    fn two_who_ask_at_once_share_what_is_packed() {
        // Large enough that the two threads overlap while the first one packs.
        let scene = Arc::new(small_scene(20_000, 1));
        let decoder = Arc::new(scene.decoder.clone().unwrap());
        let (packed, start) = (PackedInputs::default(), Barrier::new(2));
        let ask = || {
            start.wait();
            block_on(packed.get(&scene, &decoder)).unwrap()
        };
        let (a, b) = std::thread::scope(|scope| {
            let b = scope.spawn(ask);
            (ask(), b.join().unwrap())
        });
        assert!(Arc::ptr_eq(&a, &b));
        drop((a, b));
        // Nothing is kept if nobody uses it.
        assert!(packed.0.lock_blocking().iter().all(|packed| packed.inputs.upgrade().is_none()));
        drop(scene);
        assert!(packed.0.lock_blocking().iter().all(|packed| packed.scene.upgrade().is_none()));
    }
}
