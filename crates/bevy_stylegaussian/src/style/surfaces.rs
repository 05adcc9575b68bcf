//! Surfaces of scenes, which paint is laid on: computed once for each scene and stroke size, in a task.

use std::{
    sync::{Arc, Mutex, PoisonError, Weak},
    thread,
};

use bevy::prelude::*;
use stylegaussian::{Scene, paint::Surface};

use super::{settings::StyleMethod, source::StyleSource};
use crate::scene::LoadedScene;

/// Prepares a scene for paint in the background as soon as it is loaded, so that its first style comes as quickly as later
/// ones. A component beside [`StyleSource`], for scenes that begin unstyled or with a look.
///
/// It takes seconds of a thread and some memory, for nothing if a scene only ever shows looks. It does nothing if the scene
/// has no features, if [`StyleMethod`] is not `Paint`, and in a browser, which has no threads.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StylePrepare;

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

/// A scene to prepare: it or the wish is new.
type ToPrepare = (With<StylePrepare>, Or<(Changed<LoadedScene>, Added<StylePrepare>)>);

/// Computes the surfaces of scenes that have been loaded, in threads of their own: a task would keep looks waiting behind it.
pub(super) fn prepare_surfaces(
    loaded: Query<(&LoadedScene, &StyleSource), ToPrepare>,
    method: Res<StyleMethod>,
    surfaces: Res<Surfaces>,
) {
    for (loaded, source) in &loaded {
        if *method != StyleMethod::Paint || loaded.scene().features.is_none() || cfg!(target_family = "wasm")
        {
            continue;
        }
        let (surfaces, scene, stroke_scale) =
            (surfaces.clone(), Arc::clone(loaded.scene()), source.stroke_scale);
        // Without a thread the first style computes them itself.
        let _ = thread::Builder::new().name("surfaces".into()).spawn(move || {
            surfaces.get(&scene, stroke_scale);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GaussianSplats, tests::world::*};

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

    #[test]
    fn a_prepared_scene_has_its_surface_before_the_first_style() {
        let mut app = app_without_rendering();
        let splats = GaussianSplats(add_scene(&mut app, small_scene(50, 1)));
        app.world_mut().spawn((splats, StyleSource::none(), StylePrepare));
        let known = |app: &App| app.world().resource::<Surfaces>().0.lock().unwrap().len();
        let begun = std::time::Instant::now();
        while known(&app) == 0 {
            assert!(begun.elapsed().as_secs() < 60, "no surface");
            app.update();
        }
        assert_eq!(known(&app), 1);
    }
}
