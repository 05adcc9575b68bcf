//! Scenes in other formats through the asset server: settings, several files, and files that are broken.

use std::{fs, path::PathBuf};

use bevy::{asset::AssetLoadFailedEvent, prelude::*};
use stylegaussian::{Axes, Scene};
use stylegaussian_files::{read_scene, readable_extensions, write_scene};

use super::world::{add_scene, app_with_assets, app_without_rendering, small_scene, update_until};
use crate::{
    FitScene, GaussianScene, GaussianSceneFailed, GaussianSplats,
    scene::{LoadedScene, SceneSettings},
};

/// An app with this folder of assets.
fn app(folder: PathBuf) -> App {
    app_with_assets(AssetPlugin { file_path: folder.to_string_lossy().into_owned(), ..default() })
}

fn loaded(app: &mut App, handle: &Handle<GaussianScene>) -> std::sync::Arc<stylegaussian::Scene> {
    let is_loaded = |world: &mut World| world.resource::<Assets<GaussianScene>>().get(handle).is_some();
    update_until(app, "the scene", is_loaded);
    app.world().resource::<Assets<GaussianScene>>().get(handle).unwrap().scene().clone()
}

/// The message of the next failure.
fn failure(app: &mut App) -> String {
    let mut message = None;
    update_until(app, "GaussianSceneFailed", |world| {
        let failed = world.resource_mut::<Messages<GaussianSceneFailed>>().drain().next();
        message = failed.map(|failed| failed.error.to_string());
        message.is_some()
    });
    message.unwrap()
}

#[test]
fn captures_load_with_settings() {
    let dir = tempfile::tempdir().unwrap();
    let scene = small_scene(20, 1);
    for name in ["a.splat", "a.ply"] {
        write_scene(&dir.path().join(name), &scene).unwrap();
        let read = read_scene(&dir.path().join(name)).unwrap().scene;
        let mut first = app(dir.path().to_owned());
        let plain = first.world().resource::<AssetServer>().load(name);
        assert_eq!(loaded(&mut first, &plain).means, read.means);
        // Another app: settings count for the first load of a file only.
        let mut second = app(dir.path().to_owned());
        let assets = second.world().resource::<AssetServer>();
        let settings = |settings: &mut SceneSettings| settings.axes = Some(Axes::RUB);
        let turned = assets.load_builder().with_settings(settings).load(name);
        let means = &loaded(&mut second, &turned).means;
        assert_eq!(means[0], read.means[0] * Vec3::new(1.0, -1.0, -1.0), "{name}");
    }
}

/// In the frame in which it is attached, again for the next scene, and not by a ball without size.
#[test]
fn scenes_are_fitted_when_they_come() {
    let mut app = app_without_rendering();
    let scene = Scene { up: Some(Vec3::Z), ..small_scene(30, 2) };
    let means = scene.means.iter().map(|mean| 50.0 * *mean + Vec3::splat(1e3)).collect();
    let far = Scene { means, up: Some(Vec3::NEG_Y), ..scene.clone() };
    let fit = FitScene::new(Vec3::Y, 3.0);
    let handle = add_scene(&mut app, scene);
    let entity = app.world_mut().spawn((GaussianSplats(handle), fit)).id();
    app.update();
    // The ball's center and its highest point.
    let check = |app: &App, up: Vec3| {
        let entity = app.world().entity(entity);
        let framing = entity.get::<LoadedScene>().unwrap().asset.framing().unwrap();
        let transform = entity.get::<Transform>().unwrap();
        let top = framing.frame.center + framing.frame.radius * up;
        let (center, top) = (transform.transform_point(framing.frame.center), transform.transform_point(top));
        assert!(center.distance(Vec3::Y) < 1e-3 && top.distance(4.0 * Vec3::Y) < 1e-3, "{center} {top}");
    };
    check(&app, Vec3::Z);
    let handle = add_scene(&mut app, far);
    app.world_mut().get_mut::<GaussianSplats>(entity).unwrap().0 = handle;
    update_until(&mut app, "the next scene", |world| {
        world.get::<LoadedScene>(entity).unwrap().scene().up == Some(Vec3::NEG_Y)
    });
    check(&app, Vec3::NEG_Y);
    app.world_mut().entity_mut(entity).insert(FitScene::new(Vec3::ZERO, f32::NAN));
    app.update();
    check(&app, Vec3::NEG_Y);
}

