//! Refining with a bake that takes no time, and once with the real one.

use std::{
    sync::{
        Arc,
        atomic::{AtomicU32, Ordering::SeqCst},
    },
    thread,
    time::{Duration, Instant},
};

use bevy::{
    asset::RenderAssetUsages,
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use stylegaussian::{Look, Scene, look::MadeFrom, work::Work};
use stylegaussian_files::{read_scene, read_style};

use super::{engine::Baking, *};
use crate::{
    GaussianSplats, StyleFailed, StyleThreads, StyleTransition,
    style::{StyleLook, decoder::StyleBackend},
    tests::world::{
        QUICK_THREADS, add, add_scene, add_style, app_without_rendering, drain,
        rendering::{app_with_rendering, render_target, target},
        small_scene, small_style, update_until,
    },
};

const N: usize = 16;

/// Record of the bakes of a test. They take as many steps as they are allowed.
#[derive(Default)]
struct Log {
    allowed: AtomicU32,
    n_begun: AtomicU32,
    n_ended: AtomicU32,
    n_steps: AtomicU32,
    n_threads: AtomicU32,
}

/// A bake whose colors are a hundredth of its steps.
struct Counting {
    log: Arc<Log>,
    colors: [[f32; 3]; N],
}

impl Baking for Counting {
    fn step(&mut self, _: &Scene, _: &Work) {
        let start = Instant::now();
        while self.log.n_steps.load(SeqCst) >= self.log.allowed.load(SeqCst) {
            assert!(start.elapsed().as_secs() < 60, "nobody allows a further step");
            thread::sleep(Duration::from_millis(1));
        }
        self.log.n_steps.fetch_add(1, SeqCst);
        self.log.n_threads.store(rayon::current_num_threads() as u32, SeqCst);
        self.colors.iter_mut().flatten().for_each(|value| *value += 0.01);
    }

    fn colors(&self) -> &[[f32; 3]] {
        &self.colors
    }

    fn strokes(&self) -> &Strokes {
        static NONE: Strokes = Strokes { seeds: Vec::new(), words: Vec::new(), textures: Vec::new() };
        &NONE
    }
}

impl Drop for Counting {
    fn drop(&mut self) {
        self.log.n_ended.fetch_add(1, SeqCst);
    }
}

fn painting() -> Image {
    let size = Extent3d { width: 8, height: 8, depth_or_array_layers: 1 };
    let pixels: Vec<u8> = (0..64).flat_map(|i| [i * 4, 255 - i * 2, (i % 8) * 30, 255]).collect();
    let usage = RenderAssetUsages::MAIN_WORLD;
    Image::new(size, TextureDimension::D2, pixels, TextureFormat::Rgba8UnormSrgb, usage)
}

/// An app whose bakes are counted, and an entity that shows a preset and is refined toward a painting in
/// `steps`.
fn app(steps: u32, n_shown: u32) -> (App, Entity, Arc<Log>) {
    let mut app = app_without_rendering();
    let log = Arc::<Log>::default();
    let begin = {
        let log = Arc::clone(&log);
        move |_: &Scene, paintings: Vec<_>, _, _: &Work| {
            assert_eq!(paintings.len(), 1);
            log.n_begun.fetch_add(1, SeqCst);
            let baking: Box<dyn Baking> = Box::new(Counting { log: Arc::clone(&log), colors: [[0.0; 3]; N] });
            Ok(baking)
        }
    };
    app.insert_resource(Engine(Arc::new(begin)));
    let paintings = vec![(add(&mut app, painting()), 1.0)];
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(N, 1)));
    let refine = StyleRefine { steps, n_shown, paintings };
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style), refine)).id();
    (app, entity, log)
}

fn colors(app: &App, entity: Entity) -> Vec<[f32; 3]> {
    app.world().get::<AppliedStyle>(entity).unwrap().colors().unwrap().to_vec()
}

fn until_refined(app: &mut App) -> StyleRefined {
    let mut refined = Vec::new();
    update_until(app, "StyleRefined", |world| {
        refined.extend(world.resource_mut::<Messages<StyleRefined>>().drain());
        !refined.is_empty()
    });
    refined.remove(0)
}

fn until(app: &mut App, what: &str, done: impl Fn(&Log) -> bool, log: &Log) {
    update_until(app, what, |_| done(log));
}

