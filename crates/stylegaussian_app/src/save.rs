//! Saving a scene in the colors that it is shown in.

use bevy::tasks::{AsyncComputeTaskPool, Task};
use bevy_stylegaussian::{AppliedStyle, GaussianScene, stylegaussian::Scene};

/// Has a task write a scene in the colors of a style, or in the captured ones if there is none. If the GPU
/// styled it, its colors are computed again, which takes seconds for a large scene.
pub fn save_shown<T: Send + 'static>(
    scene: &GaussianScene,
    style: Option<&AppliedStyle>,
    write: impl FnOnce(&Scene) -> Result<T, String> + Send + 'static,
) -> Task<Result<T, String>> {
    let (scene, style) = (scene.scene().clone(), style.cloned());
    AsyncComputeTaskPool::get().spawn(async move {
        match style {
            Some(style) => write(&style.styled_scene().map_err(|error| error.to_string())?),
            None => write(&scene),
        }
    })
}
