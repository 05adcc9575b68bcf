//! Apps without a window for the examples, whose frames are drawn one by one.

use anyhow::{Result, bail};
use bevy::{app::PluginsState, prelude::*, render::RenderPlugin, window::ExitCondition, winit::WinitPlugin};
use bevy_stylegaussian::prelude::*;

/// An app without a window and its events, with files from the folder `assets`.
pub fn app(assets: &str) -> App {
    let window = WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() };
    let files = AssetPlugin { file_path: assets.into(), ..default() };
    let mut app = App::new();
    // Every frame is saved, so none may be drawn without a pipeline that is still being compiled.
    let drawing = RenderPlugin { synchronous_pipeline_compilation: true, ..default() };
    let splats = StyleGaussianPlugin { synchronous_pipeline_compilation: true };
    app.add_plugins((DefaultPlugins.set(window).set(files).set(drawing).disable::<WinitPlugin>(), splats));
    // The renderer is created asynchronously. A runner would wait for it like this.
    while app.plugins_state() == PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    app
}

/// Draws one frame. Returns the entities whose style was applied in it.
pub fn step(app: &mut App) -> Result<Vec<Entity>> {
    app.update();
    let world = app.world_mut();
    if let Some(failed) = world.resource_mut::<Messages<GaussianSceneFailed>>().drain().next() {
        bail!("{}", failed.error);
    } else if let Some(failed) = world.resource_mut::<Messages<StyleFailed>>().drain().next() {
        bail!("{}", failed.error);
    }
    let applied = world.resource_mut::<Messages<StyleApplied>>().drain().map(|event| event.entity).collect();
    // Bevy answers a render error by an exit, which only a runner would act on.
    app.should_exit().map_or(Ok(applied), |exit| bail!("the renderer gave up: {exit:?}"))
}
