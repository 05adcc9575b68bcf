//! Inputs of the style pass, packed once for each scene and decoder, by the first style that needs them.

use std::{future::poll_fn, pin::pin, sync::Arc, task::Poll};

use async_lock::OnceCell;
use bevy::prelude::*;
use stylegaussian::{
    Decoder, Scene,
    work::{Canceled, Work},
};
use stylegaussian_gpu::style::{StyleInputs, StyleOptions};

use crate::{
    scene::{LoadedScene, PerScene},
    style::make::later::Failure,
    work::pauses,
};

/// Inputs of the scenes that are decoded, for each decoder that a style has.
#[derive(Resource, Default)]
pub(crate) struct PackedInputs(PerScene<Vec<Arc<LaterInputs>>>);

/// Inputs that the style packs if it is the first one.
pub(crate) struct LaterInputs {
    scene: Arc<Scene>,
    pub(crate) decoder: Arc<Decoder>,
    packed: OnceCell<Arc<StyleInputs>>,
}

impl PackedInputs {
    /// The inputs of a scene for a decoder: the same for all styles that have them at a time.
    pub(crate) fn get(&mut self, loaded: &LoadedScene, decoder: Arc<Decoder>) -> Arc<LaterInputs> {
        let of_scene = self.0.get_or_insert_with(loaded, Vec::new);
        if let Some(known) = of_scene.iter().find(|known| Arc::ptr_eq(&known.decoder, &decoder)) {
            return Arc::clone(known);
        }
        let scene = Arc::clone(loaded.scene());
        let new = Arc::new(LaterInputs { scene, decoder, packed: OnceCell::new() });
        of_scene.push(Arc::clone(&new));
        new
    }
}

impl LaterInputs {
    /// The inputs, packed now if they are not. Takes a while, in slices. A second task that needs them waits
    /// for the first one.
    ///
    /// # Errors
    /// If the decoder does not fit the scene, or if `work` is canceled.
    pub(crate) async fn packed(&self, work: &Work) -> Result<&Arc<StyleInputs>, Failure> {
        let pack = || async {
            let mut pause = pauses();
            let mut pause = || paused(pause(), work);
            let options = StyleOptions::default();
            StyleInputs::in_slices(&self.scene, &self.decoder, options, &mut pause).await.map(Arc::new)
        };
        Ok(if_wanted(self.packed.get_or_try_init(pack), work).await??)
    }
}

impl PartialEq for LaterInputs {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.scene, &other.scene) && Arc::ptr_eq(&self.decoder, &other.decoder)
    }
}

/// Forgets the inputs that no style has, and those of scenes that no entity shows.
pub(crate) fn forget_unused_inputs(mut inputs: ResMut<PackedInputs>, shown: Query<&LoadedScene>) {
    inputs.bypass_change_detection().0.retain(shown.iter(), |of_scene| {
        of_scene.retain(|inputs| Arc::strong_count(inputs) > 1);
        !of_scene.is_empty()
    });
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
    use crate::{GaussianScene, tests::world::small_scene};

    /// The same scene is styled twice from the start, in two styles.
    #[test]
    fn two_who_ask_at_once_share_what_is_packed() {
        // Large enough that the two threads overlap while the first one packs.
        let asset = GaussianScene::new(small_scene(20_000, 1));
        let loaded = LoadedScene { id: AssetId::default(), asset };
        let decoder = || Arc::clone(loaded.asset.decoder().unwrap());
        let mut world = World::new();
        world.insert_resource(PackedInputs::default());
        world.spawn(loaded.clone());
        let get = |world: &mut World, decoder| world.resource_mut::<PackedInputs>().get(&loaded, decoder);
        let inputs = [(); 2].map(|()| get(&mut world, decoder()));
        let start = Barrier::new(2);
        let ask = |inputs: &LaterInputs| {
            start.wait();
            Arc::clone(block_on(inputs.packed(&Work::default())).unwrap())
        };
        let (a, b) = std::thread::scope(|scope| {
            let b = scope.spawn(|| ask(&inputs[1]));
            (ask(&inputs[0]), b.join().unwrap())
        });
        assert!(Arc::ptr_eq(&a, &b));
        // For an equal decoder in another place, they are packed anew.
        let other = get(&mut world, Arc::new(Decoder::clone(&decoder())));
        assert!(other != inputs[0] && !Arc::ptr_eq(&a, block_on(other.packed(&Work::default())).unwrap()));
        drop(other);
        let [kept, dropped] = inputs;
        drop(dropped);
        world.run_system_cached(forget_unused_inputs).unwrap();
        assert!(Arc::ptr_eq(&kept, &get(&mut world, decoder())));
        // Nothing is kept if no style has it, though the scene is shown.
        let was_kept = Arc::downgrade(&kept);
        drop(kept);
        world.run_system_cached(forget_unused_inputs).unwrap();
        assert!(was_kept.upgrade().is_none() && world.resource::<PackedInputs>().0.is_empty());
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
        let loaded = LoadedScene { id: AssetId::default(), asset: GaussianScene::new(small_scene(50, 1)) };
        let decoder = Arc::clone(loaded.asset.decoder().unwrap());
        let inputs = PackedInputs::default().get(&loaded, decoder);
        assert!(matches!(block_on(inputs.packed(&work)), Err(Failure::Canceled)));
        // Whoever comes next does not wait for it.
        assert!(block_on(inputs.packed(&Work::default())).is_ok());
    }
}