/// Addresses on the web end with queries, and some name no format. No file can be called so on Windows.
#[cfg(unix)]
#[test]
fn a_query_or_no_extension_hides_no_format() {
    let dir = tempfile::tempdir().unwrap();
    let mut app = app(dir.path().to_owned());
    let assets = app.world().resource::<AssetServer>().clone();
    for (name, format) in [
        ("scene", "ply"),
        ("garden.ply?v=2", "ply"),
        ("garden.ply?file=other.glb", "ply"),
        // Its files have no mark, so its name alone tells.
        ("garden.splat?v=1.5", "splat"),
        ("download", "sgs"),
    ] {
        let (written, renamed) = (dir.path().join("written").with_extension(format), dir.path().join(name));
        write_scene(&written, &small_scene(20, 1)).unwrap();
        let read = read_scene(&written).unwrap().scene;
        fs::rename(&written, &renamed).unwrap();
        let handle = assets.load(name);
        assert_eq!(loaded(&mut app, &handle).means, read.means, "{name}");
    }
}

/// Every reader is fed with bytes that are none of its own, and with its own beginning alone. The game goes on.
#[test]
fn a_hostile_asset_is_an_event_and_the_next_one_loads() {
    let dir = tempfile::tempdir().unwrap();
    let mut app = app(dir.path().to_owned());
    let assets = app.world().resource::<AssetServer>().clone();
    let mut names = Vec::new();
    let starts: [&[u8]; 8] = [
        b"",
        b"no such thing",
        b"NGSP\xff\xff\xff\xff\xff\xff\xff\xff",
        b"\x1f\x8b\x08\0\0\0\0\0\0\0",
        b"PK\x03\x04\xff\xff\xff\xff",
        b"glTF\x02\0\0\0\xff\xff\xff\xff",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n",
        b"\0\x01\0\0\xff\xff\xff\xff",
    ];
    for extension in readable_extensions() {
        for (i, start) in starts.iter().enumerate() {
            names.push(format!("{i}.{extension}"));
            fs::write(dir.path().join(names.last().unwrap()), start).unwrap();
        }
    }
    for name in names {
        let handle = assets.load(&name);
        let entity = app.world_mut().spawn(GaussianSplats(handle)).id();
        let message = failure(&mut app);
        assert!(message.contains(&name), "{name}: {message}");
        app.world_mut().despawn(entity);
    }
    write_scene(&dir.path().join("good.sgs"), &small_scene(20, 1)).unwrap();
    let good = assets.load("good.sgs");
    assert_eq!(loaded(&mut app, &good).len(), 20);
}

/// A scene that names other files, which lie beside it.
#[test]
fn a_scene_of_several_files_loads_them_all() {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let data = std::env::var_os("STYLEGAUSSIAN_DATA").map_or_else(beside, PathBuf::from);
    let folder = data.join("zoo/fixtures-usd3dgs/sog");
    if !folder.is_dir() || !readable_extensions().contains(&"sog") {
        eprintln!("SKIPPED: no test data at {}, or SOG is not read", folder.display());
        return;
    }
    let mut app = app(folder.canonicalize().unwrap());
    let assets = app.world().resource::<AssetServer>().clone();
    let scene = assets.load("unbundled-kit-multi-degree3/meta.json");
    assert_eq!(loaded(&mut app, &scene).len(), 3);
    app.world_mut().spawn(GaussianSplats(assets.load("unbundled-missing-plane/meta.json")));
    let message = failure(&mut app);
    for part in ["unbundled-missing-plane/meta.json", "sh0.webp"] {
        assert!(message.contains(part), "{message}");
    }
}

/// Failed loads of scenes, as the asset server tells them.
#[derive(Resource, Default)]
struct FailedLoads(usize);

#[test]
fn a_broken_hot_reload_is_one_event_and_keeps_the_scene() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.ply");
    write_scene(&path, &small_scene(20, 1)).unwrap();
    let mut app = app(dir.path().to_owned());
    let count = |mut events: MessageReader<AssetLoadFailedEvent<GaussianScene>>,
                 mut n: ResMut<FailedLoads>| {
        n.0 += events.read().count();
    };
    app.init_resource::<FailedLoads>().add_systems(Update, count);
    let assets = app.world().resource::<AssetServer>().clone();
    let handle: Handle<GaussianScene> = assets.load("a.ply");
    loaded(&mut app, &handle);
    let entity = app.world_mut().spawn(GaussianSplats(handle)).id();
    app.update();
    for n_reloads in 1..3 {
        fs::write(&path, b"no scene").unwrap();
        assets.reload("a.ply");
        let mut told = Vec::new();
        update_until(&mut app, "both tries", |world| {
            told.extend(world.resource_mut::<Messages<GaussianSceneFailed>>().drain());
            world.resource::<FailedLoads>().0 == 2 * n_reloads
        });
        app.update();
        told.extend(app.world_mut().resource_mut::<Messages<GaussianSceneFailed>>().drain());
        assert_eq!(told.iter().map(|failed| failed.entity).collect::<Vec<_>>(), [entity]);
        assert!(app.world().get::<LoadedScene>(entity).is_some(), "the scene before stays");
    }
}
