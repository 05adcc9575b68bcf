//! Looks: baked colors beside styles that are decoded.

use std::{fs, time::Duration};

use bevy::{asset::AssetPlugin, prelude::*};
use stylegaussian::{Look, Scene, look::MadeFrom};
use stylegaussian_files::{read_scene, write_look, write_scene};

use crate::{
    AppliedStyle, GaussianSplats, StyleApplied, StyleFailed, StyleSource, StyleTransition,
    style::{
        StyleInput, StyleLook,
        decoder::{StyleBackend, StyleDecoder},
    },
};

use super::{styles::*, world::*};

/// A look of `scene` in one color.
fn plain_look(scene: &Scene, color: [f32; 3]) -> Look {
    Look::new(scene, &vec![color; scene.len()], MadeFrom::default())
}

fn add_look(app: &mut App, look: Look) -> Handle<StyleLook> {
    add(app, StyleLook(look.into()))
}

fn set(app: &mut App, entity: Entity, source: StyleSource) {
    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = source;
}

#[track_caller]
fn expect_close(found: &[[f32; 3]], expected: &[[f32; 3]]) {
    let errors = found.as_flattened().iter().zip(expected.as_flattened()).map(|(a, b)| (a - b).abs());
    assert_eq!(found.len(), expected.len());
    assert!(errors.fold(0.0, f32::max) < 1e-5, "{found:?}\n{expected:?}");
}

/// A scene that could never be decoded: no features, and the entity's decoder never comes.
#[test]
fn a_look_alone_needs_neither_features_nor_decoder() {
    let mut app = app_without_rendering();
    // There is no GPU either, and none is asked for.
    app.insert_resource(StyleBackend::Gpu);
    let scene = Scene { features: None, decoder: None, ..small_scene(16, 1) };
    let exact: Vec<_> = (0..16).map(|i| [i as f32 / 15.0, -0.1, 1.1]).collect();
    let look = add_look(&mut app, Look::new(&scene, &exact, MadeFrom::default()));
    let parts = (
        GaussianSplats(add_scene(&mut app, scene.clone())),
        StyleSource::look(look.clone()),
        StyleDecoder::default(),
    );
    let entity = app.world_mut().spawn(parts).id();
    let applied = until_applied(&mut app);
    assert_eq!((applied[0].entity, applied[0].backend), (entity, StyleBackend::Cpu));
    assert_eq!(colors(app.world(), entity).unwrap(), exact);

    // The styled scene, as it is exported.
    let styled = app.world().get::<AppliedStyle>(entity).unwrap().styled_scene().unwrap();
    expect_close(&styled.base_colors(), &exact);

    // Content is the share of the base colors.
    set(&mut app, entity, StyleSource::look(look).with_content(0.25));
    until_applied(&mut app);
    let blend = |(base, look): ([f32; 3], &[f32; 3])| [0, 1, 2].map(|c| 0.25 * base[c] + 0.75 * look[c]);
    let blended: Vec<_> = scene.base_colors().into_iter().zip(&exact).map(blend).collect();
    expect_close(&colors(app.world(), entity).unwrap(), &blended);

    set(&mut app, entity, StyleSource::none());
    until_applied(&mut app);
    app.update();
    assert!(colors(app.world(), entity).is_none());
}

#[test]
fn looks_mix_with_one_another_and_with_styles() {
    let mut app = app_without_rendering();
    let scene = small_scene(32, 1);
    let [white, black] = [1.0, 0.0].map(|v| add_look(&mut app, plain_look(&scene, [v; 3])));
    let (a, b) = (small_style(1), small_style(2));
    let [style_a, style_b] = [&a, &b].map(|style| add_style(&mut app, style.clone()));
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let mix = StyleSource::mix([(white.clone(), 3.0), (black.clone(), 1.0)]);
    let entity = app.world_mut().spawn((splats, mix)).id();
    until_applied(&mut app);
    assert_eq!(colors(app.world(), entity).unwrap(), [[0.75; 3]; 32]);

    // Styles mix as features with half of the total weight, and keep their share of the content.
    let inputs: [(StyleInput, f32); 4] = [
        (style_a.clone().into(), 0.5),
        (white.into(), 1.5),
        (style_b.into(), 1.5),
        (black.clone().into(), 0.5),
    ];
    set(&mut app, entity, StyleSource::mix(inputs).with_content(0.5));
    until_applied(&mut app);
    let decoded = expected(&scene, &[(&a, 0.25), (&b, 0.75)], 0.5);
    let parts = scene.base_colors().into_iter().zip(decoded);
    // Half of the weight is the looks': three parts white and one black, half of them base color.
    let mixed: Vec<_> = parts
        .map(|(base, decoded)| [0, 1, 2].map(|c| 0.5 * decoded[c] + 0.5 * (0.5 * base[c] + 0.5 * 0.75)))
        .collect();
    expect_close(&colors(app.world(), entity).unwrap(), &mixed);

    // Wrong numbers are refused as they are without looks.
    let before = colors(app.world(), entity);
    for (source, part) in [
        (StyleSource::mix([(StyleInput::from(black.clone()), 1.0), (style_a.into(), -0.5)]), "mix weights"),
        (StyleSource::mix([(black.clone(), 0.0)]), "mix weights"),
        (StyleSource::look(black.clone()).with_content(1.5), "content 1.5"),
    ] {
        set(&mut app, entity, source);
        let error = until_failed(&mut app).error.to_string();
        assert!(error.contains(part), "{error}");
    }
    assert_eq!(colors(app.world(), entity), before);
}

