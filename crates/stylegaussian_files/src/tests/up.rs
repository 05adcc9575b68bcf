//! The up direction, from every format to every other.

use super::*;

/// The formats that keep it. The others have no place for it.
const KEEPING: [&str; 5] = ["a.sgs", "a.ply", "a.compressed.ply", "a.glb", "a.spz"];

/// The largest angle by which a direction changes on its way, in radians: files keep f32, and .ply text.
const ROUNDING: f32 = 1e-6;

#[test]
fn every_format_with_a_place_for_it_keeps_it() {
    let through = |name: &str, scene: &Scene| {
        scene_from_bytes(&scene_to_bytes(name, scene).unwrap(), name).unwrap().scene
    };
    for up in [Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::new(0.1, -1.0, 0.3), Vec3::new(-0.9, 0.2, 0.4)] {
        let source = Scene { up: Some(up), ..full_scene() };
        for from in KEEPING {
            let once = through(from, &source);
            for to in KEEPING {
                let twice = through(to, &once);
                for (scene, name) in [(&once, from), (&twice, to)] {
                    let found = scene.up.unwrap_or_else(|| panic!("{up} is lost in {from} to {to}"));
                    let off = found.normalize().distance(up.normalize());
                    assert!(off < ROUNDING, "{up} is {found} in {name} ({from} to {to})");
                    // And the scene has not turned beneath it.
                    let heights = |scene: &Scene| {
                        let along = scene.means.iter().map(|mean| mean.dot(up));
                        along.fold((f32::MAX, f32::MIN), |(low, high), h| (low.min(h), high.max(h)))
                    };
                    let ((low, high), (was_low, was_high)) = (heights(scene), heights(&source));
                    assert!((low - was_low).abs().max((high - was_high).abs()) < 0.01, "{name}");
                }
            }
        }
    }
}

/// A scene whose up direction is not known must not get one on the way.
#[test]
fn nothing_is_made_up() {
    let dir = dir();
    let source = Scene { up: None, ..full_scene() };
    for name in KEEPING {
        let path = dir.path().join(name);
        write_scene(&path, &source).unwrap();
        assert_eq!(read_scene(&path).unwrap().scene.up, None, "{name}");
    }
}

/// A capture that lay on its side once it had been written: its file says nothing but who wrote it.
#[test]
fn a_scene_of_supersplat_stands_in_every_format() {
    let Some(path) = shared_data("splats/biker.compressed.ply") else { return };
    let scene = read_scene(&path).unwrap().scene;
    assert_eq!(scene.up, Some(Vec3::NEG_Y));
    // y of a picture points down.
    let up_of = |scene: &Scene| {
        let cameras = stylegaussian::views::orbit(scene, 4, UVec2::splat(64));
        cameras
            .iter()
            .map(|camera| Vec3::from(-camera.view_from_world.matrix3.row(1)))
            .sum::<Vec3>()
            .normalize()
    };
    assert!(up_of(&scene).dot(Vec3::NEG_Y) > 0.999, "{}", up_of(&scene));
    let dir = dir();
    for name in ["a.sgs", "a.compressed.ply"] {
        let path = dir.path().join(name);
        write_scene(&path, &scene).unwrap();
        let again = read_scene(&path).unwrap().scene;
        assert!(up_of(&again).dot(Vec3::NEG_Y) > 0.999, "{name}: {}", up_of(&again));
    }
    let unknown = Scene { up: None, ..scene };
    let path = dir.path().join("b.sgs");
    write_scene(&path, &unknown).unwrap();
    let again = read_scene(&path).unwrap().scene;
    eprintln!("guessed {} and {} in another order", up_of(&unknown), up_of(&again));
}
