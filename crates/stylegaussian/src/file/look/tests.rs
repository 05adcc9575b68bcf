//! Look files through the public functions.

use std::fs;

use super::{
    super::{
        look_from_bytes, read_look, read_scene,
        tests::{full_scene, refused, replaced},
        write_look, write_scene,
    },
    *,
};

/// A look of the 20 Gaussians of [`full_scene`], a little outside of 0..1, with a blue that is the same everywhere.
fn look() -> Look {
    let scene = full_scene();
    let colors: Vec<_> = (0..20).map(|i| [i as f32 / 17.0 - 0.05, 1.0 - i as f32 / 19.0, 0.3]).collect();
    let painting = |name: &str, weight| Painting { name: name.into(), weight };
    let made_from = MadeFrom {
        paintings: vec![painting("a \"wave\".jpg", 0.25), painting("ink.png", 0.75)],
        strength: 0.7,
        steps: 80,
        seed: u64::MAX,
    };
    Look::new(&scene, &colors, made_from)
}

/// The bytes of a look file.
pub(in super::super) fn sample() -> Vec<u8> {
    let mut bytes = Vec::new();
    prepare(&look()).unwrap().write(&mut bytes).unwrap();
    bytes
}

#[test]
fn a_look_keeps_range_and_origin() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.look.safetensors");
    let original = look();
    write_look(&path, &original).unwrap();
    let read = read_look(&path).unwrap();
    assert_eq!((read.scene, &read.made_from), (original.scene, &original.made_from));
    for c in 0..3 {
        let of = |look: &Look| look.colors.iter().map(|color| color[c]).collect::<Vec<_>>();
        let (exact, rounded) = (of(&original), of(&read));
        let min = exact.iter().copied().fold(f32::INFINITY, f32::min);
        let max = exact.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        // Half a step, and the rounding of f32 at values around 1.
        let most = 0.5 * (max - min) / 255.0 + 2e-7;
        assert!(exact.iter().zip(&rounded).all(|(a, b)| (a - b).abs() <= most), "channel {c}: {rounded:?}");
        for bound in [min, max] {
            assert!(rounded.iter().any(|value| (value - bound).abs() < 2e-7), "channel {c} lacks {bound}");
        }
    }
    let without_header = fs::metadata(&path).unwrap().len() - 24;
    assert!(without_header - 3 * 20 < 700, "more than 3 bytes per Gaussian: {without_header}");
}

/// The colors of a scene that was read from its `.sgs` are for its `.ply`, and for a `.ply` that was exported.
#[test]
fn a_look_fits_its_scene_in_every_format() {
    let dir = tempfile::tempdir().unwrap();
    let [ply, sgs, exported] = ["a.ply", "a.sgs", "b.ply"].map(|name| dir.path().join(name));
    write_scene(&ply, &full_scene()).unwrap();
    write_scene(&sgs, &read_scene(&ply).unwrap().scene).unwrap();
    write_scene(&exported, &read_scene(&sgs).unwrap().scene).unwrap();
    let embedded = read_scene(&sgs).unwrap().scene;
    let colors: Vec<_> = embedded.means.iter().map(|mean| mean.to_array()).collect();
    let look = Look::new(&embedded, &colors, MadeFrom::default());
    let path = dir.path().join("a.look.safetensors");
    write_look(&path, &look).unwrap();
    let look = read_look(&path).unwrap();
    for path in [&ply, &exported] {
        let scene = read_scene(path).unwrap().scene;
        assert_ne!(scene.means, embedded.means, "the order of the Gaussians differs");
        for (mean, color) in scene.means.iter().zip(look.colors_for(&scene).unwrap()) {
            // Means lie in -1..1, so half a step is at most 1/255.
            assert!((*mean - glam::Vec3::from(color)).abs().max_element() < 1.1 / 255.0);
        }
    }
}

#[test]
fn lying_looks_are_refused() {
    let bytes = sample();
    let check = |bytes: &[u8], part: &str| {
        let message = refused(look_from_bytes(bytes, "a.look.safetensors"));
        assert!(message.starts_with("a.look.safetensors: found ") && message.contains(part), "{message}");
    };
    check(&[], "broken header");
    check(&bytes[..bytes.len() - 1], "broken header");
    check(&replaced(&bytes, "stylegaussian-look", "stylegaussian-lock"), "`format` = `stylegaussian-lock`");
    check(&replaced(&bytes, r#""version":"1""#, r#""version":"2""#), "`version` = `2`");
    check(
        &replaced(&bytes, r#""scene":"20@"#, r#""scene":"21@"#),
        "`colors` [20, 3], expected tensor `colors` [21, 3]",
    );
    check(&replaced(&bytes, r#""scene":"20@"#, r#""scene":"20-"#), "`scene` = `20-");
    check(&replaced(&bytes, r#""steps":"80""#, r#""steps":"8x""#), "`steps` = `8x`");
    check(&replaced(&bytes, r#""strength":"0.7""#, r#""strength":"nan""#), "`strength`");
    check(&replaced(&bytes, "0.25],", "null],"), "`paintings`");
    check(&replaced(&bytes, r#""U8""#, r#""I8""#), "type I8");
    check(&replaced(&bytes, r#""scale":"#, r#""scald":"#), "no tensor `scale`");
    // The tensors follow the header: offset f32 [3], scale f32 [3], colors u8 [20, 3].
    let scale = bytes.len() - 60 - 12;
    for (value, part) in [(f32::NAN, "`scale` with NaN"), (f32::MAX, "inf")] {
        let mut damaged = bytes.clone();
        damaged[scale..scale + 4].copy_from_slice(&value.to_le_bytes());
        check(&damaged, part);
    }
}

#[test]
fn what_cannot_be_read_back_is_not_written() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.look.safetensors");
    let check = |change: fn(&mut Look), part: &str| {
        let mut look = look();
        change(&mut look);
        let message = refused(write_look(&path, &look));
        assert!(message.contains("a.look.safetensors: found ") && message.contains(part), "{message}");
        assert!(!path.exists());
    };
    check(|look| look.colors[3][1] = f32::NAN, "`colors` with NaN");
    check(|look| (look.colors[3][1], look.colors[4][1]) = (f32::MAX, f32::MIN), "range");
    check(|look| look.made_from.paintings[0].weight = f64::NAN, "`weights` with NaN");
    check(|look| look.colors.truncate(3), "3 colors, expected 20");
}

#[test]
fn looks_of_one_and_of_no_gaussian() {
    for n in [0, 1] {
        let scene = full_scene().subset(&[7][..n]);
        let look = Look::new(&scene, &[[0.25, 2.0, -1.0]][..n], MadeFrom::default());
        let mut bytes = Vec::new();
        prepare(&look).unwrap().write(&mut bytes).unwrap();
        assert_eq!(look_from_bytes(&bytes, "small").unwrap(), look);
    }
}
