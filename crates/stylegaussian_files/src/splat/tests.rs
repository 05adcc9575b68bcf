//! Hand-worked rows, round trips and real files.

use glam::Quat;

use super::*;
use crate::{
    read_scene, scene_from_bytes,
    tests::{full_scene, refused, shared_data},
};

/// One Gaussian, worked by hand.
fn one() -> Vec<u8> {
    let mut bytes = Vec::new();
    for value in [1.0, -2.0, 3.5, 0.25, 0.5, 2.0_f32] {
        bytes.extend(value.to_le_bytes());
    }
    // Red 1, green 0, blue 51 / 255 = 0.2, opacity 0.8; w = -1, x = y = z = 0.
    bytes.extend([255, 0, 51, 204, 0, 128, 128, 128]);
    bytes
}

#[test]
fn reads_a_hand_worked_gaussian() {
    let loaded = scene_from_bytes(&one(), "a.SPLAT").unwrap();
    let scene = &loaded.scene;
    assert_eq!((loaded.format, loaded.axes), (".splat", stylegaussian::Axes::RDF));
    assert_eq!(scene.means, [Vec3::new(1.0, -2.0, 3.5)]);
    assert_eq!(scene.scales, [Vec3::new(0.25, 0.5, 2.0)]);
    assert_eq!(scene.rotations, [Quat::from_xyzw(0.0, 0.0, 0.0, -1.0)]);
    assert!((scene.opacities[0] - 0.8).abs() < 1e-6);
    assert!(Vec3::from(scene.base_colors()[0]).abs_diff_eq(Vec3::new(1.0, 0.0, 0.2), 1e-6));
    // f_dc of white is 0.5 / Y_00.
    assert!((scene.sh.as_ref().unwrap().coefficients[0] - 1.772_453_8).abs() < 1e-5);
}

#[test]
fn broken_gaussians_are_dropped_and_broken_files_refused() {
    let mut three = [one(), one(), one()].concat();
    three[32..36].copy_from_slice(&f32::NAN.to_le_bytes());
    // A quaternion of four zeros.
    three[64 + 28] = 128;
    let loaded = scene_from_bytes(&three, "a.splat").unwrap();
    assert_eq!((loaded.scene.order, loaded.scene.n_source), (vec![0], 3));
    assert!(loaded.warnings[0].starts_with("dropped 2 of 3"), "{:?}", loaded.warnings);
    let message = refused(scene_from_bytes(&three[..95], "a.splat"));
    assert!(message.contains("a.splat: found 95 bytes, expected a multiple of 32"), "{message}");
    assert!(refused(scene_from_bytes(b"", "a.splat")).contains("an empty file"));
    // Without its extension nothing tells what it is.
    assert!(scene_from_bytes(&one(), "a.bin").is_err());
    // The ninth byte of this one is `{`, as in a safetensors file.
    let mut like_sgs = one();
    like_sgs[8] = b'{';
    assert_eq!(scene_from_bytes(&like_sgs, "a.splat").unwrap().format, ".splat");
}

#[test]
fn round_trips_within_the_steps_of_its_bytes() {
    let mut scene = full_scene();
    scene.opacities[0] = 1.0;
    scene.rotations[0] = Quat::IDENTITY;
    scene.sh.as_mut().unwrap().coefficients[0] = 3.0;
    let mut bytes = Vec::new();
    write(&mut bytes, &scene).unwrap();
    assert_eq!(bytes.len(), 32 * scene.len());
    let read = read(&bytes, &Work::default()).unwrap().scene;
    for (j, i) in scene.by_source().into_iter().enumerate() {
        let i = i as usize;
        assert_eq!((read.means[j], read.scales[j]), (scene.means[i], scene.scales[i]));
        assert!((read.opacities[j] - scene.opacities[i]).abs() <= 0.5 / 255.0 + 1e-6);
        // Each component is off by half a step of 1/128, and one of 1 by a whole step.
        let cosine = read.rotations[j].dot(scene.rotations[i]).abs();
        assert!(cosine > 1.0 - 4.0 / (128.0 * 128.0), "{cosine}");
        let (a, b) = (read.base_colors()[j], scene.base_colors()[i]);
        for (a, b) in a.into_iter().zip(b) {
            assert!((a - b.clamp(0.0, 1.0)).abs() <= 0.5 / 255.0 + 1e-6);
        }
    }
    let n_beyond = scene.base_colors().iter().filter(|rgb| rgb.iter().any(|c| *c > 1.0)).count();
    assert_eq!(n_beyond, 1);
    assert_eq!(
        super::clamped(&scene),
        [format!("{n_beyond} Gaussians have colors above 1, which were clamped")]
    );
    // What was read once stays the same.
    let mut again = Vec::new();
    write(&mut again, &read).unwrap();
    assert_eq!(again.len(), bytes.len());
    assert!(super::clamped(&read).is_empty());
    assert_eq!(super::read(&again, &Work::default()).unwrap().scene.means, read.means);
}

/// The same three Gaussians of a capture as .ply.
#[test]
fn a_real_file_matches_its_ply() {
    let names = ["splat/metalsplatter-3points-train.splat", "ply/metalsplatter-3points-train.ply"];
    let [Some(splat), Some(ply)] = names.map(|name| shared_data(&format!("zoo/{name}"))) else { return };
    let (splat, ply) = (read_scene(&splat).unwrap().scene, read_scene(&ply).unwrap().scene);
    assert_eq!((splat.len(), ply.len()), (3, 3));
    for i in 0..3 {
        // Sorted by what a Gaussian contributes, so each is looked for.
        let near = |j: &usize| splat.means[i].distance(ply.means[*j]) < 1e-5;
        let j = (0..3).find(near).expect("a twin");
        assert!(splat.scales[i].abs_diff_eq(ply.scales[j], 1e-5 * ply.scales[j].max_element()));
        assert!((splat.opacities[i] - ply.opacities[j]).abs() <= 1.0 / 255.0);
        assert!(splat.rotations[i].dot(ply.rotations[j]).abs() > 0.999);
        let (a, b) = (Vec3::from(splat.base_colors()[i]), Vec3::from(ply.base_colors()[j]));
        assert!(a.abs_diff_eq(b.clamp(Vec3::ZERO, Vec3::ONE), 1.0 / 255.0), "{a} {b}");
    }
}
