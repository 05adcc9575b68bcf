//! A GPU that fails: a sentence on the page, and the app goes on.

use bevy::{
    prelude::*,
    render::{
        error_handler::{ErrorType, RenderError, RenderErrorHandler, RenderErrorPolicy},
        settings::RenderCreation,
    },
};
use bevy_stylegaussian::GaussianSplats;

use crate::bridge::{self, Event};

/// The handler of errors of the GPU. Bevy's own ends the app.
pub fn handler() -> RenderErrorHandler {
    RenderErrorHandler(handle)
}

fn handle(error: &RenderError, main_world: &mut World, _: &mut World) -> RenderErrorPolicy {
    match error.ty {
        // Browsers take the GPU away from pages, for instance when a laptop changes its GPU. Scenes and styles
        // are kept on the CPU, and go to the new device.
        ErrorType::DeviceLost => {
            bridge::tell(Event::Failed, "The browser took the GPU away. The scene is set up again.");
            RenderErrorPolicy::Recover(RenderCreation::default())
        }
        ErrorType::OutOfMemory => {
            drop_scene(main_world);
            bridge::tell(Event::Failed, "The GPU has no memory left for this scene. Open a smaller one.");
            RenderErrorPolicy::Ignore
        }
        ErrorType::Validation | ErrorType::Internal => {
            bridge::tell(Event::Failed, &format!("The GPU refused a command: {}", error.description));
            RenderErrorPolicy::StopRendering
        }
    }
}

/// Shows no scene, so that its memory is free again.
fn drop_scene(world: &mut World) {
    let mut scenes = world.query::<&mut GaussianSplats>();
    scenes.iter_mut(world).for_each(|mut scene| *scene = GaussianSplats::default());
}
