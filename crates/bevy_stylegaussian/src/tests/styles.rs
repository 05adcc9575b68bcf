//! Styling on the CPU, in apps without a renderer.

use std::{sync::Arc, time::Duration};

use bevy::{asset::AssetPlugin, prelude::*};
use stylegaussian::{ChannelStatistics, Scene, fold};
use stylegaussian_files::{Precision, read_scene, write_decoder, write_scene, write_style};

use crate::{
    AppliedStyle, GaussianSceneFailed, GaussianSplats, StyleApplied, StyleFailed, StyleSource,
    StyleTransition,
    scene::LoadedScene,
    style::{
        StyleInput, StyleMethod, StyleStatistics,
        decoder::{GaussianDecoder, StyleBackend, StyleDecoder},
    },
};

use super::world::*;

/// The colors of a mix by the model crate's own functions.
pub(super) fn expected(scene: &Scene, styles: &[(&ChannelStatistics, f64)], content: f64) -> Vec<[f32; 3]> {
    let map = fold::transfer(scene.features.as_ref().unwrap(), styles, content).unwrap();
    fold::stylize(scene, scene.decoder.as_ref().unwrap(), &map).unwrap()
}

pub(super) fn colors(world: &World, entity: Entity) -> Option<Vec<[f32; 3]>> {
    world.get::<AppliedStyle>(entity).map(|style| style.colors().unwrap().to_vec())
}

pub(super) fn until_applied(app: &mut App) -> Vec<StyleApplied> {
    let mut applied = Vec::new();
    update_until(app, "StyleApplied", |world| {
        applied.extend(world.resource_mut::<Messages<StyleApplied>>().drain());
        !applied.is_empty()
    });
    applied
}

pub(super) fn until_failed(app: &mut App) -> StyleFailed {
    let mut failed = Vec::new();
    update_until(app, "StyleFailed", |world| {
        failed.extend(world.resource_mut::<Messages<StyleFailed>>().drain());
        !failed.is_empty()
    });
    failed.remove(0)
}

#[test]
fn presets_mixes_and_content_give_the_models_colors() {
    let mut app = app_without_rendering();
    let scene = small_scene(64, 1);
    let (a, b) = (small_style(1), small_style(2));
    let (handle_a, handle_b) = (add_style(&mut app, a.clone()), add_style(&mut app, b.clone()));
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(handle_a.clone()))).id();

    let applied = until_applied(&mut app);
    assert_eq!((applied[0].entity, applied[0].backend), (entity, StyleBackend::Cpu));
    assert_eq!(colors(app.world(), entity).unwrap(), expected(&scene, &[(&a, 1.0)], 0.0));

    let mix = [(StyleInput::from(handle_a), 0.3), (StyleInput::from(handle_b), 0.9)];
    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::mix(mix).with_content(0.25);
    until_applied(&mut app);
    // The component holds f32 weights, the model was given f64: they differ in the last places.
    let found = colors(app.world(), entity).unwrap();
    let mixed = expected(&scene, &[(&a, 0.3), (&b, 0.9)], 0.25);
    let error = found.as_flattened().iter().zip(mixed.as_flattened()).map(|(f, e)| (f - e).abs());
    assert!(error.fold(0.0, f32::max) < 1e-5);

    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::none();
    until_applied(&mut app);
    app.update();
    assert!(colors(app.world(), entity).is_none());
}

#[test]
fn observers_hear_of_the_entity() {
    #[derive(Resource, Default)]
    struct Heard(Vec<Entity>);
    let mut app = app_without_rendering();
    app.init_resource::<Heard>();
    app.add_observer(|event: On<StyleApplied>, mut heard: ResMut<Heard>| heard.0.push(event.entity));
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(8, 1)));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style))).id();
    until_applied(&mut app);
    assert_eq!(app.world().resource::<Heard>().0, [entity]);
}

