//! Mask files, and masks in scene files, through the public functions.

use std::fs;

use super::{
    super::{
        mask_from_bytes, read_mask, read_scene, scene_from_bytes,
        tests::{full_scene, refused, replaced},
        write_mask, write_scene,
    },
    *,
};
use stylegaussian::scene::Scene;

fn mask() -> Mask {
    full_scene().mask.unwrap()
}

fn stored() -> StoredMask {
    StoredMask::new(&full_scene(), &mask())
}

/// The bytes of a mask file.
pub(in super::super) fn sample() -> Vec<u8> {
    let mut bytes = Vec::new();
    prepare(&stored()).unwrap().write(&mut bytes).unwrap();
    bytes
}

#[test]
fn a_mask_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mask.safetensors");
    write_mask(&path, &stored()).unwrap();
    assert_eq!(read_mask(&path).unwrap(), stored());
    // Three channels and no more; the rest is the header.
    let size = fs::metadata(&path).unwrap().len();
    assert!(size < 3 * 20 + 400, "{size} bytes");
    for n in [0, 1] {
        let scene = full_scene().subset(&[7][..n]);
        let small = StoredMask::new(&scene, &Mask::new(n));
        write_mask(&path, &small).unwrap();
        assert_eq!(read_mask(&path).unwrap(), small);
    }
}

/// A mask goes with its Gaussians into a `.sgs` and back, and from one read from a `.ply` to one read from a
/// `.sgs`.
#[test]
fn a_mask_stays_with_its_scene() {
    let dir = tempfile::tempdir().unwrap();
    let [sgs, again, ply] = ["a.sgs", "b.sgs", "a.ply"].map(|name| dir.path().join(name));
    let original = full_scene();
    write_scene(&sgs, &original).unwrap();
    let read = read_scene(&sgs).unwrap();
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    assert_ne!(read.scene.means, original.means, "in Morton order");
    let found = read.scene.mask.as_ref().unwrap();
    assert_eq!(found.names, mask().names);
    assert_eq!(StoredMask::new(&read.scene, found), stored());
    write_scene(&again, &read.scene).unwrap();
    assert_eq!(fs::read(&sgs).unwrap(), fs::read(&again).unwrap());
    write_scene(&ply, &original).unwrap();
    let from_ply = read_scene(&ply).unwrap().scene;
    let fitted = stored().mask_for(&from_ply).unwrap();
    for (i, mean) in from_ply.means.iter().enumerate() {
        let of_original = original.means.iter().position(|other| other == mean).unwrap();
        assert_eq!(fitted.weights[i], mask().weights[of_original]);
    }
}

#[test]
fn lying_masks_are_refused() {
    let bytes = sample();
    let check = |bytes: &[u8], part: &str| {
        let message = refused(mask_from_bytes(bytes, "a.mask.safetensors"));
        assert!(message.starts_with("a.mask.safetensors: found ") && message.contains(part), "{message}");
    };
    check(&[], "broken header");
    check(&bytes[..bytes.len() - 1], "broken header");
    check(&replaced(&bytes, "stylegaussian-mask", "stylegaussian-task"), "`format` = `stylegaussian-task`");
    check(
        &replaced(&bytes, r#""scene":"20@"#, r#""scene":"21@"#),
        "`mask` [20, 3], expected tensor `mask` [21, C]",
    );
    check(&replaced(&bytes, r#""scene":"20@"#, r#""scene":"20-"#), "`scene` = `20-");
    check(&replaced(&bytes, r#""U8""#, r#""I8""#), "type I8");
    // Weights are bytes, so that none is NaN.
    let (mut numbers, mut in_numbers) = (Writer::new(FORMAT), Vec::new());
    numbers.f32(TENSOR, &[20, 1], &[f32::NAN; 20]);
    numbers.set("scene", stored().scene);
    numbers.write(&mut in_numbers).unwrap();
    check(&in_numbers, "`mask` of type F32, expected U8");
    check(&replaced(&bytes, r#"\"ink\",\"\","#, r#"\"ink,,,,,\","#), "2 names in `mask_channels`");
    check(&replaced(&bytes, r#"[\"ink\""#, r#"{\"ink\""#), "`mask_channels` of another form");
    // 12 Gaussians of five channels have as many bytes as 20 of three.
    let five = replaced(&bytes, r#""scene":"20@"#, r#""scene":"12@"#);
    check(&replaced(&five, "[20,3]", "[12,5]"), "a mask of 5 channels, expected 1 to 4");
    let lie = StoredMask { weights: Vec::new(), ..stored() };
    let path = tempfile::tempdir().unwrap().path().join("a.mask.safetensors");
    assert!(refused(write_mask(&path, &lie)).contains("0 weights, expected 20"));
}

#[test]
fn a_scene_file_with_a_lying_mask_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.sgs");
    write_scene(&path, &full_scene()).unwrap();
    let bytes = fs::read(&path).unwrap();
    let message = refused(scene_from_bytes(&replaced(&bytes, "mask_channels", "mask_chambers"), "a.sgs"));
    assert!(message.contains("no metadata `mask_channels`"), "{message}");
    let short = Scene { mask: Some(Mask::new(19)), ..full_scene() };
    assert!(refused(write_scene(&path, &short)).contains("19 mask weights, expected 20"));
}
