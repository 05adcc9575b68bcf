//! Styles in a painting's own paint.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian::{
    Scene,
    paint::{Brush, Paint, Surface, repaint},
};

use crate::{
    AppliedStyle, GaussianSplats, HiddenUntilStyled, StyleMethod, StyleSource, StyleStatistics,
    colors::ColorLayers,
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

#[test]
fn a_painting_gives_its_paint_unless_a_decoder_is_wanted() {
    let mut app = app_without_rendering();
    let style = add_painted_style(&mut app);
    let scene = Scene { decoder: None, ..small_scene(200, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let source = StyleSource::preset(style).with_content(0.25).with_stroke_scale(0.5);
    let entity = app.world_mut().spawn((splats, source)).id();
    until_applied(&mut app);
    let painted = |content, stroke_scale| {
        let surface = Surface::new(&scene, stroke_scale);
        repaint(&scene, &surface, &[(&stripes(), 1.0)], content, Brush::default())
    };
    assert_eq!(colors(app.world(), entity).unwrap(), painted(0.25, 0.5));
    let mut source = app.world_mut().get_mut::<StyleSource>(entity).unwrap();
    (source.content, source.stroke_scale) = (0.0, 1.0);
    until_applied(&mut app);
    assert_eq!(colors(app.world(), entity).unwrap(), painted(0.0, 1.0));

    // No decoder of this scene's 8 channels is bundled.
    app.insert_resource(StyleMethod::Decoder);
    app.world_mut().get_mut::<StyleSource>(entity).unwrap().content = 0.5;
    until_failed(&mut app);
}

/// A painting on so many Gaussians that their surface takes far longer than their first colors.
fn large(app: &mut App) -> (GaussianSplats, StyleSource) {
    let style = add_painted_style(app);
    let scene = Scene { decoder: None, ..small_scene(20_000, 1) };
    (GaussianSplats(add_scene(app, scene)), StyleSource::preset(style))
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
    let mut n_applied = 0;
    while n_applied < 2 {
        n_applied += until_applied(&mut app).len();
    }
    assert_eq!([shown(app.world(), plain), shown(app.world(), hidden)], [Some((false, 1)); 2]);
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
    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::preset(other);
    until_applied(&mut app);
    assert_eq!(n_changes(&app), Some(before + 3));
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
}
