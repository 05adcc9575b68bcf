//! Collections, crops, palettes and pinned places, in apps without a renderer.

use std::sync::Arc;

use bevy::{
    asset::RenderAssetUsages,
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use stylegaussian::{
    Scene,
    paint::{Canvas, Hand, Paint, Painted, Pin, StoredPins, Surface, Tints, lay},
    strokes::MAX_TEXTURES,
    work::Work,
};

use crate::{
    GaussianSplats, StyleFailed, StyleSource,
    style::{StylePin, StylePinsFile},
};

use super::{
    paint::{check, noise, paint, raw, set, strokes},
    styles::{colors, until_applied, until_failed},
    world::*,
};

/// An image of two colors, one in each column by turns.
fn columns([width, height]: [u32; 2]) -> Image {
    let size = Extent3d { width, height, depth_or_array_layers: 1 };
    let pixel = |i: u32| if (i % width).is_multiple_of(2) { [240, 200, 40, 255] } else { [20, 60, 160, 255] };
    let data = (0..width * height).flat_map(pixel).collect();
    let usages = RenderAssetUsages::MAIN_WORLD;
    Image::new(size, TextureDimension::D2, data, TextureFormat::Rgba8UnormSrgb, usages)
}

/// The scene in paintings, by the model crate's own functions.
fn laid(scene: &Scene, paintings: &[&Paint], hand: &Hand) -> Painted {
    let canvases: Vec<Canvas> = paintings.iter().map(|paint| Canvas::new(paint)).collect();
    laid_in(scene, &canvases.iter().collect::<Vec<_>>(), hand)
}

/// The same in canvases.
fn laid_in(scene: &Scene, canvases: &[&Canvas], hand: &Hand) -> Painted {
    let weighted: Vec<_> = canvases.iter().map(|&canvas| (canvas, 1.0)).collect();
    let work = Work::default();
    lay(scene, &Surface::new(scene, &work).unwrap(), &weighted, hand, 0.0, &work).unwrap()
}

#[test]
fn a_source_decides_what_the_model_is_told() {
    let mut app = app_without_rendering();
    let scene = raw(150);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let images = [noise(1, [250, 200, 30], [20, 40, 90]), noise(2, [20, 180, 60], [200, 250, 220])];
    let handles = images.each_ref().map(|image| add(&mut app, image.clone()));
    let paints = images.each_ref().map(paint);
    let entity = app.world_mut().spawn((splats, StyleSource::collection(handles.clone()))).id();
    until_applied(&mut app);
    let collection = Hand { is_collection: true, ..Hand::default() };
    check(&app, entity, laid(&scene, &[&paints[0], &paints[1]], &collection));

    let image = || StyleSource::image(handles[0].clone());
    set(&mut app, entity, image().cropped(Rect::new(0.25, 0.0, 1.0, 0.5)));
    until_applied(&mut app);
    let part = paints[0].cropped([0.25, 0.0, 1.0, 0.5]).unwrap();
    check(&app, entity, laid(&scene, &[&part], &Hand::default()));

    let colors = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let palette: Vec<Color> = colors.iter().map(|[r, g, b]| Color::srgb(*r, *g, *b)).collect();
    set(&mut app, entity, image().with_palette(palette).with_palette_strength(0.5));
    until_applied(&mut app);
    let tints = Tints::of_colors(&colors).unwrap();
    check(
        &app,
        entity,
        laid(&scene, &[&paints[0]], &Hand { tints: Some(&tints), palette: 0.5, ..Hand::default() }),
    );

    set(&mut app, entity, image().with_palette(handles[1].clone()));
    until_applied(&mut app);
    let other = Canvas::new(&paints[1]);
    check(&app, entity, laid(&scene, &[&paints[0]], &Hand { tints: Some(other.tints()), ..Hand::default() }));

    for (source, part) in [
        (image().cropped(Rect::new(0.5, 0.0, 1.5, 1.0)), "expected one of at least a pixel"),
        (image().with_palette(vec![Color::WHITE]), "found 1 colors"),
        (image().with_palette_strength(f32::NAN), "strength is NaN"),
        (image().with_pins(vec![StylePin { place: Vec2::new(0.5, 2.0), ..default() }]), "pin 1: found"),
        (image().with_pins(vec![StylePin { painting: 1, ..default() }]), "painting 1"),
    ] {
        set(&mut app, entity, source);
        let error = until_failed(&mut app).error.to_string();
        assert!(error.contains(part), "{error}");
    }
}

/// Members that do not come, that are a pixel, that come twice, that go and that are too many.
#[test]
fn odd_collections_are_painted_or_say_why() {
    let mut app = app_without_rendering();
    let scene = raw(60);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let images = [noise(1, [250, 200, 30], [20, 40, 90]), noise(2, [20, 180, 60], [200, 250, 220])];
    let [of_good, of_other] = images.each_ref().map(|image| Canvas::new(&paint(image)));
    let [good, other] = images.each_ref().map(|image| add(&mut app, image.clone()));
    let of = |members: &[&Handle<Image>]| StyleSource::collection(members.iter().map(|&image| image.clone()));
    let hand = Hand { is_collection: true, ..Hand::default() };
    let missing: Handle<Image> = app.world().resource::<AssetServer>().load("no/such/member.style.jpg");
    let source = of(&[&good, &missing, &other]);
    let entity = app.world_mut().spawn((splats, of(&[&good, &other]))).id();
    until_applied(&mut app);
    let both = laid_in(&scene, &[&of_good, &of_other], &hand);
    check(&app, entity, both.clone());
    // What is shown stays until the member is there, which may be a single pixel.
    set(&mut app, entity, source);
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("no/such/member"), "{error}");
    check(&app, entity, both.clone());
    let pixel = columns([1, 1]);
    app.world_mut().resource_mut::<Assets<Image>>().insert(&missing, pixel.clone()).unwrap();
    until_applied(&mut app);
    let three = laid_in(&scene, &[&of_good, &Canvas::new(&paint(&pixel)), &of_other], &hand);
    assert!(three.colors.as_flattened().iter().all(|value| value.is_finite()));
    check(&app, entity, three.clone());
    // One that goes is shown until it comes back.
    app.world_mut().resource_mut::<Assets<Image>>().remove(&missing);
    (0..20).for_each(|_| app.update());
    check(&app, entity, three);
    let again = columns([30, 20]);
    app.world_mut().resource_mut::<Assets<Image>>().insert(&missing, again.clone()).unwrap();
    until_applied(&mut app);
    let of_again = Canvas::new(&paint(&again));
    check(&app, entity, laid_in(&scene, &[&of_good, &of_again, &of_other], &hand));
    // Twice is as once, and so is any number of times up to the limit.
    for n in [4, 17, MAX_TEXTURES] {
        let members: Vec<_> = [&good, &other].into_iter().cycle().take(n).collect();
        set(&mut app, entity, of(&members));
        until_applied(&mut app);
        check(&app, entity, both.clone());
    }
    set(&mut app, entity, of(&[&good; MAX_TEXTURES + 1]));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("found 257 paintings, expected at most 256"), "{error}");
    check(&app, entity, both);
    assert!(drain::<StyleFailed>(&mut app).is_empty());
    // None is no style.
    set(&mut app, entity, of(&[]));
    until_applied(&mut app);
    app.update();
    assert!(colors(app.world(), entity).is_none());
}

