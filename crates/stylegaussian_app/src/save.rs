//! Saving a scene in the colors that it is shown in.

use std::sync::LazyLock;

use bevy::tasks::{Task, TaskPool, TaskPoolBuilder};
use bevy_stylegaussian::{AppliedStyle, GaussianScene, stylegaussian::Scene};

/// The thread that saves scenes. Bevy's pool for computations has one thread on up to five cores, and all else
/// that is to run there would wait behind a scene. A browser has no threads.
static SAVING: LazyLock<TaskPool> =
    LazyLock::new(|| TaskPoolBuilder::new().num_threads(1).thread_name("saving".into()).build());

/// Has a thread of its own write a scene in the colors of a style, or in the captured ones if there is none. If
/// the GPU styled it, its colors are computed again, which takes seconds for a large scene.
pub fn save_shown<T: Send + 'static>(
    scene: &GaussianScene,
    style: Option<&AppliedStyle>,
    write: impl FnOnce(&Scene) -> Result<T, String> + Send + 'static,
) -> Task<Result<T, String>> {
    let (scene, style) = (scene.scene().clone(), style.cloned());
    SAVING.spawn(async move {
        match style {
            Some(style) => write(&style.styled_scene().map_err(|error| error.to_string())?),
            None => write(&scene),
        }
    })
}
