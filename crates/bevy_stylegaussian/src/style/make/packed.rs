//! Inputs of the style pass, packed once for each scene and decoder, in a task.

use std::{
    future::poll_fn,
    pin::pin,
    sync::{Arc, Weak},
    task::Poll,
};

use async_lock::Mutex;
use bevy::prelude::*;
use stylegaussian::{
    Decoder, Scene,
    work::{Canceled, Work},
};
use stylegaussian_gpu::style::{StyleInputs, StyleOptions};

use crate::{style::make::later::Failure, work::pauses};

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
    /// If the decoder does not fit the scene, or if `work` is canceled.
    pub(crate) async fn get(
        &self,
        scene: &Arc<Scene>,
        decoder: &Arc<Decoder>,
        work: &Work,
    ) -> Result<Arc<StyleInputs>, Failure> {
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
        let mut pause = pauses();
        let mut pause = || paused(pause(), work);
        let packing = StyleInputs::in_slices(scene, decoder, StyleOptions::default(), &mut pause);
        let inputs = Arc::new(if_wanted(packing, work).await??);
        all.push(Packed {
            scene: Arc::downgrade(scene),
            decoder: Arc::downgrade(decoder),
            inputs: Arc::downgrade(&inputs),
        });
        Ok(inputs)
    }
}

/// The result of a computation whose pauses are [`paused`].
///
/// # Errors
/// If `work` is canceled.
async fn if_wanted<T>(computation: impl Future<Output = T>, work: &Work) -> Result<T, Canceled> {
    let mut computation = pin!(computation);
    let poll = poll_fn(|context| match work.check() {
        Ok(()) => computation.as_mut().poll(context).map(Ok),
        Err(canceled) => Poll::Ready(Err(canceled)),
    });
    poll.await
}

/// A pause that does not end if `work` is canceled, so that [`if_wanted`] is asked again.
async fn paused(pause: impl Future<Output = ()>, work: &Work) {
    pause.await;
    let end = poll_fn(|context| {
        if work.is_canceled() {
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        Poll::Ready(())
    });
    end.await;
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
            block_on(packed.get(&scene, &decoder, &Work::default())).unwrap()
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

    #[test]
    fn packing_stops_at_the_pause_after_it_was_canceled() {
        let (work, mut n_slices) = (Work::default(), 0);
        let slices = async {
            for i in 0..10 {
                n_slices = i;
                if i == 3 {
                    work.cancel();
                }
                paused(std::future::ready(()), &work).await;
            }
        };
        assert_eq!(block_on(if_wanted(slices, &work)), Err(Canceled));
        assert_eq!(n_slices, 3);
        let scene = Arc::new(small_scene(50, 1));
        let (decoder, packed) = (Arc::new(scene.decoder.clone().unwrap()), PackedInputs::default());
        let canceled = block_on(packed.get(&scene, &decoder, &work));
        assert!(matches!(canceled, Err(Failure::Canceled)));
        // Whoever comes next does not wait for it.
        assert!(block_on(packed.get(&scene, &decoder, &Work::default())).is_ok());
    }
}
