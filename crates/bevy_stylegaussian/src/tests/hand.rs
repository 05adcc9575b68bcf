//! Collections, crops, palettes and pinned places, in apps without a renderer.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian::{
    Scene,
    paint::{Canvas, Hand, Paint, Painted, Pin, StoredPins, Surface, Tints, lay},
    work::Work,
};

use crate::{
    GaussianSplats, StyleSource,
    style::{StylePin, StylePinsFile},
};

use super::{
    paint::{check, noise, paint, raw, set, strokes},
    styles::{until_applied, until_failed},
    world::*,
};

/// The scene in paintings, by the model crate's own functions.
fn laid(scene: &Scene, paintings: &[&Paint], hand: &Hand) -> Painted {
    let canvases: Vec<Canvas> = paintings.iter().map(|paint| Canvas::new(paint)).collect();
    let weighted: Vec<_> = canvases.iter().map(|canvas| (canvas, 1.0)).collect();
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
