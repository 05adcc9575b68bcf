//! Preparing loaded scenes for paint before anyone asks for a style.

use bevy::prelude::*;

use crate::{
    scene::LoadedScene,
    style::{
        make::{surfaces::Surfaces, worker},
        wish::settings::StyleMethod,
    },
    work::Workers,
};

/// Prepares a scene for paint in the background as soon as it is loaded, so that its first painting comes
/// sooner. A component for scenes that begin unstyled or with a look; others are prepared anyway.
///
/// It takes a second or a few of the threads of [`StyleThreads`](crate::StyleThreads) and some memory, for
/// nothing if a scene only ever shows looks. It does nothing if [`StyleMethod`] is not `Paint`, and in a
/// browser that gives no worker.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StylePrepare;

/// Computes the surfaces of scenes that have been loaded.
pub(crate) fn prepare_surfaces(
    loaded: Query<&LoadedScene, With<StylePrepare>>,
    method: Res<StyleMethod>,
    mut surfaces: ResMut<Surfaces>,
    workers: Res<Workers>,
) {
    // Without a scene, no worker is started for it.
    if *method == StyleMethod::Paint && !loaded.is_empty() && worker::is_beside_frames() {
        for loaded in &loaded {
            // A style that is painted on it says if it cannot be computed.
            let _ = surfaces.get(loaded, None, &workers);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GaussianSplats, StyleSource, tests::world::*};

    #[test]
    fn a_prepared_scene_has_its_surface_before_the_first_style_and_no_longer_than_it_is_shown() {
        let mut app = app_without_rendering();
        let splats = GaussianSplats(add_scene(&mut app, small_scene(50, 1)));
        let entity = app.world_mut().spawn((splats, StyleSource::none(), StylePrepare)).id();
        update_until(&mut app, "a surface", |world| world.resource::<Surfaces>().n_known() == 1);
        app.update();
        assert_eq!(app.world().resource::<Surfaces>().n_known(), 1);
        app.world_mut().despawn(entity);
        app.update();
        assert_eq!(app.world().resource::<Surfaces>().n_known(), 0);
    }

    /// A scene whose surface takes longer than the test does.
    #[test]
    fn a_surface_that_nobody_waits_for_is_computed_no_further() {
        let mut app = app_without_rendering();
        let splats = GaussianSplats(add_scene(&mut app, small_scene(400_000, 1)));
        let entity = app.world_mut().spawn((splats, StylePrepare)).id();
        let is_begun =
            |world: &mut World| world.resource::<Surfaces>().0.values().any(|of| of.surface.done() > 0.0);
        update_until(&mut app, "a beginning", is_begun);
        app.world_mut().entity_mut(entity).remove::<StylePrepare>();
        app.update();
        assert!(app.world().resource::<Surfaces>().0.is_empty());
        // The next computation begins soon.
        let begun = std::time::Instant::now();
        let next = app.world().resource::<Workers>().start(crate::work::Lane::Styles, |_| Ok(()));
        bevy::tasks::block_on(next.wait()).unwrap();
        eprintln!("stopped within {:?}", begun.elapsed());
        // To its end it takes several seconds.
        assert!(begun.elapsed().as_secs() < 1, "{:?}", begun.elapsed());
    }
}