#[test]
fn a_style_beside_a_look_needs_paint_or_features() {
    let mut app = app_without_rendering();
    let scene = Scene { features: None, decoder: None, ..small_scene(8, 1) };
    let look = add_look(&mut app, plain_look(&scene, [0.5; 3]));
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let inputs: [(StyleInput, f32); 2] = [(look.into(), 1.0), (style.into(), 1.0)];
    app.world_mut().spawn((splats, StyleSource::mix(inputs)));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("carries no paint"), "{error}");
}

#[test]
fn a_look_of_another_scene_fails_and_the_app_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let scene = small_scene(20, 1);
    write_scene(&path("scene.sgs"), &scene).unwrap();
    let read = read_scene(&path("scene.sgs")).unwrap().scene;
    // Made in the order of the program's scene and shown on that of the file.
    let exact: Vec<_> = scene.opacities.iter().map(|&opacity| [opacity, 0.0, 1.0]).collect();
    let own = Look::new(&scene, &exact, MadeFrom::default());
    write_look(&path("own.look.safetensors"), &own).unwrap();
    let other = plain_look(&small_scene(20, 2), [0.5; 3]);
    write_look(&path("other.look.safetensors"), &other).unwrap();
    let whole = fs::read(path("own.look.safetensors")).unwrap();
    fs::write(path("cut.look.safetensors"), &whole[..whole.len() - 1]).unwrap();
    let file_path = dir.path().to_string_lossy().into_owned();
    let mut app = app_with_assets(AssetPlugin { file_path, ..default() });
    let assets = app.world().resource::<AssetServer>().clone();

    let source = StyleSource::look(assets.load("own.look.safetensors"));
    let entity = app.world_mut().spawn((GaussianSplats(assets.load("scene.sgs")), source.clone())).id();
    until_applied(&mut app);
    let shown = colors(app.world(), entity).unwrap();
    for (color, opacity) in shown.iter().zip(&read.opacities) {
        assert!((color[0] - opacity).abs() < 0.5 / 255.0, "{color:?}, expected {opacity}");
    }
    for (name, parts) in [
        (
            "other.look.safetensors",
            &["found a look of another scene (20@", "expected one of this scene (20@"][..],
        ),
        ("cut.look.safetensors", &["broken header"]),
        ("absent.look.safetensors", &[]),
    ] {
        set(&mut app, entity, StyleSource::look(assets.load(name)));
        let failed: StyleFailed = until_failed(&mut app);
        let message = failed.error.to_string();
        assert!(message.contains(name) && parts.iter().all(|part| message.contains(part)), "{message}");
        assert_eq!(colors(app.world(), entity).unwrap(), shown, "the old colors stay");
    }
    // A file that is repaired is taken over.
    fs::write(path("cut.look.safetensors"), &whole).unwrap();
    set(&mut app, entity, StyleSource::look(assets.load("cut.look.safetensors")));
    assets.reload("cut.look.safetensors");
    until_applied(&mut app);
    assert_eq!(colors(app.world(), entity).unwrap(), shown);
}

#[test]
fn a_changed_look_is_shown_at_once() {
    let mut app = app_without_rendering();
    let scene = small_scene(8, 1);
    let look = add_look(&mut app, plain_look(&scene, [0.25; 3]));
    let transition = StyleTransition::fade(Duration::from_secs(1000));
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::look(look.clone()), transition)).id();
    until_applied(&mut app);
    let began = std::time::Instant::now();
    let mut looks = app.world_mut().resource_mut::<Assets<StyleLook>>();
    looks.get_mut(&look).unwrap().0 = plain_look(&scene, [0.75; 3]).into();
    until_applied(&mut app);
    assert!(began.elapsed() < Duration::from_secs(30), "{:?}", began.elapsed());
    assert_eq!(colors(app.world(), entity).unwrap(), [[0.75; 3]; 8]);
    for _ in 0..20 {
        app.update();
    }
    assert!(drain::<StyleApplied>(&mut app).is_empty(), "nothing happens without a change");
}

/// Games that show looks and presets alone are built without images.
#[test]
#[cfg(not(feature = "images"))]
fn an_image_is_an_error_that_names_the_feature() {
    let mut app = app_without_rendering();
    let splats = GaussianSplats(add_scene(&mut app, small_scene(8, 1)));
    app.world_mut().spawn((splats, StyleSource::image(Handle::default())));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("the feature `images`"), "{error}");
}
