//! The page's app: a scene on the page's canvas, steered by the page's script.
//!
//! The page is HTML (`web/page/index.html`): buttons, drop of files, keys and touch are the browser's own, so
//! they work with screen readers and at any width. Its script calls the functions of [`requests`], which change
//! the app's world, and hears of what happened by [`bridge`]. Built by `cargo xtask web`. The same program in a
//! window shows the demo scene and hears nothing.

mod address;
mod bridge;
mod camera;
mod failure;
mod memory;
mod paintings;
mod requests;
mod save;
mod scene;
mod style;
mod work;
mod worker;
mod world;

use bevy::{asset::AssetMetaCheck, prelude::*};
use bevy_stylegaussian::{StyleGaussianPlugin, style::decoder::StyleBudget};
use stylegaussian_app::{Arrivals, place_camera, set_transition, splat_camera};

/// The canvas of the page.
const CANVAS: &str = "#scene";

/// GPU time per frame for a change of style, in milliseconds: half of a frame at 60 frames per second.
const BUDGET: f32 = 8.0;

fn main() -> AppExit {
    if is_worker() {
        // The page's worker runs this same module, for the functions of `work` alone.
        return AppExit::Success;
    }
    let window = Window {
        title: "StyleGaussian".into(),
        canvas: Some(CANVAS.into()),
        fit_canvas_to_parent: true,
        // Tab, reload and zoom stay the browser's.
        prevent_default_event_handling: false,
        ..default()
    };
    // Without this, the browser would report a missing file beside every asset.
    let files = AssetPlugin { meta_check: AssetMetaCheck::Never, ..default() };
    let mut app = App::new();
    address::register(&mut app);
    app.add_plugins(DefaultPlugins.set(files).set(WindowPlugin { primary_window: Some(window), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .insert_resource(failure::handler())
        .insert_resource(StyleBudget { ms_per_frame: BUDGET })
        .insert_resource(ClearColor(Color::srgb(0.07, 0.08, 0.1)))
        .init_resource::<Arrivals>()
        .init_resource::<scene::Shown>()
        .init_resource::<style::Wish>()
        .init_resource::<paintings::Paintings>()
        .init_resource::<save::Saving>()
        .add_systems(Startup, (scene::spawn, spawn_camera))
        .add_systems(
            Update,
            (
                scene::show_loaded,
                requests::do_requests,
                set_transition,
                style::put_on,
                paintings::advance,
                save::scene,
            )
                .chain(),
        )
        .add_systems(PostUpdate, (place_camera.before(TransformSystems::Propagate), camera::note).chain())
        .add_systems(Last, world::follow)
        .add_observer(bridge::tell_failed_scene)
        .add_observer(bridge::tell_shown)
        .add_observer(world::tell_failed)
        .add_observer(bridge::tell_applied)
        .add_observer(bridge::tell_failed_style)
        .run()
}

/// Whether this is a worker of a browser, where there is no page.
fn is_worker() -> bool {
    #[cfg(target_family = "wasm")]
    return !js_sys::Reflect::has(&js_sys::global(), &"document".into()).unwrap_or(false);
    #[cfg(not(target_family = "wasm"))]
    return false;
}

fn spawn_camera(mut commands: Commands) {
    commands.spawn(splat_camera());
}
