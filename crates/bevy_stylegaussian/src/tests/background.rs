//! Long work beside a game: what else waits for it, and how soon it stops.

use std::{
    convert::Infallible,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc,
    },
    time::{Duration, Instant},
};

use async_lock::OnceCell;
use bevy::{
    prelude::*,
    render::{RenderApp, settings::WgpuSettings},
    tasks::{AsyncComputeTaskPool, block_on},
};
use stylegaussian::{Look, Mask, Scene, StoredMask, look::MadeFrom};
use stylegaussian_files::{read_scene, write_look, write_mask, write_scene};

use crate::{
    AppliedStyle, GaussianScene, GaussianSplats, StyleGaussianPlugin, StyleSource, StyleThreads,
    mask::SavedMask,
    scene::{GpuScenes, LoadedScene, SceneReadings},
    style::{StyleLook, StylePin, StyleProgress, StyleRecolored, decoder::StyleBackend},
    work::{Lane, Running, Workers},
};

use super::{
    paint::{noise, raw, set},
    styles::until_applied,
    world::{
        rendering::{app_with_rendering, app_without_splats, finish, read_back, render_target, target},
        *,
    },
};

/// Beyond this a game's own task would be said to wait for us. It is a tenth of the time that a painting takes
/// at least, and ten times what a busy machine takes to begin a task.
const WAITS: Duration = Duration::from_millis(200);

/// Beyond this, work that nobody wants would be said to go on. It took 38 to 81 ms to stop on an idle machine,
/// and several seconds to end.
const STOPS: Duration = Duration::from_secs(1);

/// The demo scene as a raw capture.
fn demo() -> Scene {
    let assets = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    Scene { features: None, ..read_scene(&assets.join("demo.sgs")).unwrap().scene }
}

fn painting(app: &mut App, seed: u64) -> Handle<Image> {
    add(app, noise(seed, [250, 200, 30], [20, 40, 90]))
}

/// Lets one test at a time measure Bevy's pool for computations, need it, or keep it at work: all tests of a
/// process share it.
fn alone_on_the_pool() -> MutexGuard<'static, ()> {
    static POOL: Mutex<()> = Mutex::new(());
    POOL.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps all threads of Bevy's pool for computations at work until it is dropped, as a game's own tasks may.
fn busy_pool() -> (Vec<mpsc::Sender<()>>, MutexGuard<'static, ()>) {
    let alone = alone_on_the_pool();
    let pool = AsyncComputeTaskPool::get();
    let (begin, begun) = mpsc::channel();
    let mut go_on = Vec::new();
    for _ in 0..pool.thread_num() {
        let (begin, (sender, wait)) = (begin.clone(), mpsc::channel());
        go_on.push(sender);
        let task = async move {
            let _ = begin.send(());
            // Until the sender is dropped.
            let _ = wait.recv();
        };
        pool.spawn(task).detach();
    }
    go_on.iter().for_each(|_| begun.recv().unwrap());
    (go_on, alone)
}

/// Keeps a lane at work until it is dropped.
fn busy_lane(app: &App, lane: Lane) -> (mpsc::Sender<()>, Running<()>) {
    let (go_on, wait) = mpsc::channel();
    let running = app.world().resource::<Workers>().start(lane, move |_| {
        // Until the sender is dropped.
        let _ = wait.recv();
        Ok(())
    });
    (go_on, running)
}

/// Spawns a task of the game's own in each update until `done`, and returns the longest time that one waited to
/// begin.
fn longest_wait(app: &mut App, what: &str, mut done: impl FnMut(&mut World) -> bool) -> Duration {
    let longest = Arc::new(Mutex::new(Duration::ZERO));
    update_until(app, what, |world| {
        let (longest, spawned) = (Arc::clone(&longest), Instant::now());
        let task = async move {
            let mut longest = longest.lock().unwrap();
            *longest = longest.max(spawned.elapsed());
        };
        AsyncComputeTaskPool::get().spawn(task).detach();
        done(world)
    });
    // Those that are still waiting.
    block_on(AsyncComputeTaskPool::get().spawn(async {}));
    *longest.lock().unwrap()
}

