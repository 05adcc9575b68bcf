//! Images that change while strokes show them.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use bevy::{
    asset::RenderAssetUsages,
    prelude::*,
    render::{
        RenderApp,
        render_asset::RenderAssets,
        render_resource::{Extent3d, PollType, TexelCopyBufferLayout, TextureDimension, TextureFormat},
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
        texture::GpuImage,
    },
    time::TimeUpdateStrategy,
};
use stylegaussian::{
    Scene,
    paint::{Canvas, Hand, Painted, Surface, lay, recolored, redraw},
    splat,
    strokes::{StrokeKnobs, StrokeSeed, Strokes},
    work::Work,
};

use crate::{
    AppliedStyle, GaussianSplats, StyleApplied, StyleFailed, StyleSource,
    colors::{Redrawing, ShownColors},
    style::{StyleLiving, decoder::StyleBackend, has_unsettled_styles, n_known_styles},
};

use super::{
    paint::{noise, paint},
    strokes::{Studio, distance},
    styles::{colors, until_applied, until_failed},
    world::{rendering::*, *},
};

/// Time between two changes of colors.
const EVERY: Duration = Duration::from_millis(400);

const WARM: [[u8; 3]; 2] = [[240, 190, 60], [90, 20, 30]];
const COLD: [[u8; 3]; 2] = [[60, 120, 230], [220, 240, 250]];

/// An image of noise for both worlds.
fn picture(seed: u64, [a, b]: [[u8; 3]; 2]) -> Image {
    Image { asset_usage: RenderAssetUsages::default(), ..noise(seed, a, b) }
}

fn living() -> StyleLiving {
    StyleLiving { base_colors_every: EVERY }
}

/// Replaces an image.
fn change(app: &mut App, id: impl Into<AssetId<Image>>, image: Image) {
    app.world_mut().resource_mut::<Assets<Image>>().insert(id, image).unwrap();
}

/// A picture of other sides, from the pixels of `image` in turn.
fn of_size(image: &Image, [width, height]: [u32; 2]) -> Image {
    let size = Extent3d { width, height, depth_or_array_layers: 1 };
    let pixels = image.data.as_ref().unwrap().iter().copied().cycle();
    let data = pixels.take(4 * (width * height) as usize).collect();
    let usages = RenderAssetUsages::default();
    Image::new(size, TextureDimension::D2, data, TextureFormat::Rgba8UnormSrgb, usages)
}

fn strokes(app: &App, entity: Entity) -> Arc<Strokes> {
    Arc::clone(app.world().get::<AppliedStyle>(entity).unwrap().strokes().unwrap())
}

/// A scene in a painting, by the model's own functions, and in the colors of another under the same strokes.
fn laid(scene: &Scene, first: &Image, other: &Image) -> (Painted, Vec<[f32; 3]>, Canvas) {
    let (hand, work) = (Hand::default(), Work::default());
    let surface = Surface::new(scene, &work).unwrap();
    let canvas = Canvas::new(&paint(first));
    let painted = lay(scene, &surface, &[(&canvas, 1.0)], &hand, 0.0, &work).unwrap();
    let again = canvas.reread(&paint(other));
    let paintings = [(&again, 1.0)];
    let colors = recolored(scene, &surface, &paintings, &hand, 0.0, &painted.strokes, &work).unwrap();
    (painted, colors, again)
}

/// Updates until an entity's colors are others.
fn until_recolored(app: &mut App, entity: Entity) {
    let before = colors(app.world(), entity);
    update_until(app, "other colors", |world| colors(world, entity) != before);
}

