//! Styles in a painting's own paint, in apps without a renderer.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use bevy::{
    asset::RenderAssetUsages,
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use stylegaussian::{
    Look, Scene,
    look::MadeFrom,
    paint::{Canvas, Hand, Paint, Painted, Surface, lay},
    strokes::Strokes,
    work::Work,
};
use stylegaussian_encoder::paint_of;

use crate::{
    AppliedStyle, GaussianSplats, HiddenUntilStyled, StyleApplied, StyleSource, StyleThreads,
    colors::ColorLayers,
    scene::LoadedScene,
    style::{
        StyleInput, StyleLook, StyleMethod, StyleRecolored, StyleStatistics, decoder::StyleEncoder,
        has_unsettled_styles,
    },
};

use super::{
    styles::{colors, expected, until_applied, until_failed},
    world::*,
};

/// A painting of stripes.
fn stripes() -> Paint {
    let rgb: Vec<f32> =
        (0..48 * 48).flat_map(|i| [(i / 3 % 2) as f32, 0.2, (i / 48) as f32 / 48.0]).collect();
    Paint::new(48, 48, &rgb)
}

fn add_painted_style(app: &mut App) -> Handle<StyleStatistics> {
    add(app, StyleStatistics { statistics: Arc::new(small_style(1)), paint: Some(Arc::new(stripes())) })
}

/// A raw capture: no features, no decoder.
pub(super) fn raw(n: usize) -> Scene {
    Scene { features: None, decoder: None, ..small_scene(n, 1) }
}

/// The scene in a mix of paintings, by the model crate's own functions.
fn laid(scene: &Scene, paintings: &[(&Paint, f64)], content: f64) -> Painted {
    let canvases: Vec<_> =
        paintings.iter().map(|(paint, weight)| (Canvas::new(paint), f64::from(*weight as f32))).collect();
    let canvases: Vec<_> = canvases.iter().map(|(canvas, weight)| (canvas, *weight)).collect();
    let work = Work::default();
    lay(scene, &Surface::new(scene, &work).unwrap(), &canvases, &Hand::default(), content, &work).unwrap()
}

pub(super) fn strokes(app: &App, entity: Entity) -> Option<Strokes> {
    let style = app.world().get::<AppliedStyle>(entity)?;
    style.strokes().map(|strokes| Strokes::clone(strokes))
}

#[track_caller]
pub(super) fn check(app: &App, entity: Entity, expected: Painted) {
    assert_eq!(colors(app.world(), entity).unwrap(), expected.colors);
    assert_eq!(strokes(app, entity), Some(expected.strokes));
}

pub(super) fn set(app: &mut App, entity: Entity, source: StyleSource) {
    *app.world_mut().get_mut(entity).unwrap() = source;
}

/// An image of noise in two colors, of 8 bits.
pub(super) fn noise(seed: u64, a: [u8; 3], b: [u8; 3]) -> Image {
    let size = Extent3d { width: 64, height: 64, depth_or_array_layers: 1 };
    let mut next = numbers(seed);
    let pixel = |_| {
        let [r, g, b] = if next() > 0.2 { a } else { b };
        [r, g, b, 255]
    };
    let data: Vec<u8> = (0..64 * 64).flat_map(pixel).collect();
    let usage = RenderAssetUsages::MAIN_WORLD;
    Image::new(size, TextureDimension::D2, data, TextureFormat::Rgba8UnormSrgb, usage)
}

/// The paint of an image.
pub(super) fn paint(image: &Image) -> Paint {
    paint_of(&image.clone().try_into_dynamic().unwrap().into())
}

