//! Frames that scenes ask for. An app that draws on demand, as with `WinitSettings::desktop_app`, would
//! otherwise not look at what came in the background until its user moves the mouse.

use bevy::{asset::LoadState, prelude::*, render::renderer::RenderAdapterInfo, window::RequestRedraw};

use super::{
    attach::{LoadedScene, NextScene},
    component::GaussianSplats,
    failure::GaussianSceneFailed,
};

/// Asks for another frame while scenes are loaded or uploaded, and after a failure, for the systems that hear
/// of it.
pub(super) fn ask_for_frames(
    splats: Query<(&GaussianSplats, Option<&LoadedScene>, Has<NextScene>)>,
    server: Res<AssetServer>,
    // Bevy puts a copy into the main world. It is absent if the app does not render.
    renderer: Option<Res<RenderAdapterInfo>>,
    mut failed: MessageReader<GaussianSceneFailed>,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    let is_coming = |(splats, shown, has_next): (&GaussianSplats, Option<&LoadedScene>, bool)| {
        let waits_for_gpu = || shown.is_some_and(|shown| renderer.is_some() && !shown.asset.is_on_gpu());
        let waits_for_file = || {
            // The state takes a lock, and of a scene that is shown it is known.
            shown.is_none_or(|shown| shown.id != splats.0.id())
                && matches!(server.get_load_state(&splats.0), Some(LoadState::Loading))
        };
        has_next || waits_for_gpu() || waits_for_file()
    };
    let n_failed = failed.read().count();
    if n_failed > 0 || splats.iter().any(is_coming) {
        redraw.write(RequestRedraw);
    }
}