#[test]
fn a_games_own_tasks_do_not_wait_for_a_painting() {
    let _alone = alone_on_the_pool();
    let mut app = app_without_rendering();
    let splats = GaussianSplats(add_scene(&mut app, demo()));
    let image = painting(&mut app, 1);
    let entity = app.world_mut().spawn((splats, StyleSource::image(image))).id();
    let first = longest_wait(&mut app, "a painting", |world| world.get::<AppliedStyle>(entity).is_some());
    let second = painting(&mut app, 2);
    *app.world_mut().get_mut(entity).unwrap() = StyleSource::image(second);
    let mut is_applied = false;
    let second = longest_wait(&mut app, "another painting", |world| {
        is_applied |= world.resource_mut::<Messages<crate::StyleApplied>>().drain().count() > 0;
        is_applied
    });
    eprintln!("longest waits: {first:.1?} beside the first painting, {second:.1?} beside the second");
    assert!(first.max(second) < WAITS, "{first:?} {second:?}");
}

#[test]
fn a_look_does_not_wait_for_a_painting() {
    let mut app = app_without_rendering();
    let demo = demo();
    let look = Look::new(&demo, &demo.base_colors(), MadeFrom::default());
    let splats = GaussianSplats(add_scene(&mut app, demo));
    let (image, look) = (painting(&mut app, 1), add(&mut app, StyleLook(Arc::new(look))));
    let painted = app.world_mut().spawn((splats.clone(), StyleSource::image(image))).id();
    app.update();
    let with_look = app.world_mut().spawn((splats, StyleSource::look(look))).id();
    let begun = Instant::now();
    update_until(&mut app, "the look", |world| world.get::<AppliedStyle>(with_look).is_some());
    eprintln!("the look came after {:.1?}", begun.elapsed());
    assert!(app.world().get::<AppliedStyle>(painted).is_none(), "the look waited for the painting");
}

#[test]
fn files_do_not_wait_for_a_games_own_tasks() {
    let dir = tempfile::tempdir().unwrap();
    let scene = raw(60);
    let look = Look::new(&scene, &scene.base_colors(), MadeFrom::default());
    write_look(&dir.path().join("a.look.safetensors"), &look).unwrap();
    let mut mask = Mask::new(60);
    mask.weights[0] = [255; 4];
    write_mask(&dir.path().join("a.mask.safetensors"), &StoredMask::new(&scene, &mask)).unwrap();
    let mut app =
        app_with_assets(AssetPlugin { file_path: dir.path().to_string_lossy().into(), ..default() });
    let _pool = busy_pool();
    let assets = app.world().resource::<AssetServer>().clone();
    let look: Handle<StyleLook> = assets.load("a.look.safetensors");
    let mask: Handle<SavedMask> = assets.load("a.mask.safetensors");
    update_until(&mut app, "a look and a mask", |world| {
        let (looks, masks) = (world.resource::<Assets<StyleLook>>(), world.resource::<Assets<SavedMask>>());
        looks.get(&look).is_some() && masks.get(&mask).is_some()
    });
}

#[test]
fn pins_and_looks_wait_neither_for_a_games_own_tasks_nor_for_a_painting() {
    let mut app = app_without_rendering();
    let scene = raw(150);
    let pin = StylePin { at: scene.means[7], place: Vec2::new(0.3, 0.6), painting: 0 };
    let look = Look::new(&scene, &scene.base_colors(), MadeFrom::default());
    let look = add(&mut app, StyleLook(Arc::new(look)));
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let source = StyleSource::image(painting(&mut app, 1));
    let painted = app.world_mut().spawn((splats.clone(), source.clone())).id();
    until_applied(&mut app);
    let (_pool, _painting) = (busy_pool(), busy_lane(&app, Lane::Styles));
    set(&mut app, painted, source.with_pins(vec![pin]));
    assert_eq!(until_applied(&mut app)[0].entity, painted);
    let with_look = app.world_mut().spawn((splats, StyleSource::look(look))).id();
    assert_eq!(until_applied(&mut app)[0].entity, with_look);
}

#[test]
fn first_colors_of_a_large_scene_wait_for_no_task_and_hold_up_no_frame() {
    let mut app = app_without_rendering();
    let splats = GaussianSplats(add_scene(&mut app, raw(150_000)));
    let source = StyleSource::image(painting(&mut app, 1));
    // Nothing is painted meanwhile.
    let (_pool, _painting) = (busy_pool(), busy_lane(&app, Lane::Styles));
    let before = busy_lane(&app, Lane::Short);
    app.world_mut().spawn((splats, source));
    for _ in 0..20 {
        app.update();
        assert!(drain::<StyleRecolored>(&mut app).is_empty(), "a frame waited for them");
    }
    drop(before);
    update_until(&mut app, "first colors", |world| {
        world.resource_mut::<Messages<StyleRecolored>>().drain().count() > 0
    });
}