/// Seventeen members that differ are one style like any other.
#[test]
fn seventeen_paintings_are_a_collection() {
    let mut app = app_without_rendering();
    let scene = raw(60);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let members: Vec<_> = (0..17).map(|i| add(&mut app, columns([8 + i, 9]))).collect();
    let entity = app.world_mut().spawn((splats, StyleSource::collection(members))).id();
    until_applied(&mut app);
    let found = colors(app.world(), entity).unwrap();
    assert!(found.as_flattened().iter().all(|value| value.is_finite()));
    assert_ne!(found, scene.base_colors());
    let textures = strokes(&app, entity).expect("strokes").textures;
    assert!((1..=17).contains(&textures.len()), "{} textures", textures.len());
    assert!(drain::<StyleFailed>(&mut app).is_empty());
}

/// Pins that are no points are named while what is shown stays, and one is kept by a painting of any size.
#[test]
fn odd_pins_are_named_and_the_rest_goes_on() {
    let mut app = app_without_rendering();
    let scene = raw(150);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let image = noise(1, [250, 200, 30], [20, 40, 90]);
    let handle = add(&mut app, image.clone());
    let good = StylePin { at: scene.means[7], place: Vec2::new(0.8, 0.6), painting: 0 };
    let source = |pins: &[StylePin]| StyleSource::image(handle.clone()).with_pins(pins.to_vec());
    let entity = app.world_mut().spawn((splats, source(&[good]))).id();
    until_applied(&mut app);
    let pins = [Pin::from(good)];
    let hand = Hand { pins: &pins, ..Hand::default() };
    let shown = laid(&scene, &[&paint(&image)], &hand);
    check(&app, entity, shown.clone());
    for bad in [
        StylePin { place: Vec2::new(-0.1, 0.5), ..good },
        StylePin { place: Vec2::new(0.5, 1.0001), ..good },
        StylePin { place: Vec2::new(f32::NAN, 0.5), ..good },
        StylePin { place: Vec2::INFINITY, ..good },
        StylePin { at: Vec3::NAN, ..good },
        StylePin { at: Vec3::new(0.0, 1e4, 0.0), ..good },
        StylePin { at: Vec3::splat(1e30), ..good },
        StylePin { painting: 1, ..good },
    ] {
        set(&mut app, entity, source(&[good, bad]));
        let error = until_failed(&mut app).error.to_string();
        assert!(error.contains("pin 2: found"), "{bad:?}: {error}");
        check(&app, entity, shown.clone());
    }
    set(&mut app, entity, source(&[good]));
    until_applied(&mut app);
    // A smaller painting takes its place: without the spot of the pin, and with it.
    let mut small = columns([24, 16]);
    let whole = small.clone();
    (0..24 * 16).filter(|i| i % 24 >= 12).for_each(|i| small.data.as_mut().unwrap()[4 * i + 3] = 0);
    app.world_mut().resource_mut::<Assets<Image>>().insert(&handle, small).unwrap();
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("pin 1: found") && error.contains("transparent"), "{error}");
    check(&app, entity, shown);
    app.world_mut().resource_mut::<Assets<Image>>().insert(&handle, whole.clone()).unwrap();
    until_applied(&mut app);
    check(&app, entity, laid(&scene, &[&paint(&whole)], &hand));
    assert!(drain::<StyleFailed>(&mut app).is_empty());
}

