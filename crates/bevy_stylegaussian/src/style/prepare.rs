//! Preparing loaded scenes for paint before anyone asks for a style.

use bevy::prelude::*;

use super::{settings::StyleMethod, surfaces::Surfaces};
use crate::scene::LoadedScene;

/// Prepares a scene for paint in the background as soon as it is loaded, so that its first painting comes
/// sooner. A component for scenes that begin unstyled or with a look; others are prepared anyway.
///
/// It takes a second or a few of a thread and some memory, for nothing if a scene only ever shows looks. It
/// does nothing if [`StyleMethod`] is not `Paint`, and in a browser, which has no threads.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StylePrepare;

/// A scene to prepare: it or the wish is new.
type ToPrepare = (With<StylePrepare>, Or<(Changed<LoadedScene>, Added<StylePrepare>)>);

/// Computes the surfaces of scenes that have been loaded.
pub(super) fn prepare_surfaces(
    loaded: Query<&LoadedScene, ToPrepare>,
    method: Res<StyleMethod>,
    surfaces: Res<Surfaces>,
) {
    for loaded in loaded.iter().filter(|_| *method == StyleMethod::Paint) {
        surfaces.prepare(loaded.scene());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GaussianSplats, StyleSource, tests::world::*};

    #[test]
    fn a_prepared_scene_has_its_surface_before_the_first_style() {
        let mut app = app_without_rendering();
        let splats = GaussianSplats(add_scene(&mut app, small_scene(50, 1)));
        app.world_mut().spawn((splats, StyleSource::none(), StylePrepare));
        let known = |app: &App| app.world().resource::<Surfaces>().len();
        let begun = std::time::Instant::now();
        while known(&app) == 0 {
            assert!(begun.elapsed().as_secs() < 60, "no surface");
            app.update();
        }
        assert_eq!(known(&app), 1);
    }
}