/// Time until the threads of a lane are free.
fn until_free(app: &App, lane: Lane) -> Duration {
    let begun = Instant::now();
    let next = app.world().resource::<Workers>().start(lane, |_| Ok(()));
    block_on(next.wait()).unwrap();
    begun.elapsed()
}

#[test]
fn a_despawned_entitys_painting_is_painted_no_further() {
    let mut app = app_without_rendering();
    // Its surface alone takes several times as long as the test does.
    let demo = demo();
    let n = demo.len() as u32;
    let large = demo.subset(&(0..300_000).map(|i| i % n).collect::<Vec<_>>());
    let splats = GaussianSplats(add_scene(&mut app, large));
    let image = painting(&mut app, 1);
    let entity = app.world_mut().spawn((splats, StyleSource::image(image))).id();
    let mut seen = Vec::new();
    update_until(&mut app, "a part of it", |world| {
        seen.extend(world.get::<StyleProgress>(entity).and_then(|progress| progress.style));
        seen.last().is_some_and(|share| *share > 0.05)
    });
    assert!(seen.is_sorted(), "{seen:?}");
    app.world_mut().despawn(entity);
    app.update();
    let stopped = until_free(&app, Lane::Styles);
    eprintln!("stopped after {stopped:.1?}");
    assert!(stopped < STOPS, "{stopped:?}");
}

#[test]
#[cfg(all(feature = "bundled_models", feature = "refine"))]
fn a_bake_that_is_not_wanted_any_more_stops() {
    use crate::style::StyleRefine;

    let mut app = app_without_rendering();
    let splats = GaussianSplats(add_scene(&mut app, demo()));
    let image = painting(&mut app, 1);
    let entity = app.world_mut().spawn((splats, StyleSource::image(image), StyleRefine::default())).id();
    update_until(&mut app, "a bake", |world| {
        world
            .get::<StyleProgress>(entity)
            .and_then(|progress| progress.refine)
            .is_some_and(|share| share > 0.0)
    });
    app.world_mut().entity_mut(entity).remove::<StyleRefine>();
    app.update();
    let stopped = until_free(&app, Lane::Bakes);
    eprintln!("stopped after {stopped:.1?}");
    assert!(stopped < STOPS, "{stopped:?}");
    app.update();
    assert!(app.world().get::<StyleProgress>(entity).is_none());
}

#[test]
fn a_scene_whose_handle_is_dropped_is_read_no_further() {
    let dir = tempfile::tempdir().unwrap();
    // Its neighbors alone take longer to find than the test waits.
    let large = Scene { neighbors: None, ..small_scene(400_000, 1) };
    write_scene(&dir.path().join("large.sgs"), &large).unwrap();
    drop(large);
    let mut app =
        app_with_assets(AssetPlugin { file_path: dir.path().to_string_lossy().into(), ..default() });
    let handle: Handle<GaussianScene> = app.world().resource::<AssetServer>().load("large.sgs");
    update_until(&mut app, "a part of it", |world| {
        world.resource::<SceneReadings>().progress(&handle).is_some_and(|share| share > 0.0)
    });
    drop(handle);
    (0..3).for_each(|_| app.update());
    let stopped = until_free(&app, Lane::Scenes);
    eprintln!("stopped after {stopped:.1?}");
    assert!(stopped < STOPS, "{stopped:?}");
    assert_eq!(app.world().resource::<Assets<GaussianScene>>().len(), 0);
}

/// A scene is replaced while it is prepared to be painted, and the next one is a long time on its way.
#[test]
fn a_scene_that_is_on_its_way_out_is_not_painted() {
    let mut app = app_without_rendering();
    // Its surface takes far longer than an update.
    let splats = GaussianSplats(add_scene(&mut app, raw(20_000)));
    let image = painting(&mut app, 1);
    let entity = app.world_mut().spawn((splats, StyleSource::image(image))).id();
    update_until(&mut app, "a part of its surface", |world| {
        world
            .get::<StyleProgress>(entity)
            .and_then(|progress| progress.style)
            .is_some_and(|share| share > 0.0)
    });
    let next = Arc::new(OnceCell::new());
    let coming = Arc::clone(&next);
    let load = async move { Ok::<GaussianScene, Infallible>(GaussianScene::clone(coming.wait().await)) };
    let splats = GaussianSplats(app.world().resource::<AssetServer>().add_async(load));
    app.world_mut().entity_mut(entity).insert(splats);
    // The surface ends, and a painting would follow it.
    for _ in 0..2 {
        (0..3).for_each(|_| app.update());
        until_free(&app, Lane::Styles);
    }
    (0..3).for_each(|_| app.update());
    assert!(app.world().get::<AppliedStyle>(entity).is_none(), "the scene before was painted");
    assert!(next.try_set(GaussianScene::new(raw(60))).is_ok());
    update_until(&mut app, "the next scene's style", |world| world.get::<AppliedStyle>(entity).is_some());
    assert_eq!(app.world().get::<AppliedStyle>(entity).unwrap().scene.len(), 60);
}

