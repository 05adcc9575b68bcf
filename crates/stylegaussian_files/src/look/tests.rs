//! Look files through the public functions.

use std::{fs, sync::Arc};

use glam::{Vec2, Vec3};
use stylegaussian::{
    camera::Camera,
    splat::{Colors, render_strokes},
    strokes::{FINE_SIDE, PlainSeed, StrokeKnobs, StrokeSeed, StrokeTexture, StrokeWord, Strokes, WIDE_SIDE},
};

use super::{
    super::{
        look_from_bytes, read_look, read_scene,
        tests::{full_scene, refused, replaced},
        write_look, write_scene,
    },
    *,
};

/// A look of the 20 Gaussians of [`full_scene`], a little outside of 0..1, with a blue that is the same
/// everywhere.
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

/// Strokes of the 20 Gaussians of [`full_scene`]: two seeds in two textures, and a Gaussian without strokes.
fn strokes() -> Strokes {
    let texture = |k: usize| {
        let texels = |side: usize| {
            let texel = |i: usize| Vec3::new(((i * k) % 7) as f32, (i % side) as f32 / 99.0, 1.0) / 9.0 - 0.3;
            (0..side * side).map(texel).collect()
        };
        Arc::new(StrokeTexture::new(texels(FINE_SIDE), texels(WIDE_SIDE)))
    };
    let seed = |texture: u8| {
        PlainSeed {
            at: Vec3::new(0.1, -2.0, 3.0),
            right: Vec3::X,
            down: Vec3::NEG_Y,
            pitch: Vec2::new(100.0, 90.0),
            place: Vec2::new(300.0, 40.0),
            fine: 1.25,
            wide: 0.5,
            texture,
        }
        .packed()
    };
    let word =
        |i: u32| StrokeWord { seed: i % 2, protection: 0.25, share: (i as f32 / 9.0).min(1.0) }.packed();
    Strokes {
        seeds: vec![seed(0), seed(1)],
        words: (0..20).map(word).collect(),
        textures: vec![texture(1), texture(3)],
    }
}

/// The bytes of a look with strokes.
fn with_strokes() -> Vec<u8> {
    let mut bytes = Vec::new();
    prepare(&look().with_strokes(&full_scene(), &strokes())).unwrap().write(&mut bytes).unwrap();
    bytes
}

#[test]
fn a_look_keeps_its_strokes() {
    let bytes = with_strokes();
    let read = look_from_bytes(&bytes, "a.look.safetensors").unwrap();
    let (found, expected) = (read.strokes_for(&full_scene()).unwrap().unwrap(), strokes());
    assert_eq!((&found.words, &found.seeds), (&expected.words, &expected.seeds));
    assert_eq!(found.textures.len(), 2);
    for (a, b) in found.textures.iter().zip(&expected.textures) {
        let differences =
            a.fine[0].iter().flatten().zip(b.fine[0].iter().flatten()).map(|(a, b)| a.abs_diff(*b));
        // The finest steps: a half of luminance and one of chroma; green has its share of both.
        assert!(differences.max().unwrap() <= 3);
    }
    // 3 bytes a Gaussian of color, 4 of strokes.
    let colors_alone = sample().len();
    let textures: usize = found.textures.iter().map(|texture| texture::encode(texture).len()).sum();
    let header = 8 + usize::from(bytes[0]) + 256 * usize::from(bytes[1]);
    assert_eq!(bytes.len() - header, 7 * 20 + 2 * 32 + 24 + textures);
    assert!(colors_alone < bytes.len());
    // What was read can be drawn.
    let camera = Camera::look_at(Vec3::splat(4.0), Vec3::ZERO, Vec3::Y, 0.9, glam::UVec2::splat(24));
    let colors = read.colors_for(&full_scene()).unwrap();
    let knobs = StrokeKnobs::DEFAULT;
    let shown = (&found, &knobs);
    render_strokes(&full_scene(), Colors::Rgb(&colors), shown, &camera, None);
}

