//! Apps that draw on demand, as with Bevy's `WinitSettings::desktop_app`: what comes from the background asks
//! for the frames that show it, and nothing asks for frames for ever.

use std::time::{Duration, Instant};

use bevy::{
    asset::AssetPlugin,
    prelude::*,
    render::settings::{WgpuLimits, WgpuSettings},
    time::TimeUpdateStrategy,
    window::RequestRedraw,
};
use stylegaussian::Scene;
use stylegaussian_files::{world::FILE, write_scene};

use crate::{
    AppliedStyle, GaussianSceneFailed, GaussianSceneReady, GaussianSplats, StyleGaussianPlugin, StyleSource,
    StyleTransition,
    mask::StyleMask,
    style::{StyleMotion, TransitionClock, decoder::StyleBackend, has_unsettled_styles},
    world::{GaussianWorld, WorldState},
};

use super::{
    paint::noise,
    world::{rendering::*, *},
    worlds::write_world,
};

/// Updates as a runner does that waits for input: only as long as frames are asked for. Returns the number of
/// updates.
fn until_asleep(app: &mut App) -> usize {
    let (start, mut n_updates) = (Instant::now(), 0);
    loop {
        app.update();
        n_updates += 1;
        if drain::<RequestRedraw>(app).is_empty() {
            return n_updates;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "frames are asked for without end");
        // Leaves the cores to background tasks.
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// The number of failed and of drawn scenes that observers heard of.
#[derive(Resource, Default)]
struct Heard {
    failed: usize,
    ready: usize,
}

/// Counts events. Messages would be gone by the time at which an app is asleep.
fn count(app: &mut App) {
    app.init_resource::<Heard>()
        .add_observer(|_: On<GaussianSceneFailed>, mut heard: ResMut<Heard>| heard.failed += 1)
        .add_observer(|_: On<GaussianSceneReady>, mut heard: ResMut<Heard>| heard.ready += 1);
}

#[test]
fn files_and_their_style_come_without_any_input() {
    let dir = tempfile::tempdir().unwrap();
    let raw = Scene { features: None, decoder: None, ..small_scene(100, 1) };
    write_scene(&dir.path().join("a.ply"), &raw).unwrap();
    let image = noise(1, [200, 40, 30], [20, 40, 180]);
    image.try_into_dynamic().unwrap().save(dir.path().join("a.png")).unwrap();
    let file_path = dir.path().to_string_lossy().into_owned();
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, AssetPlugin { file_path, ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .insert_resource(QUICK_THREADS);
    let mut app = finish(app);
    let assets = app.world().resource::<AssetServer>().clone();
    let source = StyleSource::image(assets.load("a.png"));
    let splats = GaussianSplats(assets.load("a.ply"));
    let entity = app.world_mut().spawn((splats, source, StyleMask::default())).id();
    until_asleep(&mut app);
    assert!(app.world().get::<AppliedStyle>(entity).is_some(), "the app sleeps before the style is there");
    assert_eq!(until_asleep(&mut app), 1, "nothing is left to show");
    // A change by the game, in a frame that there is anyway.
    *app.world_mut().get_mut(entity).unwrap() = StyleSource::none();
    until_asleep(&mut app);
    assert!(app.world().get::<AppliedStyle>(entity).is_none());
}

#[test]
fn a_world_and_its_style_come_without_any_input() {
    let dir = tempfile::tempdir().unwrap();
    write_world(dir.path());
    let file_path = dir.path().to_string_lossy().into_owned();
    let mut app = app_with_assets(AssetPlugin { file_path, ..default() });
    let manifest = app.world().resource::<AssetServer>().load(FILE);
    let world = app.world_mut().spawn(GaussianWorld(manifest)).id();
    let is_settled = |app: &App| app.world().get::<WorldState>(world).is_some_and(WorldState::is_settled);
    until_asleep(&mut app);
    assert!(is_settled(&app), "the app sleeps before the world is there");
    let painting = add(&mut app, noise(1, [200, 40, 30], [20, 40, 180]));
    app.world_mut().entity_mut(world).insert(StyleSource::image(painting));
    until_asleep(&mut app);
    assert!(is_settled(&app), "the app sleeps before the world is painted");
}

#[test]
fn a_fade_asks_for_its_frames_unless_its_clock_stands_still() {
    let mut app = app_without_rendering();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_millis(10)));
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(50, 1)));
    let fade = StyleTransition::fade(Duration::from_millis(300));
    let parts = (splats, StyleSource::preset(style.clone()), fade.clone());
    let entity = app.world_mut().spawn(parts).id();
    let n_updates = until_asleep(&mut app);
    assert!(n_updates >= 30, "the app sleeps after {n_updates} updates, within the fade");
    // A fade by the clock of a game that is paused waits for the game.
    app.world_mut().resource_mut::<Time<Virtual>>().pause();
    let other = add_style(&mut app, small_style(2));
    let paused = StyleTransition { clock: TransitionClock::Virtual, ..fade };
    app.world_mut().entity_mut(entity).insert((StyleSource::preset(other), paused));
    until_asleep(&mut app);
    assert!(!has_unsettled_styles(app.world_mut()), "it is applied all the same");
}

