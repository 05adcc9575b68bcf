//! The style pass in an app: its results, the number of its runs, and the memory that it leaves behind.

use std::path::Path;

use bevy::{
    prelude::*,
    render::{
        RenderApp,
        renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use stylegaussian::{Look, Scene, fold, look::MadeFrom};
use stylegaussian_files::{read_scene, read_style, write_look};
use stylegaussian_gpu::splat::CloudColors;

use crate::{
    AppliedStyle, GaussianScene, GaussianSplats, StyleApplied, StyleSource, StyleTransition,
    colors::ShownColors,
    loader::FromFile,
    style::{
        StyleLook,
        decoder::{StyleBackend, StyleBudget},
        make::job::{StyleJob, StyleJobs},
        pass::StylePasses,
        wish::decoder::choose_decoder,
    },
    tests::world::{rendering::*, *},
    work::{Lane, Workers},
};

/// The colors of an entity on the GPU.
fn shown(app: &App, entity: Entity) -> Option<Vec<[f32; 3]>> {
    let world = app.sub_app(RenderApp).world();
    let (device, queue) = (world.resource::<RenderDevice>(), world.resource::<RenderQueue>());
    let colors = world.resource::<ShownColors>().shown(MainEntity::from(entity))?;
    Some(colors.read(device.wgpu_device(), queue).unwrap())
}

fn until_applied(app: &mut App) -> StyleApplied {
    let mut applied = Vec::new();
    update_until(app, "StyleApplied", |world| {
        applied.extend(world.resource_mut::<Messages<StyleApplied>>().drain());
        !applied.is_empty()
    });
    applied.remove(0)
}

fn n_passes(app: &App) -> u64 {
    // The first frame makes the resource.
    app.sub_app(RenderApp).world().get_resource::<StylePasses>().map_or(0, |passes| passes.n_decoded)
}

fn until_passes(app: &mut App, n: u64) {
    let start = std::time::Instant::now();
    while n_passes(app) != n {
        assert!(
            start.elapsed().as_secs() < 60,
            "not within a minute: {n} style passes, found {}",
            n_passes(app)
        );
        app.update();
        // Leaves the cores to the task that is waited for.
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

fn largest_difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// The bundled decoder on real features: every 64th Gaussian of the demo scene.
#[test]
fn gpu_matches_cpu() {
    let Some(mut app) = app_with_rendering(StyleBackend::Gpu) else { return };
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let demo = read_scene(&assets.join("demo.sgs")).unwrap().scene;
    let scene = demo.subset(&(0..demo.len() as u32).step_by(64).collect::<Vec<_>>());
    let style = read_style(&assets.join("styles/mosaic.style.safetensors")).unwrap();

    let preset = add_style(&mut app, style.clone());
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(preset).with_content(0.1))).id();
    let applied = until_applied(&mut app);
    assert_eq!((applied.entity, applied.backend), (entity, StyleBackend::Gpu));
    assert_eq!(n_passes(&app), 1);

    // The component holds an f32, and this has to be the same number.
    let content = f64::from(0.1_f32);
    let map = fold::transfer(scene.features.as_ref().unwrap(), &[(&style, 1.0)], content).unwrap();
    let expected = fold::stylize(&scene, &choose_decoder(None, None).unwrap(), &map).unwrap();
    let values = expected.as_flattened();
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt();
    assert!(deviation >= 0.1, "the colors hardly differ: {deviation}");
    let found = shown(&app, entity).unwrap();
    let error = largest_difference(&found, &expected);
    eprintln!("{} Gaussians, deviation {deviation:.3}, error {error:.1e}", scene.len());
    // Activations and colors are stored as f16, whose step at 1 is 1e-3.
    assert!(error < 2e-3, "{error}");
    // Whoever has the scene can decode it elsewhere.
    let (decoder, map) = app.world().get::<AppliedStyle>(entity).unwrap().decoded().unwrap();
    assert!(largest_difference(&fold::stylize(&scene, decoder, map).unwrap(), &expected) < 1e-4);
}

/// The GPU code is slower on a software adapter than the CPU's own decoder.
#[test]
fn auto_leaves_software_adapters_alone() {
    let Some(mut app) = app_with_rendering(StyleBackend::Auto) else { return };
    let is_software = stylegaussian_gpu::device::is_software(app.world().resource::<RenderAdapterInfo>());
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(20, 1)));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style))).id();
    let expected = if is_software { StyleBackend::Cpu } else { StyleBackend::Gpu };
    assert_eq!(until_applied(&mut app).backend, expected);
    app.update();
    assert_eq!(shown(&app, entity).map(|colors| colors.len()), Some(20));
    assert_eq!(n_passes(&app), u64::from(!is_software));
}