#[test]
fn a_thousand_changes_end_in_the_last() {
    let mut app = app_without_rendering();
    let scene = small_scene(256, 1);
    let styles: Vec<_> = (0..8).map(small_style).collect();
    let handles: Vec<_> = styles.iter().map(|style| add_style(&mut app, style.clone())).collect();
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleSource::none())).id();
    // Updates come between about half of the changes, so some styles are computed and most are passed over.
    let mut next = numbers(5);
    let mut last = 0;
    for _ in 0..1000 {
        last = ((next() + 1.0) * 4.0) as usize % 8;
        *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = match last {
            0 => StyleSource::none(),
            i => StyleSource::preset(handles[i].clone()),
        };
        if next() > 0.0 {
            app.update();
        }
    }
    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::preset(handles[last].clone());
    let goal = expected(&scene, &[(&styles[last], 1.0)], 0.0);
    update_until(&mut app, "the last look", |world| colors(world, entity).as_ref() == Some(&goal));
    // It stays: no older style comes after it.
    for _ in 0..50 {
        app.update();
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(colors(app.world(), entity).unwrap(), goal);
}

#[test]
fn plain_scenes_say_which_command_embeds_them() {
    let mut app = app_without_rendering();
    let style = add_style(&mut app, small_style(1));
    let scene = Scene { features: None, decoder: None, ..small_scene(8, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene));
    // Paint needs no features.
    app.insert_resource(StyleMethod::Decoder);
    app.world_mut().spawn((splats, StyleSource::preset(style)));
    let failed = until_failed(&mut app);
    assert!(failed.error.to_string().contains("stylegaussian embed"), "{}", failed.error);
}

/// A scene that can neither be painted nor decoded fails once, however many of its style's assets come later.
#[test]
fn a_failure_that_stays_is_told_once() {
    let mut app = app_without_rendering();
    let plain = Scene { features: None, decoder: None, ..small_scene(8, 1) };
    let preset = app.world().resource::<Assets<StyleStatistics>>().reserve_handle();
    let splats = GaussianSplats(add_scene(&mut app, plain));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(preset.clone()))).id();
    let bare = || StyleStatistics { statistics: Arc::new(small_style(1)), paint: None };
    app.world_mut().resource_mut::<Assets<StyleStatistics>>().insert(&preset, bare()).unwrap();
    until_failed(&mut app);
    app.world_mut().resource_mut::<Assets<StyleStatistics>>().insert(&preset, bare()).unwrap();
    (0..5).for_each(|_| app.update());
    assert_eq!(drain::<StyleFailed>(&mut app).len(), 0);
    // Asked again, it answers again.
    app.world_mut().get_mut::<StyleSource>(entity).unwrap().content = 0.5;
    until_failed(&mut app);
}

#[test]
fn a_gpu_that_is_not_there_is_not_called_too_small() {
    let mut app = app_without_rendering();
    app.insert_resource(StyleBackend::Gpu);
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(8, 1)));
    app.world_mut().spawn((splats, StyleSource::preset(style)));
    let error = until_failed(&mut app).error.to_string();
    assert!(error.contains("no GPU") && !error.contains("this GPU"), "{error}");
}

#[test]
fn wrong_weights_keep_the_look() {
    let mut app = app_without_rendering();
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(8, 1)));
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style.clone()))).id();
    until_applied(&mut app);
    let before = colors(app.world(), entity).unwrap();
    for (source, part) in [
        (StyleSource::mix([(style.clone(), -1.0)]), "mix weights"),
        (StyleSource::mix([(style.clone(), 0.0)]), "mix weights"),
        (StyleSource::mix([(style.clone(), 1.0), (style.clone(), f32::NAN)]), "mix weights"),
        (StyleSource::mix([(style.clone(), f32::INFINITY)]), "mix weights"),
        (StyleSource::preset(style.clone()).with_content(1.5), "content 1.5"),
        (StyleSource::preset(style.clone()).with_content(f32::NAN), "content NaN"),
    ] {
        *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = source;
        let failed = until_failed(&mut app);
        assert!(failed.error.to_string().contains(part), "{}", failed.error);
    }
    assert_eq!(colors(app.world(), entity).unwrap(), before);
    // An empty mix is no style.
    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::mix::<StyleInput>([]);
    until_applied(&mut app);
    app.update();
    assert!(colors(app.world(), entity).is_none());
}