#[test]
fn better_looks_replace_the_instant_one() {
    let (mut app, entity, log) = app(6, 3);
    app.world_mut().get_mut::<StyleSource>(entity).unwrap().content = 0.25;
    until(&mut app, "a bake", |log| log.n_begun.load(SeqCst) == 1, &log);
    let instant = colors(&app, entity);
    let base = small_scene(N, 1).base_colors();
    for (allowed, steps) in [(2, 2), (5, 4), (6, 6)] {
        log.allowed.store(allowed, SeqCst);
        let refined = until_refined(&mut app);
        assert_eq!((refined.entity, refined.steps, refined.is_complete), (entity, steps, steps == 6));
        let shown = colors(&app, entity);
        assert_ne!(shown, instant);
        for (shown, base) in shown.iter().zip(&base) {
            for (shown, base) in shown.iter().zip(base) {
                let expected = 0.25 * base + 0.75 * 0.01 * steps as f32;
                assert!((shown - expected).abs() < 1e-5, "{shown}, expected {expected}");
            }
        }
    }
    assert_eq!(log.n_threads.load(SeqCst) as usize, QUICK_THREADS.count);
    until(&mut app, "the end of the bake", |log| log.n_ended.load(SeqCst) == 1, &log);
    for _ in 0..20 {
        app.update();
    }
    assert_eq!(log.n_begun.load(SeqCst), 1, "what is refined is not refined again");
}

#[test]
fn whatever_changes_the_style_cancels_its_bake() {
    type Change = fn(&mut App, Entity);
    // Whether the entity is refined anew after the change.
    let changes: [(&str, Change, bool); 6] = [
        (
            "another style",
            |app, entity| {
                let style = add_style(app, small_style(2));
                *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::preset(style);
            },
            true,
        ),
        (
            "other settings",
            |app, entity| app.world_mut().get_mut::<StyleRefine>(entity).unwrap().paintings[0].1 = 2.0,
            true,
        ),
        (
            "no style",
            |app, entity| *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::none(),
            false,
        ),
        (
            "no source",
            |app, entity| {
                app.world_mut().entity_mut(entity).remove::<StyleSource>();
            },
            false,
        ),
        (
            "no refining",
            |app, entity| {
                app.world_mut().entity_mut(entity).remove::<StyleRefine>();
            },
            false,
        ),
        (
            "no entity",
            |app, entity| {
                app.world_mut().despawn(entity);
            },
            false,
        ),
    ];
    for (name, change, is_refined_anew) in changes {
        let (mut app, entity, log) = app(100, 100);
        log.allowed.store(1, SeqCst);
        until_refined(&mut app);
        change(&mut app, entity);
        app.update();
        // The step that was under way is the last one.
        log.allowed.store(2, SeqCst);
        until(&mut app, name, |log| log.n_ended.load(SeqCst) == 1, &log);
        drain::<StyleRefined>(&mut app);
        if is_refined_anew {
            until(&mut app, name, |log| log.n_begun.load(SeqCst) == 2, &log);
        }
        log.allowed.store(3, SeqCst);
        if is_refined_anew {
            assert_eq!(until_refined(&mut app).steps, 1, "{name}");
        }
        for _ in 0..20 {
            app.update();
        }
        let n_begun = if is_refined_anew { 2 } else { 1 };
        assert_eq!(log.n_begun.load(SeqCst), n_begun, "{name}");
        assert!(log.n_steps.load(SeqCst) <= 3, "{name}");
        assert!(is_refined_anew || drain::<StyleRefined>(&mut app).is_empty(), "{name}");
    }
}

#[test]
fn better_looks_come_during_a_fade() {
    let (mut app, entity, log) = app(4, 4);
    let transition = StyleTransition::fade(Duration::from_secs(1000));
    app.world_mut().entity_mut(entity).insert(transition);
    log.allowed.store(1, SeqCst);
    until_refined(&mut app);
    let began = Instant::now();
    log.allowed.store(4, SeqCst);
    while until_refined(&mut app).steps < 4 {}
    assert!(began.elapsed() < Duration::from_secs(30), "{:?}", began.elapsed());
}

#[test]
fn what_cannot_be_refined_is_left_alone() {
    let (mut app, entity, log) = app(4, 1);
    log.allowed.store(100, SeqCst);
    until_refined(&mut app);
    let image = app.world().get::<StyleRefine>(entity).unwrap().paintings[0].0.clone();
    let look = Look::new(&small_scene(N, 1), &[[0.5; 3]; N], MadeFrom::default());
    let look = add(&mut app, StyleLook(look.into()));
    let preset = add_style(&mut app, small_style(2));
    // A look in the mix, and a preset without a painting.
    let with_look = [(StyleInput::from(look), 1.0), (preset.clone().into(), 1.0)];
    for (source, paintings) in
        [(StyleSource::mix(with_look), vec![(image, 1.0)]), (StyleSource::preset(preset), Vec::new())]
    {
        app.world_mut().get_mut::<StyleRefine>(entity).unwrap().paintings = paintings;
        *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = source;
        drain::<StyleApplied>(&mut app);
        update_until(&mut app, "StyleApplied", |world| {
            !world.resource::<Messages<StyleApplied>>().is_empty()
        });
        for _ in 0..20 {
            app.update();
        }
        assert_eq!(log.n_begun.load(SeqCst), 1);
        assert!(matches!(app.world().get::<Refinement>(entity), Some(Refinement::Idle)));
    }
}

