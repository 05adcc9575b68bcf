//! Hand-worked files, the twins and the broken files of the zoo.

use std::{f32::consts::FRAC_1_SQRT_2, fs, io::Write, path::Path};

use flate2::{Compression, write::GzEncoder};
use glam::{Quat, Vec3};
use stylegaussian::{
    axes::Axes,
    scene::{Scene, ScreenFilter, Sh},
};

use crate::{
    FileError, Loaded, ReadOptions, Reading, SceneReader, WriteOptions, read_scene, scene_from_bytes,
    tests::{dir, full_scene, refused, shared_data},
    write_scene_with,
};

/// A payload of versions 1 to 3.
fn payload(version: u32, n: u32, degree: u8, flags: u8, arrays: &[&[u8]]) -> Vec<u8> {
    let mut bytes = b"NGSP".to_vec();
    bytes.extend(version.to_le_bytes());
    bytes.extend(n.to_le_bytes());
    bytes.extend([degree, 12, flags, 0]);
    arrays.iter().for_each(|array| bytes.extend_from_slice(array));
    bytes
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn load(bytes: &[u8]) -> Loaded {
    scene_from_bytes(bytes, "a.spz").unwrap()
}

fn load_in(bytes: &[u8], axes: Axes) -> Loaded {
    let options = ReadOptions { axes: Some(axes), ..ReadOptions::default() };
    match SceneReader::new(bytes.into(), "a.spz", options).read().unwrap() {
        Reading::Scene(loaded) => *loaded,
        Reading::Needs(names) => panic!("{names:?}"),
    }
}

/// One Gaussian of version 3: (1.5, -2, 0.25), opacity 0.8, scales 1, e, 1/e, half a turn of which the x axis
/// is up.
fn one_gaussian(flags: u8, extensions: &[u8]) -> Vec<u8> {
    let arrays: [&[u8]; 7] = [
        // 1.5 * 4096 = 0x1800, -2 * 4096 = -0x2000, 0.25 * 4096 = 0x400.
        &[0x00, 0x18, 0x00, 0x00, 0xe0, 0xff, 0x00, 0x04, 0x00],
        &[204],
        &[255, 0, 51],
        &[160, 176, 144],
        // w is the largest (3), the others from z down: z = 0, y = -511/511/sqrt 2, x = 0. So w = 1/sqrt 2.
        &((3_u32 << 30) | (0x3ff << 10)).to_le_bytes(),
        // (b - 128) / 128, coefficient by coefficient.
        &[128, 192, 64, 0, 128, 255, 129, 127, 128],
        extensions,
    ];
    gzip(&payload(3, 1, 1, flags, &arrays))
}

#[test]
fn values_by_hand() {
    let Loaded { scene, warnings, format, axes, axes_because } = load_in(&one_gaussian(0, &[]), Axes::RDF);
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!((format, axes, axes_because.as_str()), ("SPZ", Axes::RDF, "they were asked for"));
    assert_eq!(scene.means, [Vec3::new(1.5, -2.0, 0.25)]);
    assert_eq!(scene.opacities, [0.8]);
    let e = std::f32::consts::E;
    assert!(scene.scales[0].abs_diff_eq(Vec3::new(1.0, e, 1.0 / e), 1e-6));
    let turn = Quat::from_xyzw(0.0, -FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2);
    assert!(scene.rotations[0].abs_diff_eq(turn, 1e-6), "{}", scene.rotations[0]);
    let sh = scene.sh.unwrap();
    // 0.5 / 0.15, -0.5 / 0.15, -0.3 / 0.15.
    let expected = [
        10.0 / 3.0,
        -10.0 / 3.0,
        -2.0,
        0.0,
        0.5,
        -0.5,
        -1.0,
        0.0,
        0.992_187_5,
        0.007_812_5,
        -0.007_812_5,
        0.0,
    ];
    assert_eq!(sh.degree, 1);
    let close = sh.coefficients.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(close, "{:?}", sh.coefficients);
    assert_eq!(scene.filter, ScreenFilter::Classic);
    assert_eq!(load(&one_gaussian(1, &[])).scene.filter, ScreenFilter::Antialiased);
}

#[test]
fn axes_are_those_of_the_specification_the_file_or_the_user() {
    let record = |kind: u32, payload: &[u8]| {
        [&kind.to_le_bytes()[..], &(payload.len() as u32).to_le_bytes(), payload].concat()
    };
    let check = |bytes: &[u8], axes: Axes, mean: [f32; 3], because: &str, n_warnings: usize| {
        let loaded = load(bytes);
        assert_eq!((loaded.axes, loaded.scene.means[0].to_array()), (axes, mean));
        assert!(loaded.axes_because.contains(because), "{}", loaded.axes_because);
        assert_eq!(loaded.warnings.len(), n_warnings, "{:?}", loaded.warnings);
    };
    check(&one_gaussian(0, &[]), Axes::RUB, [1.5, 2.0, -0.25], "specification", 0);
    let camera = record(0xADBE_0002, &[0; 12]);
    let rdf = [camera.clone(), record(0xADBE_0003, &6_u32.to_le_bytes())].concat();
    check(&one_gaussian(2, &rdf), Axes::RDF, [1.5, -2.0, 0.25], "the file says so", 0);
    // 7 is LUF, the numbers are 1 + right + 2 up + 4 front.
    let luf = record(0xADBE_0003, &7_u32.to_le_bytes());
    check(&one_gaussian(2, &luf), "luf".parse().unwrap(), [-1.5, 2.0, 0.25], "the file says so", 0);
    // 15 is LFU: left, front, up. (1.5, -2, 0.25) is 1.5 left, 2 back, 0.25 up.
    let lfu = record(0xADBE_0003, &15_u32.to_le_bytes());
    check(&one_gaussian(2, &lfu), "lub".parse().unwrap(), [-1.5, -0.25, -2.0], "quarter turn", 0);
    // 10 is RBD.
    let rbd = record(0xADBE_0003, &10_u32.to_le_bytes());
    check(&one_gaussian(2, &rbd), Axes::RDF, [1.5, 0.25, 2.0], "quarter turn", 0);
    let unspecified = record(0xADBE_0003, &0_u32.to_le_bytes());
    check(&one_gaussian(2, &unspecified), Axes::RUB, [1.5, 2.0, -0.25], "specification", 1);
    check(&one_gaussian(2, &record(1, b"abc")), Axes::RUB, [1.5, 2.0, -0.25], "specification", 1);
    check(&one_gaussian(2, &luf[..11]), Axes::RUB, [1.5, 2.0, -0.25], "specification", 1);
    // The user's word is the last.
    assert_eq!(load_in(&one_gaussian(2, &luf), Axes::RDF).scene.means[0], Vec3::new(1.5, -2.0, 0.25));
}

#[test]
fn hostile_values_become_gaussians_or_are_dropped() {
    // Three components of 1/sqrt 2, and the largest would be the root of -0.5.
    let word = |largest: u32| ((largest << 30) | 0x3fff_ffff).to_le_bytes();
    let n = 4;
    let rotations: Vec<u8> = (0..n).flat_map(word).collect();
    let arrays: [&[u8]; 5] = [&[0; 36], &[255; 4], &[0; 12], &[255; 12], &rotations];
    let scene = load(&payload(3, n, 0, 0, &arrays)).scene;
    assert!(scene.rotations.iter().all(|q| q.is_finite() && q.is_normalized()), "{:?}", scene.rotations);
    assert_eq!(scene.opacities, [1.0; 4]);
    // Versions 1 and 2: all components at 1.
    let arrays: [&[u8]; 5] = [&[0; 9], &[0], &[0; 3], &[0; 3], &[255; 3]];
    assert!(load(&payload(2, 1, 0, 0, &arrays)).scene.rotations[0].is_normalized());
    // f16 infinity and 1.
    let arrays: [&[u8]; 5] =
        [&[0, 0x7c, 0, 0, 0, 0, 0, 0x3c, 0, 0, 0, 0], &[9; 2], &[0; 6], &[0; 6], &[128; 6]];
    let loaded = load(&payload(1, 2, 0, 0, &arrays));
    assert_eq!((loaded.scene.means, loaded.scene.order), (vec![Vec3::X], vec![1]));
    assert!(loaded.warnings[0].starts_with("dropped 1 of 2"), "{:?}", loaded.warnings);
}

#[test]
fn a_bomb_stops_at_what_the_header_says() {
    // 64 MiB of zeros in 64 KiB, after a header that promises one Gaussian.
    let mut bytes = payload(3, 1, 0, 0, &[]);
    bytes.resize(1 << 26, 0);
    let message = refused(scene_from_bytes(&gzip(&bytes), "bomb.spz"));
    assert!(message.contains("bomb.spz: found more than 0 bytes after the last array"), "{message}");
    // The other way around: a promise of 2^31 - 1 Gaussians in 16 bytes.
    let message = refused(scene_from_bytes(&gzip(&payload(3, i32::MAX as u32, 3, 0, &[])), "a.spz"));
    assert!(message.contains("the end of the data in the positions"), "{message}");
    let message = refused(scene_from_bytes(&payload(2, 1, 0, 0x80, &[&[0; 19]]), "a.spz"));
    assert!(message.contains("levels of detail (flag 0x80), which is not supported"), "{message}");
}

/// The largest differences that EQUIVALENCE.md derives from the steps of SPZ: position, relative scale,
/// opacity, degree 0, other degrees, rotation. Values on the grid differ by rounding only.
const OFF_GRID: [f32; 6] = [1.0 / 8192.0, 3.18e-2, 1.0 / 510.0, 1.0 / 76.5, 1.0 / 256.0, 8e-3];
const ON_GRID: [f32; 6] = [1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 8e-3];

fn assert_equivalent(found: &Scene, expected: &Scene, tolerance: [f32; 6], name: &str) {
    assert_eq!(found.len(), expected.len(), "{name}");
    let [position, scale, opacity, dc, rest, rotation] = tolerance;
    for i in 0..found.len() {
        let at = format!("Gaussian {i} of {name}");
        // A little more than half a step, for the rounding of f32.
        assert!(found.means[i].abs_diff_eq(expected.means[i], position * 1.01), "{at}: mean");
        let ratio = found.scales[i] / expected.scales[i];
        assert!((ratio - 1.0).abs().max_element() <= scale * 1.01, "{at}: scale {ratio}");
        assert!((found.opacities[i] - expected.opacities[i]).abs() <= opacity * 1.01, "{at}: opacity");
        let (a, b) = (found.rotations[i], expected.rotations[i]);
        let b = if a.dot(b) < 0.0 { -b } else { b };
        assert!(a.abs_diff_eq(b, rotation), "{at}: {a} for {b}");
    }
    let (found, expected) = (found.sh.as_ref().unwrap(), expected.sh.as_ref().unwrap());
    assert_eq!(found.degree, expected.degree, "{name}");
    let width = found.coefficients.len() / expected.coefficients.len().max(1);
    assert_eq!(width, 1, "{name}");
    let n = 3 * stylegaussian::sh::n_coefficients(found.degree);
    for (i, (a, b)) in found.coefficients.iter().zip(&expected.coefficients).enumerate() {
        let limit = if i % n < 3 { dc } else { rest };
        assert!((a - b).abs() <= limit * 1.01, "{name}: coefficient {i}: {a} for {b}");
    }
}

#[test]
fn twins_of_the_zoo_agree_with_their_ply() {
    let Some(folder) = shared_data("zoo/equivalence") else { return };
    let read = |name: &str| read_scene(&folder.join(name)).unwrap().scene;
    let exact = read("equiv-degree3-exact-binary-le.ply");
    for name in ["equiv-degree3-exact-v2.spz", "equiv-degree3-exact-v3.spz"] {
        assert_equivalent(&read(name), &exact, ON_GRID, name);
    }
    let name = "equiv-degree1-offgrid-v2.spz";
    assert_equivalent(&read(name), &read("equiv-degree1-offgrid-binary-le.ply"), OFF_GRID, name);
}

#[test]
fn good_files_of_the_zoo_read_with_their_counts() {
    let Some(zoo) = shared_data("zoo") else { return };
    let check = |name: &str, n: usize, degree: u8| {
        let loaded = read_scene(&zoo.join(name)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((loaded.format, loaded.scene.len()), ("SPZ", n), "{name}");
        assert_eq!(loaded.scene.sh.map(|sh| sh.degree), Some(degree), "{name}");
        loaded.warnings
    };
    for (name, n, degree) in [
        ("gsplat-rs-minimal_v4_degree0", 8, 0),
        ("leica-sofort-top8192", 8192, 3),
        ("metalsplatter-3points-train", 3, 3),
        ("splat-transform-minimal-raw", 4, 0),
        ("splat-transform-minimal-v2", 4, 0),
        ("splat-transform-minimal-v3", 4, 0),
        ("splat-transform-minimal-v4", 4, 0),
        ("wgpu-3dgs-model", 9, 3),
    ] {
        assert!(check(&format!("spz/{name}.spz"), n, degree).is_empty(), "{name}");
    }
    let fixture = |name: &str, n, degree| check(&format!("fixtures-usd3dgs/spz/{name}.spz"), n, degree);
    for (name, n, degree) in [
        ("decode-degree1-v2", 2, 1),
        ("decode-degree3-v2", 2, 3),
        ("decode-v1", 1, 0),
        ("decode-v3", 1, 0),
        ("degree3-v2", 1, 3),
        ("header-fields-v2", 1, 0),
        ("minimal-v1", 1, 0),
        ("minimal-v2", 1, 0),
        ("minimal-v3", 1, 0),
        // Without gzip, as several programs read it.
        ("plaintext-v2", 1, 0),
        ("three-points-degree1-v2", 3, 1),
    ] {
        assert!(fixture(name, n, degree).is_empty(), "{name}");
    }
    for name in ["decode-degree4-v2", "degree4-v2"] {
        assert_eq!(fixture(name, 1, 3), ["dropped spherical harmonics beyond degree 3"], "{name}");
    }
    assert_eq!(fixture("extensions-v2", 1, 0), ["ignored extension records that are cut short"]);
    let flags = read_scene(&zoo.join("spz/leica-sofort-top8192.spz")).unwrap().scene.filter;
    assert_eq!(flags, ScreenFilter::Antialiased);
}

#[test]
fn broken_files_of_the_zoo_are_refused() {
    let Some(folder) = shared_data("zoo/fixtures-usd3dgs/spz") else { return };
    for (name, part) in [
        ("bad-crc-v2", "broken gzip data"),
        ("bad-fhcrc-v2", "broken gzip data"),
        ("bad-isize-v2", "broken gzip data"),
        ("corrupt-deflate", "broken gzip data"),
        ("count-exceeds-stream-v2", "the end of the data in the positions"),
        ("decode-nonfinite-v1", "no usable Gaussian among 1"),
        ("empty-points-v2", "no Gaussian"),
        ("gzip-not-spz", "data that starts with `a gz`"),
        ("huge-count-v2", "2147483648 Gaussians"),
        ("not-spz", "a file that starts with `this fil`"),
        ("plaintext-v4", "found 96 bytes, expected an SPZ header and a table of streams"),
        ("sh-degree-5-v2", "degree 5"),
        ("short-stream", "the end of the data in the SPZ header"),
        ("trailing-after-member-v2", "8 bytes after the gzip data"),
        ("trailing-decompressed-v2", "bytes after the last array"),
        ("truncated-deflate-v2", "broken gzip data"),
        ("truncated-gzip-header", "broken gzip data"),
        ("truncated-payload-v2", "the end of the data"),
        ("version-0", "SPZ version 0"),
        ("version-5", "SPZ version 5"),
    ] {
        let message = refused(read_scene(&folder.join(format!("{name}.spz"))));
        assert!(message.contains(part) && message.contains(name), "{name}: {message}");
    }
}

/// Writes a scene and reads it back.
fn round_trip(scene: &Scene, options: WriteOptions) -> (Loaded, Vec<u8>) {
    let dir = dir();
    let path = dir.path().join("a.spz");
    write_scene_with(&path, scene, options).unwrap();
    (read_scene(&path).unwrap(), fs::read(&path).unwrap())
}

/// The errors of our own files: half a step each. The opacity, degree 0 and scale are as in [`OFF_GRID`].
fn steps(fractional_bits: i32) -> [f32; 6] {
    let [_, scale, opacity, dc, _, _] = OFF_GRID;
    // A coefficient of almost 1 becomes 127/128. Three components with an error d each, d half of 1 / (511 sqrt
    // 2), move the fourth by at most 3 d, since that is at least 1/2.
    let rotation = 3.0 * 0.5 / (511.0 * 2.0_f32.sqrt());
    [0.5_f32.powi(fractional_bits + 1), scale, opacity, dc, 1.0 / 128.0, rotation]
}

#[test]
fn what_is_written_comes_back_within_half_a_step() {
    let scene = full_scene();
    let by_source = scene.subset(&scene.by_source());
    for spz_version in [3, 4] {
        let options = WriteOptions { spz_version, ..WriteOptions::default() };
        let (Loaded { scene: read, warnings, axes, .. }, bytes) = round_trip(&scene, options);
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!((axes, read.filter), (Axes::RUB, ScreenFilter::Antialiased));
        assert_equivalent(&read, &by_source, steps(12), &format!("version {spz_version}"));
        assert_eq!(bytes.starts_with(b"NGSP"), spz_version == 4);
        // Without spherical harmonics the last array is left out.
        let plain = round_trip(&scene, WriteOptions { sh_degree: 0, spz_version, ..options }).0.scene;
        assert_eq!(plain.sh.as_ref().map(|sh| sh.degree), Some(0));
        assert_eq!(plain.base_colors(), read.base_colors());
    }
    let gray = Scene { sh: None, ..scene.clone() };
    let colors = round_trip(&gray, WriteOptions::default()).0.scene.base_colors();
    assert!(colors.as_flattened().iter().all(|value| (value - 0.5).abs() < 0.005), "{colors:?}");
    let dir = dir();
    let options = WriteOptions { spz_version: 2, ..WriteOptions::default() };
    let message = refused(write_scene_with(&dir.path().join("a.spz"), &scene, options));
    assert!(message.contains("SPZ version 2, expected 3 or 4"), "{message}");
}

#[test]
fn bytes_of_one_gaussian_by_hand() {
    let rotation = Quat::from_xyzw(0.5, -0.5, -0.5, -0.5);
    let scene = Scene {
        means: vec![Vec3::new(1.5, -2.0, 0.25)],
        rotations: vec![rotation],
        scales: vec![Vec3::new(1.0, 0.0, 1e9)],
        opacities: vec![0.8],
        sh: Some(Sh { degree: 0, coefficients: vec![0.0, 2.0, -9.0] }),
        order: vec![0],
        n_source: 1,
        ..Scene::default()
    };
    let dir = dir();
    let path = dir.path().join("a.spz");
    write_scene_with(&path, &scene, WriteOptions::default()).unwrap();
    let mut plain = Vec::new();
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(&fs::read(&path).unwrap()[..]), &mut plain)
        .unwrap();
    let mut expected = payload(3, 1, 0, 0, &[]);
    // RUB: (1.5, 2, -0.25) times 4096 is 0x1800, 0x2000, -0x400.
    expected.extend([0x00, 0x18, 0x00, 0x00, 0x20, 0x00, 0x00, 0xfc, 0xff]);
    // 0.8 * 255; 127.5 rounds up, 0.8 * 255, below 0; (0 + 10) * 16, ln 0, beyond 255.
    expected.extend([204, 128, 204, 0, 160, 0, 255]);
    // x, -y, -z, w is (0.5, 0.5, 0.5, -0.5). x counts as the largest; 0.5 sqrt 2 * 511 = 361.3.
    expected.extend(((361_u32 << 20) | (361 << 10) | 361 | 1 << 9).to_le_bytes());
    assert_eq!(plain, expected);
}

#[test]
fn positions_take_the_bits_that_a_scene_needs() {
    let bits = |largest: f32, scale: f32| {
        let mut scene = full_scene();
        scene.means[3].z = largest;
        scene.scales.fill(Vec3::splat(scale));
        let (loaded, _) = round_trip(&scene, WriteOptions { spz_version: 4, ..WriteOptions::default() });
        // Offset 13 of the header.
        let bits = round_trip(&scene, WriteOptions { spz_version: 4, ..WriteOptions::default() }).1[13];
        let by_source = scene.subset(&scene.by_source());
        let half_a_step = 0.5_f32.powi(i32::from(bits) + 1);
        for (found, expected) in loaded.scene.means.iter().zip(&by_source.means) {
            // And the rounding of f32 at the largest coordinate.
            assert!(
                found.abs_diff_eq(*expected, half_a_step + largest * f32::EPSILON),
                "{found} for {expected}"
            );
        }
        bits
    };
    assert_eq!(bits(1.0, 0.01), 12);
    // 2^23 / 4096 is 2048.
    assert_eq!((bits(2047.9, 0.01), bits(2048.1, 0.01), bits(8e6, 0.01)), (12, 11, 0));
    // 8 / 2^15 is 2.4e-4.
    assert_eq!((bits(1.0, 3e-4), bits(240.0, 3e-4), bits(300.0, 3e-4), bits(1.0, 0.0)), (15, 15, 14, 22));
    let mut scene = full_scene();
    scene.means[0].x = -9e6;
    let dir = dir();
    let message = refused(write_scene_with(&dir.path().join("a.spz"), &scene, WriteOptions::default()));
    assert!(message.contains("coordinate 9000000, expected 8388607 at most in SPZ"), "{message}");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "nothing is left behind");
}

