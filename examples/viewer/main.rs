//! The viewer: shows any captured scene and restyles it with a click.
//!
//! ```sh
//! cargo run --release --example viewer [SCENE] [STYLE...]    # default: the demo scene, as it was captured
//! ```
//!
//! `SCENE` is a file in any format that the plugin reads, or a folder with one (SOG). The folder of a world, or
//! its `lod-meta.json`, is shown at levels of detail that follow the camera, under a budget.
//!
//! `STYLE` is a `.jpg` or `.png` image, a `.style.safetensors` file, or a `.look.safetensors` file that was
//! baked for the scene; several are mixed in equal parts. Files can also be dropped on the window, or opened by
//! their path in the panel.
//!
//! Left drag orbits, right drag looks around, middle drag pans, the wheel zooms. W A S D fly, Q and E go down
//! and up, Shift makes it faster, F shows the whole scene. Keys 1 to 8 apply the first eight styles, 0 none. F1
//! hides the panel.
//!
//! With a tool of "parts of the scene", the left button paints, selects or moves a volume. A drag in "parts of
//! the paintings" chooses what is used of one. Ctrl+Z undoes, Ctrl+Shift+Z makes it again.

use std::{env, path::PathBuf};

use bevy::{asset::UnapprovedPathMode, diagnostic::FrameTimeDiagnosticsPlugin, prelude::*};
use bevy_egui::{
    EguiGlobalSettings, EguiPlugin, EguiPrimaryContextPass, input::egui_wants_any_keyboard_input,
};
use bevy_stylegaussian::{StyleGaussianPlugin, stylegaussian_files::readable_extensions};
use stylegaussian_app::{Arrivals, place_camera, set_transition};

#[path = "../backdrop/mod.rs"]
mod backdrop;
mod camera;
mod crop_panel;
mod files;
mod hand_panel;
mod light;
mod panel;
mod parts;
mod parts_panel;
mod save;
mod scene;
mod strokes_panel;
mod styles;
mod tile;
mod tools;
mod world_panel;

/// Folder of the repository's assets.
const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

fn main() -> AppExit {
    let mut arguments = env::args_os().skip(1).map(PathBuf::from).peekable();
    if arguments.peek().is_some_and(|first| first.as_os_str().to_string_lossy().starts_with('-')) {
        println!(
            "Usage: viewer [SCENE] [STYLE...]\n\nSCENE: .{}, or the folder of a world\n\
             STYLE: .jpg, .png, .style.safetensors, .look.safetensors",
            readable_extensions().join(", .")
        );
        return AppExit::Success;
    }
    let scene = arguments.next().unwrap_or_else(|| PathBuf::from(ASSETS).join("demo.sgs"));
    let window = Window { title: "StyleGaussian".into(), ..default() };
    // The user's files are outside of the app's folder.
    let files = AssetPlugin {
        file_path: ASSETS.into(),
        unapproved_path_mode: UnapprovedPathMode::Allow,
        ..default()
    };
    App::new()
        .add_plugins(
            DefaultPlugins.set(files).set(WindowPlugin { primary_window: Some(window), ..default() }),
        )
        .add_plugins((StyleGaussianPlugin::default(), EguiPlugin::default()))
        .add_plugins(FrameTimeDiagnosticsPlugin::default())
        // `camera::spawn` gives the panel a camera of its own.
        .insert_resource(EguiGlobalSettings { auto_create_primary_context: false, ..default() })
        .insert_resource(files::CommandLine { scene, styles: arguments.collect() })
        .init_resource::<Arrivals>()
        .init_resource::<light::Light>()
        .init_resource::<panel::Panel>()
        .init_resource::<panel::Notice>()
        .init_resource::<panel::Transfer>()
        .init_resource::<parts::Parts>()
        .init_resource::<save::Saving>()
        .add_message::<files::OpenFile>()
        .add_message::<save::Save>()
        .add_systems(Startup, backdrop::spawn)
        .add_systems(
            Startup,
            // Chained: the resources that the first two insert are there when the files of the command line are
            // opened.
            (styles::list_shipped, scene::spawn, camera::spawn, files::open_arguments).chain(),
        )
        .add_systems(
            Update,
            (
                (files::take_dropped, files::open, scene::show_loaded).chain(),
                (styles::press_keys, panel::toggle, parts::press_keys)
                    .run_if(not(egui_wants_any_keyboard_input)),
                (
                    save::take_screenshot,
                    save::save_scene,
                    save::finish_scene,
                    save::save_mask,
                    save::save_pins,
                )
                    .chain(),
                (parts::follow_scene, tools::apply, parts::note_changes).chain(),
                camera::fly.run_if(not(egui_wants_any_keyboard_input)),
                camera::drag,
                world_panel::note_settled,
            ),
        )
        .add_systems(
            PostUpdate,
            // Before transforms are propagated, or camera and splats would lag behind by a frame.
            (
                (styles::apply, set_transition, parts::show, light::show),
                (scene::turn_up, place_camera, camera::place_picture),
            )
                .before(TransformSystems::Propagate),
        )
        .add_systems(EguiPrimaryContextPass, panel::draw)
        .add_observer(panel::note_applied)
        .add_observer(panel::note_refined)
        .add_observer(panel::note_failed_style)
        .add_observer(panel::note_failed_scene)
        .add_observer(panel::note_failed_world)
        .add_observer(parts::note_failed_mask)
        .run()
}