#[test]
fn changed_assets_restyle() {
    let mut app = app_without_rendering();
    let scene = small_scene(32, 1);
    let (a, b) = (small_style(1), small_style(2));
    let style = add_style(&mut app, a.clone());
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let handle = splats.0.clone();
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style.clone()))).id();
    until_applied(&mut app);

    // The statistics change.
    let mut statistics = app.world_mut().resource_mut::<Assets<crate::style::StyleStatistics>>();
    statistics.get_mut(&style).unwrap().statistics = b.clone().into();
    until_applied(&mut app);
    assert_eq!(colors(app.world(), entity).unwrap(), expected(&scene, &[(&b, 1.0)], 0.0));

    // The scene changes, to one of fewer Gaussians.
    let other = small_scene(20, 7);
    let mut scenes = app.world_mut().resource_mut::<Assets<crate::GaussianScene>>();
    scenes.insert(&handle, crate::GaussianScene::new(other.clone())).unwrap();
    until_applied(&mut app);
    assert_eq!(colors(app.world(), entity).unwrap(), expected(&other, &[(&b, 1.0)], 0.0));

    // The decoder changes: the entity's own takes precedence over the scene's.
    let decoder = small_scene(1, 9).decoder.unwrap();
    let own = add(&mut app, GaussianDecoder(decoder.clone().into()));
    app.world_mut().entity_mut(entity).insert(StyleDecoder(own));
    until_applied(&mut app);
    let with_decoder = Scene { decoder: Some(decoder), ..other };
    assert_eq!(colors(app.world(), entity).unwrap(), expected(&with_decoder, &[(&b, 1.0)], 0.0));
}

/// Every change of a source is answered, even if there is nothing to take off.
#[test]
fn no_style_is_answered_where_none_is_shown() {
    let mut app = app_without_rendering();
    let style = add_style(&mut app, small_style(1));
    let handle = add_scene(&mut app, small_scene(8, 1));
    let entity = app.world_mut().spawn((GaussianSplats(handle.clone()), StyleSource::none())).id();
    (0..20).for_each(|_| app.update());
    assert!(drain::<StyleApplied>(&mut app).is_empty(), "the first source is no change");
    let change = |app: &mut App, source: StyleSource| {
        *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = source;
    };
    // A style that never was complete.
    let missing = app.world().resource::<AssetServer>().load("no.style.safetensors");
    change(&mut app, StyleSource::preset(missing));
    app.update();
    change(&mut app, StyleSource::none());
    assert_eq!(until_applied(&mut app).len(), 1);
    // A scene without its style, as another one came.
    change(&mut app, StyleSource::preset(style));
    until_applied(&mut app);
    let mut scenes = app.world_mut().resource_mut::<Assets<crate::GaussianScene>>();
    scenes.insert(&handle, crate::GaussianScene::new(small_scene(9, 2))).unwrap();
    change(&mut app, StyleSource::none());
    let applied = until_applied(&mut app);
    assert_eq!(applied.iter().map(|applied| applied.entity).collect::<Vec<_>>(), [entity]);
    assert!(app.world().get::<AppliedStyle>(entity).is_none());
    (0..20).for_each(|_| app.update());
    assert!(drain::<StyleApplied>(&mut app).is_empty());
}

#[test]
fn nothing_happens_without_a_change() {
    let mut app = app_without_rendering();
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(8, 1)));
    app.world_mut().spawn((splats, StyleSource::preset(style)));
    until_applied(&mut app);
    for _ in 0..20 {
        app.update();
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(drain::<StyleApplied>(&mut app).is_empty());
}

#[test]
fn a_change_during_a_fade_is_applied_at_once() {
    let mut app = app_without_rendering();
    let styles = [1, 2].map(small_style);
    let handles = styles.clone().map(|style| add_style(&mut app, style));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(8, 1)));
    let transition = StyleTransition::fade(Duration::from_secs(1000));
    let source = StyleSource::preset(handles[0].clone());
    let entity = app.world_mut().spawn((splats, source, transition)).id();
    until_applied(&mut app);
    let began = std::time::Instant::now();
    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::preset(handles[1].clone());
    until_applied(&mut app);
    assert!(began.elapsed() < Duration::from_secs(30), "{:?}", began.elapsed());
}