#[test]
fn a_bake_that_fails_keeps_the_style() {
    let (mut app, entity, _) = app(4, 1);
    let begin = |_: &Scene, _: Vec<_>, _, _: &Work| Err(StyleError::Refine("no canvas".into()));
    app.insert_resource(Engine(Arc::new(begin)));
    let mut failed = Vec::new();
    update_until(&mut app, "StyleFailed", |world| {
        failed.extend(world.resource_mut::<Messages<StyleFailed>>().drain());
        !failed.is_empty()
    });
    assert_eq!(failed[0].error.to_string(), "the style cannot be refined: no canvas");
    assert_eq!(colors(&app, entity).len(), N);
}

/// On Linux, the bake's threads leave most of a busy processor to the others.
#[test]
#[cfg(target_os = "linux")]
fn bakes_run_at_a_low_priority() {
    let (mut app, _, _) = app(1, 1);
    app.insert_resource(StyleThreads::default());
    let nice = Arc::new(AtomicU32::new(0));
    let begin = {
        let nice = Arc::clone(&nice);
        move |_: &Scene, _: Vec<_>, _, _: &Work| {
            let status = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
            // The name stands in parentheses. The fields after it begin with the third, and the 19th is the
            // priority.
            let after = status.rsplit_once(") ").unwrap().1;
            nice.store(after.split(' ').nth(16).unwrap().parse().unwrap(), SeqCst);
            Err(StyleError::Refine("seen".into()))
        }
    };
    app.insert_resource(Engine(Arc::new(begin)));
    update_until(&mut app, "a bake", |_| nice.load(SeqCst) != 0);
    assert_eq!(nice.load(SeqCst), 5);
}

#[test]
fn the_real_bake_refines() {
    let (mut app, entity, _) = app(2, 1);
    app.insert_resource(Engine::default());
    let refined = until_refined(&mut app);
    assert_eq!((refined.steps, refined.is_complete), (2, true));
    let shown = colors(&app, entity);
    assert!(shown.as_flattened().iter().all(|value| value.is_finite()), "{shown:?}");
    assert_ne!(shown, small_scene(N, 1).base_colors());
}

/// Times of frames of the demo scene without and beside a bake.
#[test]
#[ignore = "a measurement, which other programs on the machine disturb"]
fn a_bake_leaves_frames_alone() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    let image = render_target(&mut app, UVec2::new(160, 120));
    let view = Transform::from_xyz(0.0, 3.9, 9.7).looking_at(Vec3::ZERO, Vec3::Y);
    app.world_mut().spawn((Camera3d::default(), target(&image), view));
    let assets = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let scene = read_scene(&assets.join("demo.sgs")).unwrap().scene;
    let style = read_style(&assets.join("styles/strokes.style.safetensors")).unwrap();
    let source = StyleSource::preset(add_style(&mut app, style));
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let entity = app.world_mut().spawn((splats, source)).id();
    update_until(&mut app, "StyleApplied", |world| !world.resource::<Messages<StyleApplied>>().is_empty());
    let medians = |app: &mut App| {
        let (mut frames, mut n_looks) = (Vec::<f32>::new(), 0);
        // Long enough for a bake's step on a slow machine and for many frames on a fast one.
        let begin = Instant::now();
        while frames.len() < 40 || begin.elapsed().as_secs_f32() < 5.0 {
            // Frames in which nothing moves are cheap.
            let mut splats = app.world_mut().get_mut::<Transform>(entity).unwrap();
            splats.rotation = Quat::from_rotation_y(0.01 * frames.len() as f32);
            let start = Instant::now();
            app.update();
            frames.push(start.elapsed().as_secs_f32() * 1e3);
            // In each frame: messages do not stay for longer than two.
            n_looks += drain::<StyleRefined>(app).len();
        }
        frames.sort_by(f32::total_cmp);
        ([frames[frames.len() / 2], frames[frames.len() * 19 / 20]], n_looks)
    };
    medians(&mut app);
    let (alone, _) = medians(&mut app);
    let paintings = vec![(add(&mut app, painting()), 1.0)];
    // A look in each step, so that frames upload some too.
    let refine = StyleRefine { steps: 100_000, n_shown: 100_000, paintings };
    app.world_mut().entity_mut(entity).insert(refine);
    until_refined(&mut app);
    let (beside, n_looks) = medians(&mut app);
    eprintln!(
        "frames, median and 95%: {alone:.1?} ms alone, {beside:.1?} ms beside a bake, {n_looks} looks shown"
    );
    assert!(n_looks > 0, "the bake has stood still");
}
