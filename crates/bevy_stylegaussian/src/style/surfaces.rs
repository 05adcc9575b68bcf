//! Surfaces of scenes, which paint is laid on: computed once for each scene and stroke size, in a task.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use bevy::prelude::*;
use stylegaussian::{Scene, paint::Surface};

/// The surfaces of the scenes that were painted, as long as the scenes live.
#[derive(Resource, Clone, Default)]
// Shared with tasks, which cannot borrow resources.
pub(super) struct Surfaces(Arc<Mutex<Vec<Painted>>>);

struct Painted {
    scene: Weak<Scene>,
    stroke_scale: f32,
    surface: Arc<Surface>,
}

impl Surfaces {
    /// Number of surfaces that are known.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// The surface of `scene` for strokes of this size. Takes seconds if it is not known yet: not for the
    /// main thread.
    pub(super) fn get(&self, scene: &Arc<Scene>, stroke_scale: f32) -> Arc<Surface> {
        // Locked while it is computed: a second task that needs the same surface waits for it.
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|painted| painted.scene.strong_count() > 0);
        // A weak pointer keeps its address taken, so equal addresses mean the same scene.
        let is_of = |painted: &Painted| painted.scene.as_ptr() == Arc::as_ptr(scene);
        if let Some(found) = all
            .iter()
            .find(|painted| is_of(painted) && painted.stroke_scale.to_bits() == stroke_scale.to_bits())
        {
            return Arc::clone(&found.surface);
        }
        let surface = Arc::new(Surface::new(scene, stroke_scale));
        // One size for each scene: a slider would otherwise leave a surface behind for each of its steps.
        all.retain(|painted| !is_of(painted));
        all.push(Painted { scene: Arc::downgrade(scene), stroke_scale, surface: Arc::clone(&surface) });
        surface
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::world::small_scene;

    #[test]
    fn a_surface_is_kept_as_long_as_its_scene() {
        let (surfaces, scene) = (Surfaces::default(), Arc::new(small_scene(50, 1)));
        let first = surfaces.get(&scene, 1.0);
        assert!(Arc::ptr_eq(&first, &surfaces.get(&scene, 1.0)));
        let other = surfaces.get(&scene, 2.0);
        assert!(!Arc::ptr_eq(&first, &other));
        let of_another_scene = surfaces.get(&Arc::new(small_scene(50, 2)), 2.0);
        assert!(!Arc::ptr_eq(&other, &of_another_scene));
        assert!(Arc::ptr_eq(&other, &surfaces.get(&scene, 2.0)));
        drop(scene);
        surfaces.get(&Arc::new(small_scene(10, 3)), 1.0);
        assert_eq!(Arc::strong_count(&other), 1, "the scene is gone");
    }
}