/// A look of 300,000 Gaussians is parsed and matched to its scene on threads, and its colors are uploaded as
/// they are. The longest frame is printed and not bounded: other programs on the machine make frames longer.
#[test]
fn a_large_look_is_shown_without_a_pass() {
    let dir = tempfile::tempdir().unwrap();
    let Some(mut app) = app_with_rendering(StyleBackend::Gpu) else { return };
    let scene = Scene { features: None, decoder: None, ..small_scene(300_000, 1) };
    let exact: Vec<_> = scene.means.iter().map(|mean| mean.to_array()).collect();
    let path = dir.path().join("a.look.safetensors");
    write_look(&path, &Look::new(&scene, &exact, MadeFrom::default())).unwrap();
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let entity = app.world_mut().spawn((splats, StyleSource::none())).id();
    for _ in 0..10 {
        app.update();
    }
    let mut longest = Vec::new();
    for _ in 0..5 {
        let (path, server) = (path.clone(), app.world().resource::<AssetServer>().clone());
        let load = move || server.add(StyleLook::from_file(std::fs::read(&path).unwrap(), "a.look").unwrap());
        let loading = app.world().resource::<Workers>().start(Lane::Short, move |_| Ok(load()));
        let mut frames = Vec::new();
        update_until(&mut app, "StyleApplied", |world| {
            frames.push(std::time::Instant::now());
            let is_none = world.get::<StyleSource>(entity).unwrap().is_none();
            if let Some(Ok(look)) = loading.get().filter(|_| is_none) {
                *world.get_mut::<StyleSource>(entity).unwrap() = StyleSource::look(look.clone());
            }
            world.resource_mut::<Messages<StyleApplied>>().drain().count() > 0
        });
        // The frames in which it is uploaded, and one after it.
        for _ in 0..2 {
            app.update();
            frames.push(std::time::Instant::now());
        }
        // `update_until` sleeps for a millisecond between updates.
        let frame = |pair: &[std::time::Instant]| (pair[1] - pair[0]).as_secs_f32() * 1e3 - 1.0;
        longest.push(frames.windows(2).map(frame).fold(0.0, f32::max));
        let found = shown(&app, entity).unwrap();
        assert!(
            largest_difference(&found, &exact) < 0.5 * 2.0 / 255.0 + 1e-3,
            "half a step, and that of f16"
        );
        *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::none();
        until_applied(&mut app);
    }
    eprintln!("the longest frame while a look of 300,000 Gaussians is loaded and shown: {longest:.1?} ms");
    assert_eq!(n_passes(&app), 0, "nothing is decoded");
}

#[test]
fn only_changes_run_the_style_pass() {
    let Some(mut app) = app_with_rendering(StyleBackend::Gpu) else { return };
    let styles = [1, 2].map(|seed| add_style(&mut app, small_style(seed)));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(100, 1)));
    let sources = styles.clone().map(StyleSource::preset);
    let [a, b] = sources.clone().map(|source| app.world_mut().spawn((splats.clone(), source)).id());
    until_passes(&mut app, 2);
    for _ in 0..3 {
        app.update();
    }
    // The same scene twice, in different colors.
    let (in_a, in_b) = (shown(&app, a).unwrap(), shown(&app, b).unwrap());
    assert!(largest_difference(&in_a, &in_b) > 0.01);

    // Neither time nor movement runs it.
    // The transform is extracted in each of these frames, so change detection has something to ignore.
    for step in 0..20 {
        app.world_mut().get_mut::<Transform>(a).unwrap().translation.x = step as f32;
        app.update();
    }
    assert_eq!(n_passes(&app), 2);

    // A style that another entity shows is there already, and so is one that was shown a moment ago.
    for source in [&sources[1], &sources[0], &sources[1]] {
        *app.world_mut().get_mut::<StyleSource>(a).unwrap() = source.clone();
        until_applied(&mut app);
    }
    assert_eq!(n_passes(&app), 2);
    assert_eq!(shown(&app, a).unwrap(), shown(&app, b).unwrap());

    *app.world_mut().get_mut::<StyleSource>(a).unwrap() = StyleSource::none();
    for _ in 0..5 {
        app.update();
    }
    assert!(shown(&app, a).is_none());
    assert_eq!(n_passes(&app), 2);
}