#[test]
fn a_painting_gives_its_paint_unless_a_decoder_is_wanted() {
    let mut app = app_without_rendering();
    let style = add_painted_style(&mut app);
    let scene = Scene { decoder: None, ..small_scene(200, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let source = StyleSource::preset(style).with_content(0.25);
    let entity = app.world_mut().spawn((splats, source)).id();
    until_applied(&mut app);
    check(&app, entity, laid(&scene, &[(&stripes(), 1.0)], 0.25));
    app.world_mut().get_mut::<StyleSource>(entity).unwrap().content = 0.0;
    until_applied(&mut app);
    check(&app, entity, laid(&scene, &[(&stripes(), 1.0)], 0.0));
    // Other formats hold no strokes, so their means become colors.
    let style = app.world().get::<AppliedStyle>(entity).unwrap();
    assert!(style.decoded().is_none());
    let styled = style.styled_scene().unwrap();
    let flattened = laid(&scene, &[(&stripes(), 1.0)], 0.0).flattened(&scene);
    let errors = styled.base_colors().into_iter().zip(flattened);
    assert!(errors.flat_map(|(a, b)| [0, 1, 2].map(|i| (a[i] - b[i]).abs())).all(|error| error < 1e-5));

    // No decoder of this scene's 8 channels is bundled.
    app.insert_resource(StyleMethod::Decoder);
    app.world_mut().get_mut::<StyleSource>(entity).unwrap().content = 0.5;
    until_failed(&mut app);
}

/// Any image paints any capture: there is no encoder to ask, and nothing to decode.
#[test]
fn raw_captures_are_painted_by_images_and_presets() {
    let mut app = app_without_rendering();
    let missing = app.world().resource::<AssetServer>().load("no/such.encoder.safetensors");
    app.insert_resource(StyleEncoder(missing));
    let scene = raw(150);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let image = noise(1, [250, 200, 30], [20, 40, 90]);
    let handle = add(&mut app, image.clone());
    let entity = app.world_mut().spawn((splats, StyleSource::image(handle.clone()))).id();
    until_applied(&mut app);
    check(&app, entity, laid(&scene, &[(&paint(&image), 1.0)], 0.0));

    let preset = add_painted_style(&mut app);
    let mix: [(StyleInput, f32); 2] = [(handle.clone().into(), 0.3), (preset.into(), 0.9)];
    set(&mut app, entity, StyleSource::mix(mix).with_content(0.125));
    until_applied(&mut app);
    check(&app, entity, laid(&scene, &[(&paint(&image), 0.3), (&stripes(), 0.9)], 0.125));

    // An image that changes is painted anew, and what was shown before is not kept.
    let other = noise(2, [10, 90, 200], [240, 240, 220]);
    set(&mut app, entity, StyleSource::image(handle.clone()));
    until_applied(&mut app);
    app.world_mut().resource_mut::<Assets<Image>>().insert(&handle, other.clone()).unwrap();
    until_applied(&mut app);
    check(&app, entity, laid(&scene, &[(&paint(&other), 1.0)], 0.0));

    // Wrong numbers are refused as they are for the decoder.
    for (source, part) in [
        (StyleSource::mix([(handle.clone(), -1.0)]), "mix weights"),
        (StyleSource::image(handle.clone()).with_content(1.5), "content 1.5"),
        (StyleSource::image(handle).with_content(f32::NAN), "content NaN"),
    ] {
        set(&mut app, entity, source);
        let error = until_failed(&mut app).error.to_string();
        assert!(error.contains(part), "{error}");
    }
    check(&app, entity, laid(&scene, &[(&paint(&other), 1.0)], 0.0));
}

/// A preset without paint is decoded if the scene can be, and otherwise says once what is wrong.
#[test]
fn presets_without_paint_are_decoded_or_say_so() {
    let mut app = app_without_rendering();
    let bare = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, raw(20)));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(bare.clone()))).id();
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("carries no paint") && error.contains("stylegaussian style"), "{error}");
    (0..10).for_each(|_| app.update());
    assert!(drain::<crate::StyleFailed>(&mut app).is_empty());
    // Painted at once when it is replaced by one that carries some.
    let style = StyleStatistics { statistics: Arc::new(small_style(1)), paint: Some(Arc::new(stripes())) };
    app.world_mut().resource_mut::<Assets<StyleStatistics>>().insert(&bare, style).unwrap();
    until_applied(&mut app);
    check(&app, entity, laid(&raw(20), &[(&stripes(), 1.0)], 0.0));
}