/// A scene that can have no style is replaced while the next one is on its way: the style is that of the next
/// scene, and no failure is told.
#[test]
fn a_scene_that_is_on_its_way_out_does_not_fail() {
    let dir = tempfile::tempdir().unwrap();
    write_scene(&dir.path().join("next.sgs"), &small_scene(400, 2)).unwrap();
    let mut app =
        app_with_assets(AssetPlugin { file_path: dir.path().to_string_lossy().into(), ..default() });
    // It cannot be decoded, and the preset carries no paint.
    let raw = Scene { features: None, decoder: None, ..small_scene(300, 1) };
    let splats = GaussianSplats(add_scene(&mut app, raw));
    let entity = app.world_mut().spawn((splats, StyleSource::none())).id();
    app.update();
    let next = app.world().resource::<AssetServer>().load("next.sgs");
    let style = add_style(&mut app, small_style(1));
    app.world_mut().entity_mut(entity).insert((GaussianSplats(next), StyleSource::preset(style)));
    let failed = AtomicBool::new(false);
    update_until(&mut app, "the next scene's style", |world| {
        failed.fetch_or(world.resource_mut::<Messages<crate::StyleFailed>>().drain().count() > 0, Relaxed);
        world.get::<AppliedStyle>(entity).is_some()
    });
    assert!(!failed.load(Relaxed), "a failure of the scene before it was told");
}

/// Whether the render world can draw what an entity shows.
fn can_be_drawn(app: &App, entity: Entity) -> bool {
    let Some(shown) = app.world().get::<LoadedScene>(entity) else { return false };
    app.sub_app(RenderApp).world().resource::<GpuScenes>().get(shown).is_some()
}