/// The end of a fade of any duration is computed without overflow.
#[test]
fn a_fade_may_last_forever() {
    let mut app = app_without_rendering();
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(8, 1)));
    let transition = StyleTransition::fade(Duration::MAX);
    let entity = app.world_mut().spawn((splats, StyleSource::preset(style), transition)).id();
    until_applied(&mut app);
    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() = StyleSource::none();
    for _ in 0..3 {
        app.update();
    }
    assert!(colors(app.world(), entity).is_none(), "another change does not wait for its end");
}

/// An observer of a failure may despawn any entity, also one that is about to get its scene.
#[test]
fn observers_may_despawn_what_they_like() {
    let mut app = app_without_rendering();
    app.add_observer(
        |_: On<GaussianSceneFailed>, all: Query<Entity, With<GaussianSplats>>, mut commands: Commands| {
            all.iter().for_each(|entity| commands.entity(entity).despawn());
        },
    );
    let mut broken = small_scene(8, 1);
    // The failure's observer runs among the commands that attach the other scene.
    broken.scales.pop();
    let style = add_style(&mut app, small_style(1));
    for scene in [broken, small_scene(8, 2)] {
        let splats = GaussianSplats(add_scene(&mut app, scene));
        app.world_mut().spawn((splats, StyleSource::preset(style.clone())));
    }
    for _ in 0..3 {
        app.update();
    }
    let n_left = app.world_mut().query::<&GaussianSplats>().iter(app.world()).count();
    assert_eq!(n_left, 0);
}

#[test]
fn scenes_that_cannot_be_are_refused() {
    let mut app = app_without_rendering();
    let mut scene = small_scene(8, 1);
    scene.scales.pop();
    let splats = GaussianSplats(add_scene(&mut app, scene));
    let entity = app.world_mut().spawn(splats).id();
    app.update();
    let failed = drain::<GaussianSceneFailed>(&mut app);
    assert_eq!(failed[0].entity, entity);
    assert!(failed[0].error.to_string().contains("7 scales, expected 8"), "{}", failed[0].error);

    let missing: Handle<crate::GaussianScene> =
        app.world().resource::<AssetServer>().load("no_such_scene.sgs");
    app.world_mut().spawn(GaussianSplats(missing));
    update_until(&mut app, "GaussianSceneFailed", |world| {
        let failed: Vec<_> = world.resource_mut::<Messages<GaussianSceneFailed>>().drain().collect();
        failed.iter().any(|event| event.error.to_string().contains("no_such_scene.sgs"))
    });
}

/// Scenes, statistics and decoders load from files. Errors name a broken file.
#[test]
fn files_load_and_broken_ones_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let (scene, style) = (small_scene(40, 1), small_style(1));
    write_scene(&path("scene.sgs"), &scene).unwrap();
    write_scene(&path("plain.ply"), &scene).unwrap();
    write_style(&path("a.style.safetensors"), &style).unwrap();
    let decoder = small_scene(1, 9).decoder.unwrap();
    write_decoder(&path("b.decoder.safetensors"), &decoder, Precision::F32).unwrap();
    for name in ["broken.sgs", "broken.style.safetensors"] {
        std::fs::write(path(name), b"no such thing").unwrap();
    }
    let file_path = dir.path().to_string_lossy().into_owned();
    let mut app = app_with_assets(AssetPlugin { file_path, ..default() });
    let assets = app.world().resource::<AssetServer>().clone();

    let parts = (
        GaussianSplats(assets.load("scene.sgs")),
        StyleSource::preset(assets.load("a.style.safetensors")),
        StyleDecoder(assets.load("b.decoder.safetensors")),
    );
    let entity = app.world_mut().spawn(parts).id();
    until_applied(&mut app);
    let read = Scene { decoder: Some(decoder), ..read_scene(&path("scene.sgs")).unwrap().scene };
    assert_eq!(colors(app.world(), entity).unwrap(), expected(&read, &[(&style, 1.0)], 0.0));

    *app.world_mut().get_mut::<StyleSource>(entity).unwrap() =
        StyleSource::preset(assets.load("broken.style.safetensors"));
    let message = until_failed(&mut app).error.to_string();
    assert!(message.contains("broken.style.safetensors"), "{message}");

    let plain: Handle<crate::GaussianScene> = assets.load("plain.ply");
    update_until(&mut app, "plain.ply", |world| {
        world.resource::<Assets<crate::GaussianScene>>().contains(&plain)
    });
    // An entity that shows another scene keeps it.
    let shown = colors(app.world(), entity);
    app.world_mut().get_mut::<GaussianSplats>(entity).unwrap().0 = assets.load("broken.sgs");
    update_until(&mut app, "GaussianSceneFailed", |world| {
        let failed: Vec<_> = world.resource_mut::<Messages<GaussianSceneFailed>>().drain().collect();
        failed.iter().any(|event| event.entity == entity && event.error.to_string().contains("broken.sgs"))
    });
    assert_eq!(app.world().get::<LoadedScene>(entity).unwrap().scene().len(), 40);
    assert_eq!(colors(app.world(), entity), shown);
    // The next one takes its place.
    app.world_mut().get_mut::<GaussianSplats>(entity).unwrap().0 = plain.clone();
    update_until(&mut app, "plain.ply to be shown", |world| {
        world.get::<LoadedScene>(entity).unwrap().id == plain.id()
    });
}