#[test]
fn pins_of_a_list_and_of_a_file_move_the_strokes_that_are_there() {
    let mut app = app_without_rendering();
    let scene = raw(150);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let image = noise(1, [250, 200, 30], [20, 40, 90]);
    let handle = add(&mut app, image.clone());
    let source = || StyleSource::image(handle.clone());
    let entity = app.world_mut().spawn((splats, source())).id();
    until_applied(&mut app);
    let plain = strokes(&app, entity);
    let pin = StylePin { at: scene.means[7], place: Vec2::new(0.3, 0.6), painting: 0 };
    let pins = [Pin::from(pin)];
    let expected = || laid(&scene, &[&paint(&image)], &Hand { pins: &pins, ..Hand::default() });
    set(&mut app, entity, source().with_pins(vec![pin]));
    until_applied(&mut app);
    check(&app, entity, expected());
    assert!(strokes(&app, entity) != plain);
    // Taken away, the strokes are where they were.
    set(&mut app, entity, source());
    until_applied(&mut app);
    assert_eq!(strokes(&app, entity), plain);

    let file = StylePinsFile(Arc::new(StoredPins::new(&scene, pins.to_vec())));
    let file = add(&mut app, file);
    set(&mut app, entity, source().with_pins(file));
    until_applied(&mut app);
    check(&app, entity, expected());
    let of_other = add(&mut app, StylePinsFile(Arc::new(StoredPins::new(&raw(20), pins.to_vec()))));
    set(&mut app, entity, source().with_pins(of_other));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("pins of another scene"), "{error}");
}

#[test]
fn a_transparent_image_is_used_where_it_is_opaque_or_refused() {
    let mut app = app_without_rendering();
    let scene = raw(100);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let mut image = noise(1, [250, 200, 30], [20, 40, 90]);
    let cut = |image: &mut Image, is_cut: fn(usize) -> bool| {
        let data = image.data.as_mut().unwrap();
        (0..64 * 64).filter(|i| is_cut(*i)).for_each(|i| data[4 * i + 3] = 0);
    };
    cut(&mut image, |i| i % 64 < 20);
    assert!(paint(&image).used.is_some());
    let handle = add(&mut app, image.clone());
    let entity = app.world_mut().spawn((splats, StyleSource::image(handle))).id();
    until_applied(&mut app);
    check(&app, entity, laid(&scene, &[&paint(&image)], &Hand::default()));
    cut(&mut image, |_| true);
    let nothing = add(&mut app, image);
    set(&mut app, entity, StyleSource::image(nothing));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("all of the painting is transparent"), "{error}");
}