/// An app that compiles and uploads in the background, the image of its camera, and an entity that shows a
/// scene.
fn app_in_background() -> Option<(App, Handle<Image>, Entity)> {
    let mut app = app_without_splats(WgpuSettings::default())?;
    app.insert_resource(QUICK_THREADS).add_plugins(StyleGaussianPlugin::default());
    let mut app = finish(app);
    let image = render_target(&mut app, UVec2::splat(16));
    app.world_mut().spawn((
        Camera3d::default(),
        Camera { clear_color: Color::BLACK.into(), ..default() },
        target(&image),
        Transform::from_xyz(0.0, 3.9, 9.7).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    let splats = GaussianSplats(add_scene(&mut app, raw(64)));
    let entity = app.world_mut().spawn(splats).id();
    Some((app, image, entity))
}

#[test]
fn an_entity_shows_its_scene_until_the_gpu_has_the_next() {
    let Some((mut app, _, entity)) = app_in_background() else { return };
    for _ in 0..1000 {
        app.update();
        if can_be_drawn(&app, entity) {
            break;
        }
    }
    let demo = demo();
    // Another scene, and then another version of it under the same handle.
    let next = add_scene(&mut app, demo.clone());
    app.world_mut().entity_mut(entity).insert(GaussianSplats(next.clone()));
    for n in [demo.len(), demo.len() - 1] {
        let mut n_updates = 0;
        while app.world().get::<LoadedScene>(entity).unwrap().scene().len() != n {
            n_updates += 1;
            assert!(n_updates < 100_000, "the next scene never came");
            app.update();
            assert!(can_be_drawn(&app, entity), "nothing was drawn after {n_updates} updates");
        }
        assert!(n_updates > 1, "it came within a frame, so nothing was seen");
        let smaller = demo.subset(&(1..demo.len() as u32).collect::<Vec<_>>());
        app.world_mut()
            .resource_mut::<Assets<GaussianScene>>()
            .insert(&next, GaussianScene::new(smaller))
            .unwrap();
    }
}

#[test]
fn a_painted_scene_is_seen_until_the_gpu_has_the_next() {
    // Its pipelines are compiled there.
    let _alone = alone_on_the_pool();
    let Some((mut app, image, entity)) = app_in_background() else { return };
    let light = |app: &App| -> f32 {
        read_back(app, &image).iter().map(|pixel| pixel[..3].iter().sum::<f32>()).sum()
    };
    let source = StyleSource::image(painting(&mut app, 1));
    app.world_mut().entity_mut(entity).insert(source);
    update_until(&mut app, "a painting", |world| world.get::<AppliedStyle>(entity).is_some());
    app.update();
    let painted = light(&app);
    assert!(painted > 0.1, "nothing is seen of the painting");
    let demo = demo();
    let n = demo.len();
    let next = add_scene(&mut app, demo);
    app.world_mut().entity_mut(entity).insert(GaussianSplats(next));
    let (begun, mut n_before, mut n_updates) = (Instant::now(), 0, 0);
    // Until the next one is painted too.
    while app.world().get::<AppliedStyle>(entity).is_none_or(|style| style.scene.len() != n) {
        assert!(begun.elapsed() < Duration::from_secs(60), "the next scene was never painted");
        app.update();
        n_updates += 1;
        let seen = light(&app);
        if app.world().get::<LoadedScene>(entity).unwrap().scene().len() == n {
            assert!(seen > 0.1, "nothing was seen after {n_updates} updates");
        } else {
            n_before += 1;
            let change = (seen - painted).abs();
            assert!(change < 0.01 * painted, "{seen} after {n_updates} updates, {painted} before");
        }
    }
    assert!(n_before > 0, "it came within a frame, so nothing was seen");
}

/// Times of frames of the demo scene, turning, at rest and while a painting is laid on: of the captured scene
/// and of a painted one, whose frames take longer. And the longest wait of a game's own task.
#[test]
#[ignore = "a measurement, which other programs on the machine disturb"]
fn frames_beside_paintings() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    // As in a game. Other tests paint faster, and at the cost of frames.
    app.insert_resource(StyleThreads::default());
    let target_image = render_target(&mut app, UVec2::new(640, 360));
    let view = Transform::from_xyz(0.0, 3.9, 9.7).looking_at(Vec3::ZERO, Vec3::Y);
    app.world_mut().spawn((Camera3d::default(), Msaa::Off, target(&target_image), view));
    let splats = GaussianSplats(add_scene(&mut app, demo()));
    let entity = app.world_mut().spawn((splats, StyleSource::none())).id();
    let (mut n_frames, mut n_paintings) = (0, 0);
    let mut kinds = ["captured", "captured, while painted", "painted", "painted, while painted anew"]
        .map(|kind| (kind, Vec::<f32>::new(), Duration::ZERO));
    for round in 0..9 {
        for (i, (_, times, waited)) in kinds.iter_mut().enumerate() {
            let is_painted = i % 2 == 1;
            if i == 0 {
                *app.world_mut().get_mut(entity).unwrap() = StyleSource::none();
            }
            if is_painted {
                n_paintings += 1;
                let image = painting(&mut app, n_paintings);
                *app.world_mut().get_mut(entity).unwrap() = StyleSource::image(image);
            }
            let begun = Instant::now();
            drain::<crate::StyleApplied>(&mut app);
            loop {
                n_frames += 1;
                let mut turned = app.world_mut().get_mut::<Transform>(entity).unwrap();
                turned.rotation = Quat::from_rotation_y(0.01 * n_frames as f32);
                let start = Instant::now();
                let task = AsyncComputeTaskPool::get().spawn(async move { start.elapsed() });
                app.update();
                let time = start.elapsed().as_secs_f32() * 1e3;
                let wait = block_on(task);
                // Pipelines are compiled and the scene is prepared in the first round.
                if round > 0 {
                    times.push(time);
                    *waited = (*waited).max(wait);
                }
                let is_over = match is_painted {
                    true => !drain::<crate::StyleApplied>(&mut app).is_empty(),
                    false => begun.elapsed() > Duration::from_secs(2),
                };
                if is_over {
                    break;
                }
            }
        }
    }
    for (kind, mut times, waited) in kinds {
        times.sort_by(f32::total_cmp);
        let [median, p99] = [times.len() / 2, times.len() * 99 / 100].map(|i| times[i]);
        eprintln!(
            "{kind}: {} frames, median {median:.1} ms, p99 {p99:.1} ms; a game's task waited {waited:.1?} at \
             most",
            times.len()
        );
    }
}