#[test]
fn what_a_byte_cannot_hold_is_counted() {
    let dir = dir();
    let path = dir.path().join("a.spz");
    let mut scene = full_scene();
    let warnings = |scene: &Scene, options| write_scene_with(&path, scene, options).unwrap();
    let nothing: [&str; 0] = [];
    assert_eq!(warnings(&scene, WriteOptions::default()), nothing);
    // e^6 is beyond byte 255, e^5.9375; a thickness of 0 is byte 0.
    scene.scales[3] = Vec3::new(400.0, 1.0, 0.0);
    scene.scales[4] = Vec3::new(1.0, 1.0, 0.0);
    let sh = scene.sh.as_mut().unwrap();
    // 0.5 + 0.15 * 3.4 is 1.01, and the end of the others is 127/128.
    sh.coefficients[27] = 3.4;
    (sh.coefficients[27 + 3], sh.coefficients[27 + 26], sh.coefficients[2 * 27 + 5]) = (-1.1, 1.0, 0.99);
    let found = warnings(&scene, WriteOptions::default());
    let expected = ["sizes", "colors", "spherical harmonics beyond degree 0"]
        .map(|what| format!("1 Gaussians have {what} that SPZ cannot hold, which were clamped"));
    assert_eq!(found, expected);
    // What is not written is not clamped.
    assert_eq!(warnings(&scene, WriteOptions { sh_degree: 0, ..WriteOptions::default() }), expected[..2]);
}