/// Strength and the knobs of strokes are shown at once: no style is computed, and no event is sent.
#[test]
fn knobs_compute_nothing() {
    let mut app = app_without_rendering();
    let style = add_painted_style(&mut app);
    let splats = GaussianSplats(add_scene(&mut app, raw(50)));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style.clone()))).id();
    until_applied(&mut app);
    app.update();
    let knobs = |app: &App| app.world().get::<ColorLayers>(entity).unwrap().knobs;
    let generation = |app: &App| app.world().get::<ColorLayers>(entity).unwrap().generation;
    let before = generation(&app);
    let source = StyleSource::preset(style);
    for (source, amount, protection, stroke_scale) in [
        (source.clone().with_paint(0.5), 0.5, 1.0, 1.0),
        (source.clone().with_protection(2.5), 1.0, 2.5, 1.0),
        (source.clone().with_stroke_scale(0.7), 1.0, 1.0, 0.7),
        (source.clone().with_paint(-1.0).with_protection(1e9).with_stroke_scale(0.0), 0.0, 10.0, 0.1),
        (source.clone().with_paint(f32::NAN).with_stroke_scale(f32::INFINITY), 1.0, 1.0, 10.0),
    ] {
        set(&mut app, entity, source);
        app.update();
        let found = knobs(&app);
        assert_eq!((found.amount, found.protection, found.stroke_scale), (amount, protection, stroke_scale));
        assert!(!has_unsettled_styles(app.world_mut()));
    }
    assert_eq!(generation(&app), before, "nothing is mixed either");
    // Half of the strength is a layer of captured colors over the style.
    set(&mut app, entity, source.with_strength(0.5));
    app.update();
    assert_eq!(app.world().get::<ColorLayers>(entity).unwrap().layers.len(), 2);
    assert!(!has_unsettled_styles(app.world_mut()) && drain::<StyleApplied>(&mut app).is_empty());
}

#[test]
fn looks_show_their_strokes_and_mix_with_paint() {
    let mut app = app_without_rendering();
    let scene = raw(60);
    let other = noise(3, [200, 30, 60], [250, 250, 240]);
    let baked = laid(&scene, &[(&paint(&other), 1.0)], 0.0);
    // Colors within what a byte holds exactly.
    let flat = vec![[0.5; 3]; 60];
    let look = Look::new(&scene, &flat, MadeFrom::default()).with_strokes(&scene, &baked.strokes);
    let look = add(&mut app, StyleLook(look.into()));
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::look(look.clone()))).id();
    until_applied(&mut app);
    check(&app, entity, Painted { colors: flat, strokes: baked.strokes.clone(), ..Painted::default() });

    let preset = add_painted_style(&mut app);
    let mix: [(StyleInput, f32); 2] = [(look.into(), 1.0), (preset.into(), 3.0)];
    set(&mut app, entity, StyleSource::mix(mix));
    until_applied(&mut app);
    let mut expected = laid(&scene, &[(&stripes(), 1.0)], 0.0);
    for color in expected.colors.as_flattened_mut() {
        *color = 0.75 * *color + 0.25 * 0.5;
    }
    expected.strokes.mix(&baked.strokes, 0.25);
    assert_eq!(strokes(&app, entity), Some(expected.strokes));
    let found = colors(app.world(), entity).unwrap();
    let errors = found.as_flattened().iter().zip(expected.colors.as_flattened());
    assert!(errors.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 1e-5);
}

/// An image that fails keeps what is shown, and one that was replaced before it came changes nothing.
#[test]
fn images_that_fail_or_come_too_late() {
    let mut app = app_without_rendering();
    let scene = raw(40);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let [first, second] = [1, 2].map(|seed| noise(seed, [250, 10, 30], [20, 40, 230]));
    let handle = add(&mut app, first.clone());
    let entity = app.world_mut().spawn((splats, StyleSource::image(handle))).id();
    until_applied(&mut app);
    let shown = || laid(&scene, &[(&paint(&first), 1.0)], 0.0);

    let missing: Handle<Image> = app.world().resource::<AssetServer>().load("no/such/painting.style.jpg");
    set(&mut app, entity, StyleSource::image(missing));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("no/such/painting"), "{error}");
    check(&app, entity, shown());

    let size = Extent3d { width: 4, height: 4, depth_or_array_layers: 1 };
    let usage = RenderAssetUsages::MAIN_WORLD;
    let floats = Image::new(size, TextureDimension::D2, vec![0; 64], TextureFormat::R32Float, usage);
    let floats = add(&mut app, floats);
    set(&mut app, entity, StyleSource::image(floats));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("cannot be read"), "{error}");
    check(&app, entity, shown());

    // The second image is wanted while the first one has not come, which comes later.
    let late = app.world().resource::<Assets<Image>>().reserve_handle();
    set(&mut app, entity, StyleSource::image(late.clone()));
    (0..3).for_each(|_| app.update());
    let handle = add(&mut app, second.clone());
    set(&mut app, entity, StyleSource::image(handle));
    app.update();
    app.world_mut().resource_mut::<Assets<Image>>().insert(&late, first.clone()).unwrap();
    until_applied(&mut app);
    (0..20).for_each(|_| app.update());
    assert!(drain::<StyleApplied>(&mut app).is_empty());
    check(&app, entity, laid(&scene, &[(&paint(&second), 1.0)], 0.0));
}