/// Without a renderer: colors follow after the interval, and not before. Strokes stay where they are.
#[test]
fn base_colors_follow_at_an_interval_and_places_stay() {
    let mut app = app_without_rendering();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_millis(1)));
    let scene = Scene { features: None, decoder: None, ..small_scene(150, 1) };
    let images = [picture(1, WARM), picture(2, COLD), picture(3, WARM)];
    let image = add(&mut app, images[0].clone());
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::image(image.clone()), living())).id();
    until_applied(&mut app);
    let first = strokes(&app, entity);
    let now = |app: &App| app.world().resource::<Time<Real>>().elapsed();
    while now(&app) < EVERY {
        app.update();
    }
    let begun = now(&app);
    for (i, other) in (1..).zip(&images[1..]) {
        change(&mut app, &image, other.clone());
        until_recolored(&mut app, entity);
        // The first change is asked for at once, and the second an interval later.
        let passed = now(&app) - begun;
        assert!(passed >= EVERY * (i - 1), "change {i} after {passed:?}");
        let (_, expected, canvas) = laid(&scene, &images[0], other);
        assert_eq!(colors(app.world(), entity).unwrap(), expected, "change {i}");
        let strokes = strokes(&app, entity);
        assert_eq!((&strokes.seeds, &strokes.words), (&first.seeds, &first.words));
        assert!(strokes.textures == [Arc::clone(canvas.texture())]);
    }
    // A style with other settings has the same places and follows as well.
    app.world_mut().get_mut::<StyleSource>(entity).unwrap().content = 0.5;
    until_applied(&mut app);
    until_recolored(&mut app, entity);
    assert_eq!(strokes(&app, entity).seeds, first.seeds);
    assert!(drain::<StyleFailed>(&mut app).is_empty());
    assert!(drain::<StyleApplied>(&mut app).is_empty(), "colors that follow are no new style");
    // Without the component, a change is a new painting.
    app.world_mut().entity_mut(entity).remove::<StyleLiving>();
    change(&mut app, &image, images[1].clone());
    until_applied(&mut app);
    assert_ne!(strokes(&app, entity).seeds, first.seeds);
}

/// A part of an image is a new painting when the image changes. In given colors, strokes are laid on anew.
#[test]
fn parts_and_given_colors_are_painted_anew() {
    let mut app = app_without_rendering();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_millis(1)));
    let scene = Scene { features: None, decoder: None, ..small_scene(150, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let image = add(&mut app, picture(1, WARM));
    let source = StyleSource::image(image.clone());
    let part = source.clone().cropped(Rect::new(0.0, 0.0, 0.5, 1.0));
    let entity = app.world_mut().spawn((splats, part, living())).id();
    until_applied(&mut app);
    let first = strokes(&app, entity);
    change(&mut app, &image, picture(2, COLD));
    until_applied(&mut app);
    assert_ne!(strokes(&app, entity).seeds, first.seeds);

    let palette = vec![Color::srgb(0.1, 0.2, 0.3), Color::srgb(0.9, 0.8, 0.2)];
    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = source.with_palette(palette);
    until_applied(&mut app);
    let first = strokes(&app, entity);
    change(&mut app, &image, picture(3, WARM));
    update_until(&mut app, "other strokes", |world| {
        world.get::<AppliedStyle>(entity).unwrap().strokes().unwrap().seeds != first.seeds
    });
    assert!(drain::<StyleApplied>(&mut app).is_empty(), "strokes that follow are no new style");
    assert!(drain::<StyleFailed>(&mut app).is_empty());
}

/// An image that shrinks or goes away leaves its last picture and one event. One that comes back is followed
/// again.
#[test]
fn an_image_that_cannot_be_followed_leaves_its_last_picture() {
    let mut app = app_without_rendering();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_millis(1)));
    let scene = Scene { features: None, decoder: None, ..small_scene(60, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let image = add(&mut app, picture(1, WARM));
    let entity = app.world_mut().spawn((splats, StyleSource::image(image.clone()), living())).id();
    until_applied(&mut app);
    let before = colors(app.world(), entity);
    change(&mut app, &image, of_size(&picture(2, COLD), [1, 1]));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("1x1") && error.contains("8x8"), "{error}");
    for _ in 0..2 * EVERY.as_millis() {
        app.update();
    }
    assert!(drain::<StyleFailed>(&mut app).is_empty());
    assert_eq!(colors(app.world(), entity), before);

    app.world_mut().resource_mut::<Assets<Image>>().remove(&image);
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("removed"), "{error}");
    for _ in 0..2 * EVERY.as_millis() {
        app.update();
    }
    assert!(drain::<StyleFailed>(&mut app).is_empty());
    assert_eq!(colors(app.world(), entity), before);

    change(&mut app, &image, picture(2, COLD));
    until_recolored(&mut app, entity);
    assert!(drain::<StyleFailed>(&mut app).is_empty());
}

