//! The rule of offsets, and files of every format with one.

use std::fs;

use glam::{Quat, Vec3};
use stylegaussian::{SceneFingerprint, axes::Axes, scene::Sh};

use super::*;
use crate::{
    Loaded, ReadOptions, read_scene, read_scene_with, scene_from_bytes, scene_to_bytes,
    tests::{dir, refused},
    write_scene, write_scene_with,
};

/// A hundred Gaussians of the size `size` in a square of the side `side` from `corner` on.
fn square(corner: DVec3, side: f64, size: f64) -> Vec<Sample> {
    let at = |i: usize| DVec3::new((i % 10) as f64, (i / 10) as f64, 0.0) * side / 9.0;
    (0..100).map(|i| (corner + at(i), size)).collect()
}

#[test]
fn an_offset_is_for_scenes_that_f32_would_round() {
    let utm = DVec3::new(651_234.0, 4_649_776.0, 123.0);
    let of = |samples: Vec<Sample>| offset(&samples, None);
    // The power of ten above 0.36, the side without a tenth at each end, is 1; that above 36 is 100.
    assert_eq!(of(square(utm, 0.45, 0.02)), utm);
    assert_eq!(of(square(utm, 45.0, 0.05)), DVec3::new(651_300.0, 4_649_800.0, 100.0));
    assert_eq!(of(square(-utm, 4.5e-3, 1e-4)).to_string(), "[-651234, -4649776, -123]");
    // As coarse for a large scene of small Gaussians, and for a small scene of large ones.
    assert_ne!(of(square(utm, 2e4, 0.5)), DVec3::ZERO);
    assert_ne!(of(square(utm, 10.0, 100.0)), DVec3::ZERO);
    // Steps of half a unit do not show in a country of Gaussians as large as houses.
    assert_eq!(of(square(utm, 5e4, 10.0)), DVec3::ZERO);
    // A toy in a room, a statue across a town, and a sky of tiny Gaussians around the origin.
    assert_eq!(of(square(DVec3::new(40.0, 1.0, -3.0), 0.2, 0.002)), DVec3::ZERO);
    assert_eq!(of(square(DVec3::splat(1000.0), 5.0, 0.01)), DVec3::ZERO);
    assert_eq!(of(square(DVec3::splat(-1e6), 2e6, 0.01)), DVec3::ZERO);
    // One Gaussian, and none that is usable.
    assert_eq!(of(vec![(DVec3::new(1.0, 2.0, 3.0), 0.01)]), DVec3::ZERO);
    assert_eq!(of(vec![(DVec3::NAN, 1.0)]), DVec3::ZERO);
    assert_eq!(of(vec![(DVec3::splat(1e300), 1.0); 3]), DVec3::ZERO);
    assert_eq!(of(Vec::new()), DVec3::ZERO);
}

#[test]
fn positions_that_f32_has_rounded_are_told() {
    let of = |samples: Vec<Sample>| {
        let scales = samples.iter().map(|&(_, size)| Vec3::splat(size as f32)).collect();
        let means = samples.iter().map(|(position, _)| position.as_vec3()).collect();
        rounded(&Scene { means, scales, ..Scene::default() })
    };
    let told = of(square(UTM, 0.45, 0.02)).unwrap();
    assert!(told.contains("rounded to 5.0e-1, the steps of f32 at 4.6e6 from the origin"), "{told}");
    assert!(of(square(UTM, 2e4, 0.5)).is_some());
    // Gaussians on both sides of the Earth have no offset in common.
    let two = [square(UTM, 0.45, 0.02), square(-UTM, 0.45, 0.02)].concat();
    assert_eq!(offset(&two, None), DVec3::ZERO);
    assert!(of(two).is_some());
    // A country of houses, a toy in a room, a statue across a town, and a few Gaussians.
    for fine in [
        square(UTM, 5e4, 10.0),
        square(DVec3::new(40.0, 1.0, -3.0), 0.2, 0.002),
        square(DVec3::splat(1000.0), 5.0, 0.01),
        square(UTM, 0.45, 0.02).split_off(90),
    ] {
        assert_eq!(of(fine), None);
    }
}

#[test]
fn strays_neither_cause_nor_prevent_an_offset() {
    let utm = DVec3::new(651_234.0, 4_649_776.0, 123.0);
    let mut samples = square(utm, 0.45, 0.02);
    samples.extend([(DVec3::ZERO, 0.02), (DVec3::splat(-1e7), 1e5), (DVec3::NAN, f64::NAN)]);
    assert_eq!(offset(&samples, None), utm);
    let mut samples = square(DVec3::ZERO, 0.45, 0.02);
    samples.extend([(utm, 0.02); 8]);
    assert_eq!(offset(&samples, None), DVec3::ZERO);
}

