//! Files written here byte by byte at every level, and a real one.

use glam::Quat;

use super::{
    header::{HEADER, SECTION_HEADER},
    *,
};
use crate::{read_scene, scene_from_bytes, tests::shared_data};

/// Three Gaussians of SH degree 1 in buckets of two: one full, one with a single Gaussian.
pub(crate) fn file(level: u16) -> Vec<u8> {
    let mut bytes = vec![0; HEADER + SECTION_HEADER];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(1, &[1]);
    put(4, &1_u32.to_le_bytes());
    put(16, &3_u32.to_le_bytes());
    put(20, &level.to_le_bytes());
    put(36, &(-1_f32).to_le_bytes());
    put(40, &1_f32.to_le_bytes());
    // Count, room, size of a bucket, buckets; block 8; bytes of a bucket; default range; one full, one partial;
    // degree 1.
    for (i, value) in [3_u32, 4, 2, 2].into_iter().enumerate() {
        put(HEADER + 4 * i, &value.to_le_bytes());
    }
    put(HEADER + 16, &8_f32.to_le_bytes());
    put(HEADER + 20, &12_u16.to_le_bytes());
    put(HEADER + 32, &1_u32.to_le_bytes());
    put(HEADER + 36, &1_u32.to_le_bytes());
    put(HEADER + 40, &1_u16.to_le_bytes());
    bytes.extend(1_u32.to_le_bytes());
    for center in [10.0, 0.0, 0.0, -10.0, 0.0, 5.0_f32] {
        bytes.extend(center.to_le_bytes());
    }
    for i in 0..3_u16 {
        push_row(level, i, &mut bytes);
    }
    bytes
}

/// At (1, 2, i) or, in units of half a block, at center + (1, 0, -1) * 4; scales 0.5, 1, 2; a half turn about
/// x; red 1, opacity 0.2; coefficients -1 + i / 4 for i = 0..9.
fn push_row(level: u16, i: u16, bytes: &mut Vec<u8>) {
    match level {
        0 => [1.0, 2.0, f32::from(i)].into_iter().for_each(|value| bytes.extend(value.to_le_bytes())),
        _ => [2 * 32_767, 32_767, 0_u16].into_iter().for_each(|step| bytes.extend(step.to_le_bytes())),
    }
    let push = |value: f32| match level {
        0 => bytes.extend(value.to_le_bytes()),
        _ => bytes.extend(f16::from_f32(value).to_le_bytes()),
    };
    [0.5, 1.0, 2.0, 0.0, 2.0, 0.0, 0.0].into_iter().for_each(push);
    bytes.extend([255, 0, 0, 51]);
    for coefficient in 0..9 {
        let value = -1.0 + coefficient as f32 / 4.0;
        match level {
            0 => bytes.extend(value.to_le_bytes()),
            1 => bytes.extend(f16::from_f32(value).to_le_bytes()),
            // -1..1 in 255 steps: 127.5 per unit.
            _ => bytes.push((127.5 * (value + 1.0)).round() as u8),
        }
    }
}

#[test]
fn all_levels_give_the_same_gaussians() {
    for level in 0..=2 {
        let loaded = scene_from_bytes(&file(level), "a.ksplat").unwrap();
        let scene = &loaded.scene;
        assert_eq!((loaded.format, scene.len()), (".ksplat", 3));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let means = match level {
            0 => [0.0, 1.0, 2.0].map(|z| Vec3::new(1.0, 2.0, z)),
            _ => [Vec3::new(14.0, 0.0, -4.0), Vec3::new(14.0, 0.0, -4.0), Vec3::new(-6.0, 0.0, 1.0)],
        };
        assert_eq!(scene.means, means, "level {level}");
        for i in 0..3 {
            assert_eq!(scene.scales[i], Vec3::new(0.5, 1.0, 2.0));
            assert_eq!(scene.rotations[i], Quat::from_xyzw(1.0, 0.0, 0.0, 0.0));
            assert!((scene.opacities[i] - 0.2).abs() < 1e-6);
            assert!(Vec3::from(scene.base_colors()[i]).abs_diff_eq(Vec3::X, 1e-6));
            let sh = scene.sh.as_ref().unwrap();
            // Channel-major in the file: coefficient 1 has numbers 0, 3 and 6.
            let step = if level == 2 { 0.5 / 127.5 } else { 0.0 };
            for (found, expected) in sh.coefficients[12 * i + 3..12 * i + 6].iter().zip([-1.0, -0.25, 0.5]) {
                assert!((found - expected).abs() <= step + 1e-6, "level {level}: {found} for {expected}");
            }
        }
    }
}

#[test]
fn a_file_that_lies_is_refused() {
    let check = |at: usize, value: &[u8], part: &str| {
        let mut bytes = file(1);
        bytes[at..at + value.len()].copy_from_slice(value);
        let error = read(&bytes, &Work::default()).map(|_| ()).expect_err(part);
        let message = format!("found {}, expected {}", error.found, error.expected);
        assert!(message.contains(part), "{message}");
    };
    check(0, &[1], "version 1.1");
    check(1, &[0], "version 0.0");
    check(20, &[3], "compression level 3");
    check(4, &u32::MAX.to_le_bytes(), "room for 4294967295 headers");
    check(HEADER, &u32::MAX.to_le_bytes(), "room for section 0");
    check(HEADER + 12, &u32::MAX.to_le_bytes(), "room for section 0");
    check(HEADER + 36, &u32::MAX.to_le_bytes(), "room for section 0");
    check(HEADER + 40, &[4], "degree 4");
    // Two buckets have centers; the full one is gone.
    check(HEADER + 32, &[0], "buckets for 1 of 3");
    check(HEADER + 20, &[4], "buckets for");
    let whole = file(2);
    for end in [0, 100, HEADER, HEADER + SECTION_HEADER, whole.len() - 1] {
        assert!(scene_from_bytes(&whole[..end], "a.ksplat").is_err(), "{end} bytes");
    }
    // A bucket of 2^32 Gaussians is not walked one by one.
    let mut endless = file(1);
    endless[HEADER + 8..HEADER + 12].copy_from_slice(&u32::MAX.to_le_bytes());
    endless[HEADER + 32..HEADER + 36].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(read(&endless, &Work::default()).unwrap().scene.means[2].x, 14.0);
}

/// The same four Gaussians as .splat.
#[test]
fn a_real_file_matches_its_splat() {
    let names = ["ksplat/splat-transform-minimal.ksplat", "splat/splat-transform-minimal.splat"];
    let [Some(ksplat), Some(splat)] = names.map(|name| shared_data(&format!("zoo/{name}"))) else { return };
    let (a, b) = (read_scene(&ksplat).unwrap().scene, read_scene(&splat).unwrap().scene);
    assert_eq!((a.len(), &a.means, &a.scales), (4, &b.means, &b.scales));
    assert_eq!((&a.opacities, a.base_colors()), (&b.opacities, b.base_colors()));
    for (a, b) in a.rotations.iter().zip(&b.rotations) {
        assert!(a.dot(*b).abs() > 0.9999);
    }
}