#[test]
fn gzip_headers_with_everything() {
    let plain = one_gaussian(0, &[]);
    let mut head = plain[..10].to_vec();
    // Checksum, extra field, name and comment.
    head[3] = 0b1_1110;
    head.extend([3, 0, 1, 2, 3]);
    head.extend(vec![b'x'; 70_000]);
    head.extend(b"\0a comment\0");
    let mut checksum = flate2::Crc::new();
    checksum.update(&head);
    let checksum = (checksum.sum() as u16).to_le_bytes();
    let whole = |checksum: [u8; 2]| [&head[..], &checksum, &plain[10..]].concat();
    assert_eq!(load(&whole(checksum)).scene.means, load(&plain).scene.means);
    let message = refused(scene_from_bytes(&whole([checksum[0] ^ 1, checksum[1]]), "a.spz"));
    assert!(message.contains("broken gzip data (a header of another checksum)"), "{message}");
    for (at, byte) in [(2, 7), (3, 0x20)] {
        let mut bytes = plain.clone();
        bytes[at] = byte;
        assert!(refused(scene_from_bytes(&bytes, "a.spz")).contains("broken gzip data (method"));
    }
}

/// Reads whatever `bytes` are, and checks the scene if they are one.
fn survives(bytes: &[u8]) -> Result<Loaded, FileError> {
    let loaded = scene_from_bytes(bytes, "a.spz");
    if let Ok(loaded) = &loaded {
        crate::check::check_scene(&loaded.scene).map_err(|mismatch| mismatch.at(Path::new("a.spz")))?;
    }
    loaded
}

#[test]
fn damaged_files_are_errors_or_scenes() {
    let mut files = vec![one_gaussian(2, &[3, 0, 0xBE, 0xAD, 4, 0, 0, 0, 6, 0, 0, 0])];
    if let Some(folder) = shared_data("zoo/spz") {
        files.push(fs::read(folder.join("gsplat-rs-minimal_v4_degree0.spz")).unwrap());
    }
    for bytes in files {
        survives(&bytes).unwrap();
        for at in 0..bytes.len() {
            assert!(survives(&bytes[..at]).is_err(), "cut after {at} bytes");
            for change in [0x00, 0xff, bytes[at] ^ 0x01, bytes[at] ^ 0x80] {
                let mut damaged = bytes.clone();
                damaged[at] = change;
                // Scene or error, but no panic, and no scene that breaks the rules.
                if let Err(error) = survives(&damaged) {
                    assert!(!error.to_string().contains("valid scene"), "{error}");
                }
            }
        }
    }
}