#[test]
fn the_offset_of_the_file_is_kept_if_the_scene_is_near_it() {
    let utm = DVec3::new(651_234.0, 4_649_776.0, 123.0);
    let samples = square(utm, 0.45, 0.02);
    let near = utm + DVec3::new(1.25, -2.0, 0.125);
    assert_eq!(offset(&samples, Some(near)), near);
    assert_eq!(offset(&samples, Some(DVec3::ZERO)), utm);
    assert_eq!(offset(&samples, Some(DVec3 { x: f64::NAN, ..near })), utm);
}

/// A `.ply` of a square of doubles, with lines of its own in the header.
fn ply(corner: DVec3, lines: &str) -> Vec<u8> {
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\n{lines}element vertex 100\n").into_bytes();
    for axis in ["x", "y", "z"] {
        bytes.extend(format!("property double {axis}\n").bytes());
    }
    let others = "opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 f_dc_0 f_dc_1 f_dc_2";
    others.split(' ').for_each(|name| bytes.extend(format!("property float {name}\n").bytes()));
    bytes.extend(b"end_header\n");
    for (position, size) in square(corner, 0.45, 0.02) {
        bytes.extend(position.to_array().iter().flat_map(|value| value.to_le_bytes()));
        let log = (size as f32).ln();
        let rest = [0.0, log, log, log, 1.0, 0.0, 0.0, 0.0, 0.5, 0.25, 0.125_f32];
        bytes.extend(rest.iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

/// The same as text.
fn ascii(corner: DVec3, kind: &str) -> Vec<u8> {
    let mut text = String::from("ply\nformat ascii 1.0\nelement vertex 100\n");
    let names = "x y z opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 f_dc_0 f_dc_1 f_dc_2";
    for name in names.split(' ') {
        text += &format!("property {} {name}\n", if name.len() == 1 { kind } else { "float" });
    }
    text += "end_header\n";
    for (DVec3 { x, y, z }, _) in square(corner, 0.45, 0.02) {
        text += &format!("{x} {y} {z} 0 -3.912023 -3.912023 -3.912023 1 0 0 0 0.5 0.25 0.125\n");
    }
    text.into_bytes()
}

/// The largest distance between the square and a scene of it.
fn error(scene: &Scene, corner: DVec3) -> f64 {
    let by_source = scene.subset(&scene.by_source());
    let expected = square(corner, 0.45, 0.02);
    assert_eq!(by_source.len(), expected.len());
    let found = by_source.means.iter().map(|mean| scene.offset + mean.as_dvec3());
    found
        .zip(&expected)
        .map(|(found, (position, _))| (found - position).abs().max_element())
        .fold(0.0, f64::max)
}

const UTM: DVec3 = DVec3::new(651_234.0, 4_649_776.0, 123.0);

#[test]
fn doubles_of_a_ply_keep_their_places() {
    for bytes in [ply(UTM, ""), ascii(UTM, "double"), ascii(UTM, "float")] {
        let Loaded { scene, warnings, .. } = scene_from_bytes(&bytes, "a.ply").unwrap();
        assert_eq!((scene.offset, warnings), (UTM, Vec::new()));
        assert!(error(&scene, UTM) < 1e-7, "{}", error(&scene, UTM));
        assert!(scene.scales.iter().all(|scale| scale.abs_diff_eq(Vec3::splat(0.02), 1e-6)));
    }
    // The rounded numbers of files near the origin are those of f32, to the bit.
    let corner = DVec3::new(0.1, -0.7, 3.3);
    let near = scene_from_bytes(&ply(corner, "comment offset 1 2 3\n"), "a.ply").unwrap().scene;
    let rounded: Vec<Vec3> = square(corner, 0.45, 0.02).iter().map(|(at, _)| at.as_vec3()).collect();
    assert_eq!((near.offset, &near.means), (DVec3::ZERO, &rounded));
    assert_eq!(scene_from_bytes(&ascii(corner, "float"), "a.ply").unwrap().scene.means, rounded);
}

#[test]
fn floats_of_a_ply_that_are_far_away_get_one_warning() {
    let near = scene_from_bytes(&ply(UTM, ""), "a.ply").unwrap().scene;
    let means = near.means.iter().map(|mean| (near.offset + mean.as_dvec3()).as_vec3()).collect();
    let far = Scene { means, offset: DVec3::ZERO, ..near };
    for name in ["a.ply", "a.sgs", "a.splat"] {
        let warnings = scene_from_bytes(&scene_to_bytes(name, &far).unwrap(), name).unwrap().warnings;
        assert!(warnings.len() == 1 && warnings[0].starts_with("positions are rounded"), "{warnings:?}");
    }
}

#[test]
fn a_file_of_doubles_with_broken_rows_loses_only_those() {
    let mut bytes = ply(UTM, "");
    let first = bytes.len() - 100 * 68;
    bytes[first..first + 8].copy_from_slice(&f64::NAN.to_le_bytes());
    let Loaded { scene, warnings, .. } = scene_from_bytes(&bytes, "a.ply").unwrap();
    assert_eq!((scene.len(), scene.order[0], scene.offset), (99, 1, UTM));
    assert!(warnings.len() == 1 && warnings[0].starts_with("dropped 1 of 100"), "{warnings:?}");
}

#[test]
fn formats_with_a_place_for_the_offset_keep_it() {
    let named = "comment offset 651233.5 4649775.25 122\ncomment up 0 0 1\n";
    let scene = scene_from_bytes(&ply(UTM, named), "a.ply").unwrap().scene;
    assert_eq!(scene.offset, DVec3::new(651_233.5, 4_649_775.25, 122.0));
    let dir = dir();
    for extension in ["ply", "sgs", "glb"] {
        let path = dir.path().join("a").with_extension(extension);
        assert_eq!(write_scene_with(&path, &scene, Default::default()).unwrap(), [""; 0]);
        let read = read_scene(&path).unwrap().scene;
        assert_eq!(read.offset, scene.offset, "{extension}");
        assert_eq!(SceneFingerprint::of(&read), SceneFingerprint::of(&scene), "{extension}");
        assert!(error(&read, UTM) < 1e-7, "{extension}");
    }
    // A GLB of z up is turned upright: its y is the scene's z, in axes that point up and back.
    let bytes = fs::read(dir.path().join("a.glb")).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.contains("\"translation\":[651233.5,122.0,-4649775.25]"), "{}", &text[..3000]);
    let options = ReadOptions { axes: Some(Axes::RUB), ..ReadOptions::default() };
    let read = read_scene_with(&dir.path().join("a.sgs"), options).unwrap().scene;
    assert_eq!(read.offset, DVec3::new(651_233.5, -4_649_775.25, -122.0));
}

#[test]
fn formats_without_a_place_for_the_offset_say_so_once() {
    let scene = scene_from_bytes(&ply(UTM, ""), "a.ply").unwrap().scene;
    let dir = dir();
    for extension in ["spz", "splat"] {
        let path = dir.path().join("a").with_extension(extension);
        let warnings = write_scene_with(&path, &scene, Default::default()).unwrap();
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(warnings[0].ends_with("cannot hold its offset 651234 4649776 123"), "{warnings:?}");
        let read = read_scene(&path).unwrap().scene;
        assert_eq!(read.offset, DVec3::ZERO);
        // Half a step of SPZ.
        assert!(error(&Scene { offset: UTM, ..read }, UTM) < 2e-4, "{extension}");
    }
}

#[test]
fn a_compressed_ply_counts_from_the_origin_of_the_scene() {
    let scene = scene_from_bytes(&ply(UTM, ""), "a.ply").unwrap().scene;
    let dir = dir();
    let path = dir.path().join("a.compressed.ply");
    let warnings = write_scene_with(&path, &scene, Default::default()).unwrap();
    assert!(warnings.len() == 1 && warnings[0].ends_with("offset 651234 4649776 123"), "{warnings:?}");
    let read = read_scene(&path).unwrap().scene;
    assert_eq!((read.offset, read.len()), (DVec3::ZERO, 100));
    // The square begins there. Half a step of the coarsest axis, of 10 bits.
    let (min, max) = read.bounds().unwrap();
    assert!(min.abs_diff_eq(Vec3::ZERO, 3e-4) && max.abs_diff_eq(Vec3::new(0.45, 0.45, 0.0), 3e-4));
}

#[test]
fn scenes_without_an_offset_are_written_as_ever() {
    let scene = Scene {
        means: vec![Vec3::new(1.0, -2.0, 3.0)],
        rotations: vec![Quat::IDENTITY],
        scales: vec![Vec3::ONE],
        opacities: vec![0.5],
        sh: Some(Sh { degree: 0, coefficients: vec![0.0; 3] }),
        order: vec![0],
        n_source: 1,
        ..Scene::default()
    };
    for name in ["a.ply", "a.sgs", "a.glb"] {
        let bytes = scene_to_bytes(name, &scene).unwrap();
        for word in ["double", "offset 0", "\"offset\":\"", "translation"] {
            assert!(!String::from_utf8_lossy(&bytes).contains(word), "{name}: {word}");
        }
    }
}

#[test]
fn an_offset_that_is_none_is_an_error() {
    let dir = dir();
    let path = dir.path().join("a.sgs");
    let scene = scene_from_bytes(&ply(UTM, ""), "a.ply").unwrap().scene;
    write_scene(&path, &scene).unwrap();
    let bytes = fs::read(&path).unwrap();
    let text = b"651234 4649776 123";
    let at = bytes.windows(text.len()).position(|window| window == text).unwrap();
    for wrong in ["651234 4649776 nan", "651234  4649776123", "651234 4649776 12x"] {
        let mut damaged = bytes.clone();
        damaged[at..at + text.len()].copy_from_slice(wrong.as_bytes());
        let message = refused(scene_from_bytes(&damaged, "a.sgs"));
        assert!(message.contains("metadata `offset`") && message.contains("three numbers"), "{message}");
    }
}