/// If broken files are repaired while the app runs, the scene is shown and styled.
#[test]
fn repaired_files_are_taken_over() {
    let dir = tempfile::tempdir().unwrap();
    let (scene_path, style_path) = (dir.path().join("scene.sgs"), dir.path().join("a.style.safetensors"));
    for path in [&scene_path, &style_path] {
        std::fs::write(path, b"no such thing").unwrap();
    }
    let file_path = dir.path().to_string_lossy().into_owned();
    let mut app = app_with_assets(AssetPlugin { file_path, ..default() });
    let assets = app.world().resource::<AssetServer>().clone();
    let source = StyleSource::preset(assets.load("a.style.safetensors"));
    let entity = app.world_mut().spawn((GaussianSplats(assets.load("scene.sgs")), source)).id();
    update_until(&mut app, "GaussianSceneFailed", |world| {
        !world.resource::<Messages<GaussianSceneFailed>>().is_empty()
    });

    write_scene(&scene_path, &small_scene(40, 1)).unwrap();
    assets.reload("scene.sgs");
    let message = until_failed(&mut app).error.to_string();
    assert!(message.contains("a.style.safetensors"), "{message}");

    let style = small_style(1);
    write_style(&style_path, &style).unwrap();
    assets.reload("a.style.safetensors");
    until_applied(&mut app);
    let read = read_scene(&scene_path).unwrap().scene;
    assert_eq!(colors(app.world(), entity).unwrap(), expected(&read, &[(&style, 1.0)], 0.0));
}

/// All components, resources, events and assets are registered, for editors and scene files.
#[test]
#[cfg(feature = "refine")]
fn public_types_are_registered() {
    mod face {
        pub use crate::{
            mask::*,
            splats::*,
            style::{decoder::*, *},
            *,
        };
    }
    use bevy::ecs::reflect::{ReflectComponent, ReflectResource};
    let mut app = app_without_rendering();
    let registry = app.world_mut().resource::<AppTypeRegistry>().read();
    macro_rules! check {
        ($data:ty: $($name:ident),*) => {$(
            let registration = registry.get(std::any::TypeId::of::<face::$name>());
            let registration = registration.expect(concat!(stringify!($name), " is not registered"));
            assert!(registration.data::<$data>().is_some(), stringify!($name));
        )*};
        ($($name:ident),*) => {$(
            assert!(registry.get(std::any::TypeId::of::<face::$name>()).is_some(), stringify!($name));
        )*};
    }
    check!(ReflectComponent: GaussianSplats, StyleSource, StyleRefine, StylePrepare, StyleTransition);
    check!(ReflectComponent: StyleDecoder, StyleVolume, HiddenUntilStyled, StyleMask, MaskVisibility);
    check!(ReflectComponent: SplatTonemapping, SplatSortKey, SplatCuts, SplatEyes);
    // It is computed, and cannot be saved: a saved world must not hold it.
    assert!(registry.get(std::any::TypeId::of::<AppliedStyle>()).is_none());
    check!(ReflectResource: StyleBackend, StyleBudget, StyleEncoder);
    check!(
        GaussianScene,
        StyleStatistics,
        StyleLook,
        GaussianDecoder,
        ImageEncoder,
        StyleInput,
        WeightedStyle
    );
    check!(StyleApplied, StyleRefined, StyleFailed, GaussianSceneFailed);
}