/// A larger picture and a smaller one follow under the same strokes. The source keeps the image while nobody
/// else holds it.
#[test]
fn an_image_that_gets_another_size_is_followed() {
    let mut app = app_without_rendering();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(EVERY));
    let scene = Scene { features: None, decoder: None, ..small_scene(60, 1) };
    let first = picture(1, WARM);
    let image = add(&mut app, first.clone());
    let id = image.id();
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::image(image), living())).id();
    until_applied(&mut app);
    let seeds = strokes(&app, entity).seeds.clone();
    for (seed, tints, size) in [(2, COLD, [200, 90]), (3, WARM, [8, 31])] {
        let other = of_size(&picture(seed, tints), size);
        change(&mut app, id, other.clone());
        until_recolored(&mut app, entity);
        let (_, expected, _) = laid(&scene, &first, &other);
        assert_eq!(colors(app.world(), entity), Some(expected), "{size:?}");
        assert_eq!(strokes(&app, entity).seeds, seeds, "{size:?}");
    }
    assert!(drain::<StyleFailed>(&mut app).is_empty());
}

/// An image whose load fails, and one that is too small at first, are painted with and followed once they are
/// there. A load that fails later changes nothing.
#[test]
fn an_image_that_comes_after_a_failure_is_followed() {
    let mut app = app_without_rendering();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(EVERY));
    let scene = Scene { features: None, decoder: None, ..small_scene(60, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let path = "no/such/film.style.jpg";
    let image: Handle<Image> = app.world().resource::<AssetServer>().load(path);
    let entity = app.world_mut().spawn((splats, StyleSource::image(image.clone()), living())).id();
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("no/such/film"), "{error}");
    let [first, other] = [picture(1, WARM), picture(2, COLD)];
    change(&mut app, &image, of_size(&first, [1, 1]));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("1x1") && error.contains("8x8"), "{error}");
    change(&mut app, &image, first.clone());
    until_applied(&mut app);
    let (painted, expected, _) = laid(&scene, &first, &other);
    assert_eq!(colors(app.world(), entity), Some(painted.colors.clone()));
    app.world().resource::<AssetServer>().reload(path);
    for _ in 0..20 {
        app.update();
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(colors(app.world(), entity), Some(painted.colors));
    change(&mut app, &image, other);
    until_recolored(&mut app, entity);
    assert_eq!(colors(app.world(), entity), Some(expected));
    assert!(drain::<StyleFailed>(&mut app).is_empty());
}

/// Several changes in each of a hundred frames: beside the first style, the one that is shown and the one that
/// is computed, nothing is kept, and nothing waits. The last picture is shown.
#[test]
fn a_hundred_frames_of_a_video_leave_nothing_waiting() {
    let mut app = app_without_rendering();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(EVERY));
    let scene = Scene { features: None, decoder: None, ..small_scene(60, 1) };
    let first = picture(1, WARM);
    let image = add(&mut app, first.clone());
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::image(image.clone()), living())).id();
    until_applied(&mut app);
    let pictures = [(2, COLD), (3, WARM), (4, COLD)].map(|(seed, tints)| picture(seed, tints));
    let n_images = |app: &App| app.world().resource::<Assets<Image>>().len();
    let (n_before, mut most) = (n_images(&app), 0);
    for frame in 0..100 {
        for i in 0..5 {
            change(&mut app, &image, pictures[(frame + i) % 3].clone());
        }
        app.update();
        most = most.max(n_known_styles(app.world()));
    }
    assert!((2..=3).contains(&most), "{most} styles");
    let (_, expected, _) = laid(&scene, &first, &pictures[(99 + 4) % 3]);
    let expected = Some(expected);
    update_until(&mut app, "colors of the last picture", |world| colors(world, entity) == expected);
    assert!(drain::<StyleFailed>(&mut app).is_empty());
    assert_eq!(n_images(&app), n_before);
}