#[test]
fn lying_strokes_are_refused() {
    let write = |change: &dyn Fn(&mut Strokes)| {
        let mut strokes = strokes();
        change(&mut strokes);
        let look = Look { strokes: Some(strokes), ..look() };
        prepare(&look).err().map(|error| format!("{error:?}")).unwrap_or_default()
    };
    assert_eq!(write(&|_| ()), "");
    type Lie<'a> = (&'a dyn Fn(&mut Strokes), &'a str);
    let lies: [Lie; 6] = [
        (&|s| s.words[3] = StrokeWord { seed: 2, protection: 0.0, share: 1.0 }.packed(), "seed 2 at 3"),
        (&|s| s.words.truncate(19), "19 words"),
        (&|s| s.seeds[1] = s.seeds[1].with_texture(2), "seed 1 with texture 2"),
        (&|s| s.seeds[1].pitch = 0.0, "seed 1 at"),
        (&|s| s.seeds[0].at[2] = f32::NAN, "seed 0 at"),
        (&|s| s.seeds[0] = StrokeSeed { pitch: 1.0, ..StrokeSeed::default() }, "0 texels to a unit"),
    ];
    for (lie, part) in lies {
        assert!(write(lie).contains(part), "{part}: {}", write(lie));
    }
    // The same in a file: the words follow scale and offset.
    let bytes = with_strokes();
    let check = |bytes: &[u8], part: &str| {
        let message = refused(look_from_bytes(bytes, "a.look.safetensors"));
        assert!(message.starts_with("a.look.safetensors: found ") && message.contains(part), "{message}");
    };
    let word = StrokeWord::unpacked(strokes().words[19]).packed().to_le_bytes();
    let at = bytes.windows(4).rposition(|part| part == word).unwrap();
    let mut changed = bytes.clone();
    changed[at + 1] = 9;
    check(&changed, "expected one of 2 seeds");
    check(&replaced(&bytes, r#""texture.1""#, r#""texture.2""#), "seed 1 with texture 1");
    check(&replaced(&bytes, r#""words""#, r#""wards""#), "no tensor `words`");
    check(&replaced(&bytes, r#""version":"2""#, r#""version":"3""#), "`version` = `3`");
    check(&replaced(&bytes, "stylegaussian-look", "stylegaussian-lock"), "`format` = `stylegaussian-lock`");
    // Version 1 has no strokes.
    let older = look_from_bytes(&replaced(&bytes, r#""version":"2""#, r#""version":"1""#), "a").unwrap();
    assert!(!older.has_strokes());
}

/// A look with strokes, cut and changed at many places, gives an error or a look that can be drawn, and never a
/// panic.
#[test]
fn damaged_strokes_never_panic() {
    let bytes = with_strokes();
    let camera = Camera::look_at(Vec3::splat(4.0), Vec3::ZERO, Vec3::Y, 0.9, glam::UVec2::splat(8));
    let read = |bytes: &[u8]| {
        let Ok(look) = look_from_bytes(bytes, "a") else { return };
        let scene = full_scene();
        let (Ok(colors), Ok(Some(strokes))) = (look.colors_for(&scene), look.strokes_for(&scene)) else {
            return;
        };
        let shown = (&strokes, &StrokeKnobs::DEFAULT);
        render_strokes(&scene, Colors::Rgb(&colors), shown, &camera, None);
    };
    for end in (0..bytes.len()).step_by(1 + bytes.len() / 50) {
        read(&bytes[..end]);
    }
    let header = 8 + usize::from(bytes[0]) + 256 * usize::from(bytes[1]);
    // Scale, offset, words, colors and seeds; then the textures.
    let edge = header + 24 + 20 * 7 + 2 * 32;
    let inner = (edge..bytes.len()).step_by(1 + (bytes.len() - edge) / 40);
    for (k, at) in (0..edge).step_by(3).chain(inner).enumerate() {
        let mut damaged = bytes.clone();
        damaged[at] = [0x00, 0xff, bytes[at] ^ 0x01, bytes[at] ^ 0x80][k % 4];
        read(&damaged);
    }
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
    check(&replaced(&bytes, r#""version":"1""#, r#""version":"3""#), "`version` = `3`");
    // Version 2 is that of a look with strokes.
    check(&replaced(&bytes, r#""version":"1""#, r#""version":"2""#), "no tensor `words`");
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
