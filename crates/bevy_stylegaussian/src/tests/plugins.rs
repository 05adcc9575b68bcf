//! The order of plugins: what is missing is said, and apps that do not draw work.

use std::panic::{AssertUnwindSafe, catch_unwind};

use bevy::{asset::AssetPlugin, prelude::*, render::settings::WgpuSettings};

use super::{
    paint::noise,
    styles::{colors, until_applied},
    world::{rendering::*, *},
};
use crate::{GaussianSplats, StyleGaussianPlugin, StyleSource};

/// The message of the panic of an app that is built and finished.
fn advice(build: impl FnOnce(&mut App)) -> String {
    let built = catch_unwind(AssertUnwindSafe(|| {
        let mut app = App::new();
        build(&mut app);
        app.finish();
    }));
    let payload = built.expect_err("no panic");
    payload
        .downcast_ref::<String>()
        .cloned()
        .unwrap_or_else(|| payload.downcast_ref::<&str>().expect("a message").to_string())
}

#[test]
fn a_missing_or_late_plugin_is_named() {
    let ours = StyleGaussianPlugin::default;
    let message = advice(|app| {
        app.add_plugins(MinimalPlugins).add_plugins(ours());
    });
    assert!(message.contains("no AssetPlugin: add it after DefaultPlugins"), "{message}");
    let message = advice(|app| {
        app.add_plugins(ours()).add_plugins((MinimalPlugins, AssetPlugin::default()));
    });
    assert!(message.contains("no AssetPlugin: add it after DefaultPlugins"), "{message}");
    let message = advice(|app| {
        app.add_plugins((bevy::app::TaskPoolPlugin::default(), AssetPlugin::default(), ours()));
    });
    assert!(message.contains("no TimePlugin: add DefaultPlugins or MinimalPlugins"), "{message}");
    let message = advice(|app| {
        app.add_plugins((MinimalPlugins, AssetPlugin::default(), ours()));
        // As Bevy's `RenderPlugin` does if there is a backend.
        app.insert_sub_app(bevy::render::RenderApp, SubApp::new());
    });
    assert!(message.contains("before RenderPlugin: add it after DefaultPlugins"), "{message}");
}

/// Styles a scene by a preset and by a picture.
fn styles(mut app: App) {
    app.finish();
    app.cleanup();
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(30, 1)));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style))).id();
    until_applied(&mut app);
    let decoded = colors(app.world(), entity).unwrap();
    let picture = app.world().resource::<AssetServer>().load("a.png");
    let scene = stylegaussian::Scene { features: None, decoder: None, ..small_scene(30, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene));
    app.world_mut().entity_mut(entity).insert((splats, StyleSource::image(picture)));
    until_applied(&mut app);
    assert_ne!(colors(app.world(), entity).unwrap(), decoded);
}

/// A folder with a picture.
fn folder() -> (tempfile::TempDir, AssetPlugin) {
    let dir = tempfile::tempdir().unwrap();
    let image = noise(1, [200, 40, 30], [20, 40, 180]);
    image.try_into_dynamic().unwrap().save(dir.path().join("a.png")).unwrap();
    let file_path = dir.path().to_string_lossy().into_owned();
    (dir, AssetPlugin { file_path, ..default() })
}

#[test]
fn a_server_without_images_styles_scenes() {
    let (_folder, assets) = folder();
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, assets)).add_plugins(StyleGaussianPlugin::default());
    styles(app);
}

#[test]
fn the_image_plugin_may_come_later_and_is_not_replaced() {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, AssetPlugin::default()))
        .add_plugins((StyleGaussianPlugin::default(), ImagePlugin::default()));
    app.finish();
    app.cleanup();
    app.update();
    // Bevy's default image.
    assert!(app.world().resource::<Assets<Image>>().contains(&Handle::default()));
}

#[test]
fn a_renderer_without_a_backend_styles_scenes() {
    let (_folder, assets) = folder();
    let mut app = app_of_settings(WgpuSettings { backends: None, ..default() }, assets);
    app.add_plugins(StyleGaussianPlugin::default());
    styles(app);
}
