//! Surfaces of scenes, which paint is laid on: computed once for each scene, in the background.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use async_lock::OnceCell;
use bevy::prelude::*;
use stylegaussian::{Scene, paint::Surface};

/// The surfaces of the scenes that are painted, as long as the scenes live.
#[derive(Resource, Clone, Default)]
// Shared with tasks and threads, which cannot borrow resources.
pub(super) struct Surfaces(Arc<Mutex<Vec<Known>>>);

/// The surface of a scene, or its place while it is computed.
struct Known {
    scene: Weak<Scene>,
    surface: Arc<OnceCell<Arc<Surface>>>,
}

impl Surfaces {
    /// Number of surfaces that are known.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.iter().filter(|known| known.surface.is_initialized()).count()
    }

    /// Computes the surface of `scene` in a thread of its own, unless it is known or under way: a task would
    /// keep others waiting behind it.
    #[cfg(not(target_family = "wasm"))]
    pub(super) fn prepare(&self, scene: &Arc<Scene>) {
        let (surface, is_new) = self.place(scene);
        if is_new {
            let scene = Arc::clone(scene);
            let compute = move || {
                surface.get_or_init_blocking(|| Arc::new(Surface::new(&scene)));
            };
            // Without a thread the first painting computes it.
            let _ = std::thread::Builder::new().name("surface".into()).spawn(compute);
        }
    }

    /// Does nothing: there are no threads in a browser, so the first painting computes the surface.
    #[cfg(target_family = "wasm")]
    pub(super) fn prepare(&self, _: &Arc<Scene>) {}

    /// The surface of `scene`, computed now if nobody does so yet. Waits as tasks do for the one who does.
    pub(super) async fn get(&self, scene: &Arc<Scene>) -> Arc<Surface> {
        let (surface, _) = self.place(scene);
        Arc::clone(surface.get_or_init(async || Arc::new(Surface::new(scene))).await)
    }

    /// The place of a scene's surface, and whether it is new.
    fn place(&self, scene: &Arc<Scene>) -> (Arc<OnceCell<Arc<Surface>>>, bool) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|known| known.scene.strong_count() > 0);
        // A weak pointer keeps its address taken, so equal addresses mean the same scene.
        if let Some(known) = all.iter().find(|known| known.scene.as_ptr() == Arc::as_ptr(scene)) {
            return (Arc::clone(&known.surface), false);
        }
        let surface = Arc::new(OnceCell::new());
        all.push(Known { scene: Arc::downgrade(scene), surface: Arc::clone(&surface) });
        (surface, true)
    }
}

#[cfg(test)]
mod tests {
    use bevy::tasks::block_on;

    use super::*;
    use crate::tests::world::small_scene;

    #[test]
    fn a_surface_is_computed_once_and_kept_as_long_as_its_scene() {
        let (surfaces, scene) = (Surfaces::default(), Arc::new(small_scene(50, 1)));
        surfaces.prepare(&scene);
        let first = block_on(surfaces.get(&scene));
        assert!(Arc::ptr_eq(&first, &block_on(surfaces.get(&scene))));
        let of_another_scene = block_on(surfaces.get(&Arc::new(small_scene(50, 2))));
        assert!(!Arc::ptr_eq(&first, &of_another_scene));
        // The thread may still hold the scene for a moment.
        while Arc::strong_count(&scene) > 1 {
            std::thread::yield_now();
        }
        drop(scene);
        block_on(surfaces.get(&Arc::new(small_scene(10, 3))));
        assert_eq!(Arc::strong_count(&first), 1, "the scene is gone");
    }
}