/// A painting on so many Gaussians that their surface takes far longer than their first colors.
fn large(app: &mut App) -> (GaussianSplats, StyleSource) {
    let style = add_painted_style(app);
    (GaussianSplats(add_scene(app, raw(20_000))), StyleSource::preset(style))
}

#[test]
fn the_scene_is_recolored_until_it_is_painted() {
    let mut app = app_without_rendering();
    let (splats, source) = large(&mut app);
    let plain = app.world_mut().spawn((splats.clone(), source.clone())).id();
    let hidden = app.world_mut().spawn((splats, source, HiddenUntilStyled)).id();
    let shown = |world: &World, entity| {
        world.get::<ColorLayers>(entity).map(|layers| (layers.is_hidden, layers.layers.len()))
    };
    update_until(&mut app, "first colors", |world| {
        assert!(world.get::<AppliedStyle>(plain).is_none(), "painted before the first colors");
        shown(world, plain) == Some((false, 1)) && shown(world, hidden) == Some((true, 1))
    });
    let recolored: Vec<_> = drain::<StyleRecolored>(&mut app).iter().map(|event| event.entity).collect();
    assert_eq!(recolored, [plain], "the other one is hidden");
    let mut n_applied = 0;
    while n_applied < 2 {
        n_applied += until_applied(&mut app).len();
    }
    assert_eq!([shown(app.world(), plain), shown(app.world(), hidden)], [Some((false, 1)); 2]);
    assert!(drain::<StyleRecolored>(&mut app).is_empty(), "told once");
}

/// Surfaces and canvases take hundreds of megabytes. Whatever is prepared of a scene keeps the scene's data.
#[test]
fn what_a_despawned_scene_was_painted_with_is_freed_in_the_next_frame() {
    let mut app = app_without_rendering();
    let style = add_painted_style(&mut app);
    let styles = app.world().resource::<Assets<StyleStatistics>>();
    let paint = Arc::downgrade(styles.get(&style).unwrap().paint.as_ref().unwrap());
    let splats = GaussianSplats(add_scene(&mut app, raw(50)));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style))).id();
    until_applied(&mut app);
    let scene = Arc::downgrade(app.world().get::<LoadedScene>(entity).unwrap().scene());
    app.world_mut().despawn(entity);
    // Bevy drops an asset in the frame after the one in which its last handle goes.
    (0..2).for_each(|_| app.update());
    assert!(scene.upgrade().is_none(), "something keeps the scene");
    assert!(paint.upgrade().is_none(), "something keeps the painting");
}

#[test]
fn paint_stays_until_the_same_painting_is_painted_anew() {
    let mut app = app_without_rendering();
    let painted = large(&mut app);
    let entity = app.world_mut().spawn(painted).id();
    let n_changes = |app: &App| app.world().get::<ColorLayers>(entity).map(|layers| layers.generation);
    until_applied(&mut app);
    let before = n_changes(&app).unwrap();
    app.world_mut().get_mut::<StyleSource>(entity).unwrap().content = 0.5;
    until_applied(&mut app);
    assert_eq!(n_changes(&app), Some(before + 1), "first colors came in between");
    // Another painting shows its first colors first.
    let other = add_painted_style(&mut app);
    set(&mut app, entity, StyleSource::preset(other));
    until_applied(&mut app);
    assert_eq!(n_changes(&app), Some(before + 3));
}