/// A video that is faster than frames, in which colors take longer than from frame to frame: of the pictures
/// between two frames the last counts, and colors follow all the while.
#[test]
fn a_video_that_is_faster_than_frames_is_followed() {
    let mut app = app_without_rendering();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(EVERY));
    let scene = Scene { features: None, decoder: None, ..small_scene(150, 1) };
    let first = picture(1, WARM);
    let image = add(&mut app, first.clone());
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::image(image.clone()), living())).id();
    until_applied(&mut app);
    let seeds = strokes(&app, entity).seeds.clone();
    let (mut last, mut seed, mut shown) = (first.clone(), 1, Vec::new());
    update_until(&mut app, "colors of a video", |world| {
        let mut images = world.resource_mut::<Assets<Image>>();
        for tints in [COLD, WARM] {
            seed += 1;
            last = picture(seed, tints);
            images.insert(&image, last.clone()).unwrap();
        }
        let now = colors(world, entity);
        if shown.last() != Some(&now) {
            shown.push(now);
        }
        shown.len() > 3
    });
    let (_, expected, _) = laid(&scene, &first, &last);
    let expected = Some(expected);
    update_until(&mut app, "colors of the last picture", |world| colors(world, entity) == expected);
    assert_eq!(strokes(&app, entity).seeds, seeds);
    assert!(drain::<StyleFailed>(&mut app).is_empty());
}

/// The words and seeds of the wall, and the number of textures that were made.
fn drawn(studio: &Studio) -> (Vec<u32>, Vec<StrokeSeed>, u64) {
    let world = studio.app.sub_app(RenderApp).world();
    let (device, queue) = (world.resource::<RenderDevice>(), world.resource::<RenderQueue>());
    let shown = world.resource::<ShownColors>();
    let strokes = shown.shown_strokes(MainEntity::from(studio.wall)).expect("strokes");
    let words = strokes.read_words(device.wgpu_device(), queue).unwrap();
    let seeds = strokes.read_seeds(device.wgpu_device(), queue).unwrap();
    (words, seeds, world.resource::<Redrawing>().n_redrawn)
}

/// Sets a studio's wall in a style that follows its image.
fn follow(studio: &mut Studio, image: &Handle<Image>, every: Duration) {
    let living = StyleLiving { base_colors_every: every };
    studio.app.world_mut().entity_mut(studio.wall).insert(living);
    studio.set(StyleSource::image(image.clone()));
}

#[test]
fn a_changed_image_is_drawn_in_the_same_frame() {
    let Some(mut studio) = Studio::new() else { return };
    let images = [picture(1, WARM), picture(2, WARM)];
    // Without the component, a changed image is a new painting.
    let image = add(&mut studio.app, images[1].clone());
    studio.set(StyleSource::image(image.clone()));
    studio.settle();
    change(&mut studio.app, &image, images[0].clone());
    studio.settle();
    assert_eq!(drawn(&studio).2, 0);
    follow(&mut studio, &image, Duration::from_secs(3600));
    studio.settle();
    let before = studio.next();
    let (words, seeds, n) = drawn(&studio);
    for _ in 0..5 {
        assert!(distance(&before, &studio.next()) == 0.0);
    }
    assert_eq!(drawn(&studio).2, n, "an image that does not change costs nothing");

    // Of several changes within a frame, the last is drawn, once.
    for seed in 3..8 {
        change(&mut studio.app, &image, picture(seed, COLD));
    }
    change(&mut studio.app, &image, images[1].clone());
    let after = studio.next();
    assert!(distance(&before, &after) > 5e-3, "{}", distance(&before, &after));
    assert_eq!(drawn(&studio), (words, seeds, n + 1));
    // The picture is that of the CPU: new detail over the old colors.
    let (Painted { colors, mut strokes, .. }, _, canvas) = laid(&studio.scene, &images[0], &images[1]);
    let reading = canvas.reading_size();
    strokes.textures = vec![redraw::redrawn(&paint(&images[1]), reading)];
    studio.check("another picture", splat::Colors::Rgb(&colors), &strokes, &StrokeKnobs::DEFAULT);
    assert_eq!(drawn(&studio).2, n + 1);
}