/// Only where something is drawn, since only there something would be seen of it.
#[test]
fn moving_strokes_ask_for_frames_unless_the_game_is_paused() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_millis(10)));
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(50, 1)));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style.clone()))).id();
    until_asleep(&mut app);
    let moving = StyleSource::preset(style).with_motion(StyleMotion::flow(1.0));
    app.world_mut().entity_mut(entity).insert(moving);
    for _ in 0..20 {
        app.update();
        assert!(!drain::<RequestRedraw>(&mut app).is_empty());
    }
    app.world_mut().resource_mut::<Time<Virtual>>().pause();
    until_asleep(&mut app);
}

#[test]
fn what_never_comes_keeps_no_app_awake() {
    let mut app = app_without_rendering();
    count(&mut app);
    let assets = app.world().resource::<AssetServer>().clone();
    let raw = Scene { features: None, decoder: None, ..small_scene(50, 1) };
    let splats = GaussianSplats(add_scene(&mut app, raw));
    // Nobody will ever add this image, or this scene.
    let never = app.world().resource::<Assets<Image>>().reserve_handle();
    app.world_mut().spawn((splats.clone(), StyleSource::image(never)));
    app.world_mut().spawn((GaussianSplats::default(), StyleMask::default()));
    // These files do not exist.
    app.world_mut().spawn((splats, StyleSource::image(assets.load("no/such.png"))));
    app.world_mut().spawn(GaussianSplats(assets.load("no/such.ply")));
    until_asleep(&mut app);
    assert_eq!(app.world().resource::<Heard>().failed, 1, "the app sleeps before it hears of it");
}

/// Scenes are uploaded and pipelines are compiled in the background here, as in a game.
#[test]
fn a_scene_is_drawn_without_any_input() {
    let Some(mut app) = app_without_splats(WgpuSettings::default()) else { return };
    app.insert_resource(StyleBackend::Cpu).insert_resource(QUICK_THREADS);
    app.add_plugins(StyleGaussianPlugin::default());
    let mut app = finish(app);
    let image = render_target(&mut app, UVec2::splat(32));
    app.world_mut().spawn((
        Camera3d::default(),
        Camera { clear_color: Color::BLACK.into(), ..default() },
        target(&image),
        Transform::from_xyz(0.0, 0.0, 4.0),
    ));
    let light = |app: &App| -> f32 {
        read_back(app, &image).iter().map(|pixel| pixel[..3].iter().sum::<f32>()).sum()
    };
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(100, 1)));
    let entity = app.world_mut().spawn((splats, StyleMask::default())).id();
    until_asleep(&mut app);
    let captured = light(&app);
    assert!(captured > 1.0, "the app sleeps before the scene is drawn: {captured}");
    app.world_mut().entity_mut(entity).insert(StyleSource::preset(style));
    until_asleep(&mut app);
    let styled = light(&app);
    assert!((styled - captured).abs() > 0.5, "the app sleeps before the style is drawn");
    // The next scene replaces this one once it is uploaded.
    let next = GaussianSplats(add_scene(&mut app, balls(&[])));
    app.world_mut().entity_mut(entity).insert(next);
    until_asleep(&mut app);
    assert_eq!(light(&app), 0.0, "the app sleeps before the next scene is drawn");
}

/// A scene that the device refuses is never drawn, and a style of it neither.
#[test]
fn a_refused_scene_keeps_no_app_awake() {
    let limits = WgpuLimits {
        // 65,536 splats of 16 bytes.
        max_storage_buffer_binding_size: 1 << 20,
        // As many as the adapter has: Bevy's materials bind arrays if the adapter can.
        max_binding_array_elements_per_shader_stage: u32::MAX,
        max_binding_array_sampler_elements_per_shader_stage: u32::MAX,
        ..WgpuLimits::default()
    };
    let settings = WgpuSettings { constrained_limits: Some(limits), ..default() };
    let Some(mut app) = app_with_settings(StyleBackend::Cpu, settings) else { return };
    count(&mut app);
    let large = Scene { features: None, decoder: None, ..small_scene(70_000, 1) };
    let splats = GaussianSplats(add_scene(&mut app, large));
    app.world_mut().spawn((splats, StyleMask::default()));
    until_asleep(&mut app);
    let heard = app.world().resource::<Heard>();
    assert_eq!((heard.failed, heard.ready), (1, 0));
}