/// With a budget of zero, each frame decodes 128 Gaussians of a layer. Two entities that share a scene change
/// one after the other if they want different styles, and the old colors stay until all of the new ones are
/// complete.
#[test]
fn a_change_is_spread_over_frames() {
    let Some(mut app) = app_with_rendering(StyleBackend::Gpu) else { return };
    let styles = [1, 2, 3].map(|seed| add_style(&mut app, small_style(seed)));
    let scene = small_scene(1000, 1);
    let expected = [1, 2, 3].map(|seed| {
        let map =
            fold::transfer(scene.features.as_ref().unwrap(), &[(&small_style(seed), 1.0)], 0.0).unwrap();
        fold::stylize(&scene, scene.decoder.as_ref().unwrap(), &map).unwrap()
    });
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let sources = styles.map(StyleSource::preset);
    let entities = [(); 2].map(|()| app.world_mut().spawn((splats.clone(), sources[0].clone())).id());
    until_passes(&mut app, 1);
    for _ in 0..5 {
        app.update();
    }

    app.insert_resource(StyleBudget { ms_per_frame: 0.0 });
    for (entity, source) in entities.into_iter().zip(&sources[1..]) {
        *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = source.clone();
    }
    // Each entity needs a frame per tile of a layer, and a few before the folded weights are available.
    let mut frames_of_each_count = [0; 3];
    let mut is_new = [false; 2];
    while is_new != [true; 2] {
        if let Some(n) = frames_of_each_count.get_mut(n_passes(&app) as usize - 1) {
            *n += 1;
        }
        app.update();
        for i in 0..2 {
            let found = shown(&app, entities[i]).unwrap();
            let [old, new] = [0, i + 1].map(|style| largest_difference(&expected[style], &found));
            assert!(old.min(new) < 2e-3, "neither the one look nor the other: {old}, {new}");
            is_new[i] = new < 2e-3;
        }
        let n_new = is_new.into_iter().filter(|new| *new).count() as u64;
        assert!(n_new < n_passes(&app));
    }
    eprintln!("frames: {frames_of_each_count:?}");
    // 1,000 Gaussians are 8 tiles of 128 in each of three layers, so about 24 frames. Two thirds of that are
    // asked for.
    assert!(frames_of_each_count[..2].iter().all(|&n| n >= 16), "{frames_of_each_count:?}");

    // A style that is no longer wanted is dropped halfway, and the scene is free for the other entity.
    let [dropped, kept] = [0.5, 0.25].map(|content| sources[0].clone().with_content(content));
    for (entity, source) in entities.into_iter().zip([dropped, kept]) {
        *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = source;
        for _ in 0..6 {
            app.update();
        }
    }
    *app.world_mut().get_mut::<StyleSource>(entities[0]).unwrap() = StyleSource::none();
    until_passes(&mut app, 4);
    for _ in 0..3 {
        app.update();
    }
    assert!(shown(&app, entities[0]).is_none());
    assert!(largest_difference(&expected[2], &shown(&app, entities[1]).unwrap()) > 2e-3);
    app.world_mut().despawn(entities[0]);
    for _ in 0..30 {
        app.update();
    }
    assert_eq!(n_passes(&app), 4);
}