/// Writes into an image on the GPU, as a camera or a kernel would.
fn write(app: &App, handle: &Handle<Image>, of: &Image) {
    let world = app.sub_app(RenderApp).world();
    let gpu = world.resource::<RenderAssets<GpuImage>>().get(handle).expect("on the GPU");
    let size = gpu.texture_descriptor.size;
    let layout =
        TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size.width), rows_per_image: None };
    let data = of.data.as_ref().unwrap();
    world.resource::<RenderQueue>().write_texture(gpu.texture.as_image_copy(), data, layout, size);
}

/// A texture that the GPU draws is read back for its places and colors, and made anew once in each frame.
#[test]
fn a_texture_of_the_gpu_is_followed_in_each_frame() {
    let Some(mut studio) = Studio::new() else { return };
    let target = render_target(&mut studio.app, UVec2::splat(64));
    follow(&mut studio, &target, EVERY);
    for _ in 0..10 {
        studio.next();
    }
    assert!(has_unsettled_styles(studio.app.world_mut()), "nothing was drawn into it yet");
    let images = [picture(1, WARM), picture(2, COLD)];
    write(&studio.app, &target, &images[0]);
    until_applied(&mut studio.app);
    let (painted, _, _) = laid(&studio.scene, &images[0], &images[1]);
    assert_eq!(colors(studio.app.world(), studio.wall).unwrap(), painted.colors);
    assert_eq!(*strokes(&studio.app, studio.wall), painted.strokes);

    let before = studio.next();
    let n = drawn(&studio).2;
    write(&studio.app, &target, &images[1]);
    let after = studio.next();
    assert!(distance(&before, &after) > 5e-3, "{}", distance(&before, &after));
    studio.next();
    assert_eq!(drawn(&studio).2, n + 2, "once in each frame");
    until_recolored(&mut studio.app, studio.wall);
    let (_, expected, _) = laid(&studio.scene, &images[0], &images[1]);
    assert_eq!(colors(studio.app.world(), studio.wall).unwrap(), expected);
    assert!(drain::<StyleFailed>(&mut studio.app).is_empty());
}

/// Prints the time of frames of the demo scene while its image changes ten times a second, beside those in
/// which it does not.
#[test]
#[ignore = "measures time"]
fn frames_while_an_image_changes() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    app.insert_resource(crate::StyleThreads::default());
    let target_image = render_target(&mut app, UVec2::new(640, 360));
    app.world_mut().spawn((
        Camera3d::default(),
        target(&target_image),
        Msaa::Off,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    let side = 512;
    let pictures = [1_u64, 2].map(|seed| {
        let mut next = numbers(seed);
        let data = (0..side * side).flat_map(|i: u32| {
            let stripe = (i / 3 + i / side / 5) % 7 < 3;
            let light = 40.0 * next() + if stripe { 200.0 } else { 60.0 };
            [light as u8, (0.8 * light) as u8, (255.0 - light) as u8, 255]
        });
        let size = Extent3d { width: side, height: side, depth_or_array_layers: 1 };
        let format = TextureFormat::Rgba8UnormSrgb;
        let (data, usages) = (data.collect(), RenderAssetUsages::default());
        Image::new(size, TextureDimension::D2, data, format, usages)
    });
    let scene = app.world().resource::<AssetServer>().load("demo.sgs");
    let image = add(&mut app, pictures[0].clone());
    let parts = (GaussianSplats(scene), StyleSource::image(image.clone()), StyleLiving::default());
    app.world_mut().spawn(parts);
    until_applied(&mut app);
    let mut measure = |name: &str, changes: bool| {
        let (begun, mut times, mut n_changes) = (Instant::now(), Vec::new(), 0);
        while begun.elapsed() < Duration::from_secs(10) {
            let frame = Instant::now();
            if changes && begun.elapsed().as_millis() / 100 > n_changes {
                n_changes += 1;
                change(&mut app, &image, pictures[n_changes as usize % 2].clone());
            }
            app.update();
            let device = app.sub_app(RenderApp).world().resource::<RenderDevice>();
            device.poll(PollType::wait_indefinitely()).expect("the device answers");
            times.push(frame.elapsed());
        }
        times.sort();
        let (median, longest) = (times[times.len() / 2], times[times.len() - 1]);
        eprintln!("{name}: {} frames, median {median:.1?}, longest {longest:.1?}", times.len());
    };
    measure("idle", false);
    measure("the image changes ten times a second", true);
}