/// The time that is told is that since the last of several wishes: neither since the first one, nor since the
/// image of the last one came.
#[test]
fn the_last_wish_is_timed() {
    const PAUSE: Duration = Duration::from_millis(100);
    let mut app = app_without_rendering();
    let splats = GaussianSplats(add_scene(&mut app, raw(40)));
    let entity = app.world_mut().spawn((splats, StyleSource::none())).id();
    (0..3).for_each(|_| app.update());
    drain::<StyleApplied>(&mut app);
    let late = [(); 3].map(|()| app.world().resource::<Assets<Image>>().reserve_handle());
    let [mut wished, mut heard] = [Instant::now(); 2];
    for image in &late {
        wished = Instant::now();
        set(&mut app, entity, StyleSource::image(image.clone()));
        app.update();
        heard = Instant::now();
        while heard.elapsed() < PAUSE {
            app.update();
        }
    }
    let waited = heard.elapsed();
    let image = noise(1, [250, 200, 30], [20, 40, 90]);
    app.world_mut().resource_mut::<Assets<Image>>().insert(&late[2], image).unwrap();
    let applied = until_applied(&mut app);
    let (told, at_most) = (applied[0].elapsed, wished.elapsed());
    assert_eq!(applied.len(), 1);
    assert!(waited <= told && told <= at_most, "{told:?}, expected {waited:?} to {at_most:?}");
}

#[test]
fn a_scene_with_a_decoder_of_its_own_is_decoded() {
    let mut app = app_without_rendering();
    let style = add_painted_style(&mut app);
    let scene = small_scene(32, 1);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style))).id();
    until_applied(&mut app);
    assert_eq!(colors(app.world(), entity).unwrap(), expected(&scene, &[(&small_style(1), 1.0)], 0.0));
    assert_eq!(strokes(&app, entity), None);
}

/// Processor time of this process so far, which other programs hardly disturb. Zero where the system does not
/// tell.
fn processor_time() -> Duration {
    let status = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name stands in parentheses. User and system time are the 14th and 15th fields, in hundredths of a
    // second.
    let after = status.rsplit_once(") ").map_or("", |(_, after)| after);
    let ticks: u64 = after.split(' ').skip(11).take(2).filter_map(|ticks| ticks.parse::<u64>().ok()).sum();
    Duration::from_millis(10 * ticks)
}

/// Time from the last of ten wishes, a fifth of a second apart, to its paint.
fn time_of_the_last_wish(app: &mut App, entity: Entity) -> Duration {
    let images: Vec<_> = (0..10)
        .map(|i| noise(i, [20 * i as u8, 90, 200], [240, 240, 20 * i as u8]))
        .map(|image| add(app, image))
        .collect();
    let mut wished = Instant::now();
    for image in images {
        wished = Instant::now();
        set(app, entity, StyleSource::image(image));
        while wished.elapsed().as_millis() < 200 {
            app.update();
        }
    }
    while has_unsettled_styles(app.world_mut()) {
        app.update();
    }
    wished.elapsed()
}

/// Times from an image to its paint, on the demo scene and on one of 300,000 Gaussians whose surfaces are
/// known: by the clock, and of the processor.
#[test]
#[ignore = "a measurement, which other programs on the machine disturb"]
fn times_to_paint() {
    let mut app = app_without_rendering();
    let assets = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let demo = stylegaussian_files::read_scene(&assets.join("demo.sgs")).unwrap().scene;
    let demo = Scene { features: None, ..demo };
    let n = demo.len() as u32;
    let four = demo.subset(&(0..300_000).map(|i| i % n).collect::<Vec<_>>());
    for scene in [demo, four] {
        let n = scene.len();
        let splats = GaussianSplats(add_scene(&mut app, scene));
        let entity = app.world_mut().spawn((splats, StyleSource::none())).id();
        app.insert_resource(StyleThreads::default());
        (0..3).for_each(|_| app.update());
        drain::<StyleApplied>(&mut app);
        let mut times = Vec::new();
        for name in ["strokes", "mosaic", "ink", "cubist"] {
            let bytes = std::fs::read(assets.join(format!("styles/{name}.jpg"))).unwrap();
            let image = image::load_from_memory(&bytes).unwrap();
            let image = Image::from_dynamic(image, true, RenderAssetUsages::MAIN_WORLD);
            let handle = add(&mut app, image);
            let begun = (Instant::now(), processor_time());
            set(&mut app, entity, StyleSource::image(handle));
            until_applied(&mut app);
            times.push((begun.0.elapsed(), processor_time() - begun.1));
        }
        eprintln!("{n} Gaussians, the first with its surface: {times:.2?}");
        eprintln!("the last of ten wishes in two seconds: {:.2?}", time_of_the_last_wish(&mut app, entity));
        app.world_mut().despawn(entity);
    }
}