/// A thousand changes that come faster than they complete, on both backends, with fades and with a budget: the
/// last one stays, and the device's memory stops growing.
#[test]
fn a_thousand_changes_leave_nothing_behind() {
    let cases = [
        (StyleBackend::Gpu, false, f32::INFINITY),
        // With a budget of zero, styles are dropped halfway.
        (StyleBackend::Gpu, false, 0.0),
        (StyleBackend::Cpu, true, f32::INFINITY),
    ];
    for (backend, fades, ms_per_frame) in cases {
        let Some(mut app) = app_with_rendering(backend) else { return };
        app.insert_resource(StyleBudget { ms_per_frame });
        let image = render_target(&mut app, UVec2::splat(8));
        app.world_mut().spawn((Camera3d::default(), target(&image), Transform::from_xyz(0.0, 0.0, 5.0)));
        let styles: Vec<_> = (0..5).map(|seed| add_style(&mut app, small_style(seed))).collect();
        let splats = GaussianSplats(add_scene(&mut app, small_scene(64, 1)));
        let entity = app.world_mut().spawn((splats, StyleSource::none())).id();
        if fades {
            let duration = std::time::Duration::from_millis(1);
            app.world_mut().entity_mut(entity).insert(StyleTransition::fade(duration));
        }
        // A number of its own for each change: a style that was shown a moment ago would be there already.
        let content = std::cell::Cell::new(0.0_f32);
        let change = |app: &mut App, to: usize| {
            content.set(content.get() + 1.0 / 4096.0);
            *app.world_mut().get_mut::<StyleSource>(entity).unwrap() =
                StyleSource::preset(styles[to].clone()).with_content(content.get());
        };
        let settle = |app: &mut App, to: usize| {
            // Wait for the colors themselves: `StyleApplied` may be of an earlier change.
            change(app, to);
            let goal = {
                let (scene, style) = (small_scene(64, 1), small_style(to as u64));
                let content = f64::from(content.get());
                let map =
                    fold::transfer(scene.features.as_ref().unwrap(), &[(&style, 1.0)], content).unwrap();
                fold::stylize(&scene, scene.decoder.as_ref().unwrap(), &map).unwrap()
            };
            let start = std::time::Instant::now();
            let is_settled = |app: &App| {
                app.world().get::<StyleJobs>(entity).unwrap().of_scene.iter().all(StyleJob::is_settled)
            };
            // Not the colors alone: these may be shown while an older style is still under way.
            app.update();
            while !is_settled(app)
                || !shown(app, entity).is_some_and(|found| largest_difference(&found, &goal) < 2e-3)
            {
                assert!(start.elapsed().as_secs() < 60, "the last look is not shown");
                app.update();
            }
            for _ in 0..5 {
                app.update();
                allocations(app);
            }
        };
        // A few styles are kept for the one who comes back to them: more than that are shown before memory is
        // compared.
        app.update();
        (0..10).for_each(|to| settle(&mut app, to % 5));
        let mut next = numbers(1);
        let mut change_at_random = |app: &mut App| {
            change(app, ((next() + 1.0) * 2.5) as usize % 5);
            if next() > 0.5 {
                app.update();
                // One frame in flight at a time, since wgpu keeps buffers for each.
                allocations(app);
            }
        };
        // Pools of wgpu and of timestamps hold as many buffers as were ever in flight at once, and on a busy
        // machine it takes some hundreds of changes until that many are.
        let mut after_500 = || {
            (0..500).for_each(|_| change_at_random(&mut app));
            settle(&mut app, 3);
            allocations(&app)
        };
        let mut found = vec![after_500(), after_500()];
        while found.len() < 5 && found[found.len() - 1] != found[found.len() - 2] {
            found.push(after_500());
        }
        eprintln!("{backend:?}, {ms_per_frame} ms: after each 500 changes {found:?}");
        if found[0].is_none() {
            eprintln!("SKIPPED: the device does not report its allocations");
            continue;
        }
        assert_eq!(found[found.len() - 2], found[found.len() - 1], "memory grows with changes");
    }
}

/// A scene that replaces a styled one is shown in its captured colors at once: the old colors belong to other
/// Gaussians.
#[test]
fn another_scene_does_not_fade_from_the_last() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(20, 1)));
    let handle = splats.0.clone();
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style))).id();
    until_applied(&mut app);
    app.update();
    let duration = std::time::Duration::from_secs(60);
    app.world_mut().entity_mut(entity).insert(StyleTransition::fade(duration));
    app.update();
    // The new scene has the same number of Gaussians, so sizes give nothing away.
    let scene = GaussianScene::new(small_scene(20, 2));
    app.world_mut().resource_mut::<Assets<GaussianScene>>().insert(&handle, scene).unwrap();
    app.update();
    let world = app.sub_app(RenderApp).world();
    let colors = world.resource::<ShownColors>().get(MainEntity::from(entity));
    assert!(matches!(colors, Some(CloudColors::Captured)), "{colors:?}");
}

/// A scene without features keeps its captured colors and the app goes on.
#[test]
fn a_scene_without_features_is_left_alone() {
    let Some(mut app) = app_with_rendering(StyleBackend::Gpu) else { return };
    let style = add_style(&mut app, small_style(1));
    let scene = Scene { features: None, ..small_scene(20, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style))).id();
    update_until(&mut app, "StyleFailed", |world| {
        !world.resource::<Messages<crate::StyleFailed>>().is_empty()
    });
    for _ in 0..5 {
        app.update();
    }
    assert!(shown(&app, entity).is_none());
}
