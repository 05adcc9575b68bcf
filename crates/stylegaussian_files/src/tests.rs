//! All formats through the public functions.

use std::{fs, path::PathBuf};

use glam::{DVec3, Quat, UVec2, Vec3};
use stylegaussian::{
    camera::Camera,
    decoder::{Activation, Layer},
    encoder_id::EncoderId,
    mask::Mask,
    neighbors::Neighbors,
    scene::{Features, Scene, ScreenFilter, Sh},
};

use super::*;

mod options;
mod up;
mod wanted;

/// A stream of numbers in -1..1, the same in every run (xorshift).
fn noise() -> impl FnMut() -> f32 {
    let mut state = 0x9e37_79b9_u32;
    move || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as f32 / u32::MAX as f32 * 2.0 - 1.0
    }
}

fn values(n: usize, next: &mut impl FnMut() -> f32) -> Vec<f32> {
    (0..n).map(|_| next()).collect()
}

fn decoder(channels: &[usize], k: usize, next: &mut impl FnMut() -> f32) -> Decoder {
    let layers = channels.windows(2).map(|d| Layer {
        weight: values(d[1] * k * d[0], next),
        bias: values(d[1], next),
        d_in: d[0],
        d_out: d[1],
    });
    let layers = layers.collect();
    Decoder {
        layers,
        k,
        activation: Activation::LeakyRelu { slope: 0.2 },
        residual: 0.25,
        base_color: true,
        n_noise: 2,
        smoothing_passes: 1,
        statistics_weight: values(channels[1] * 6, next),
        ..Decoder::default()
    }
}

/// A scene with every optional part, 20 of 25 source Gaussians. Numbers that files hold as f16 are exact in
/// f16.
pub(super) fn full_scene() -> Scene {
    let mut next = noise();
    let n = 20;
    let mut half = |count: usize| -> Vec<f32> {
        values(count, &mut next).into_iter().map(|v| half::f16::from_f32(v).to_f32()).collect()
    };
    let (sh, features, extra) = (half(n * 27), half(n * 4), half(n * 2));
    let vectors = |next: &mut dyn FnMut() -> f32| (0..n).map(|_| Vec3::new(next(), next(), next())).collect();
    let means = vectors(&mut next);
    let log_scales: Vec<Vec3> = vectors(&mut next);
    let encoder: EncoderId = "vgg@0123456789abcdef".parse().unwrap();
    let mut decoder = decoder(&[8, 5, 3], 3, &mut next);
    decoder.encoder = Some(encoder.clone());
    Scene {
        means,
        offset: DVec3::ZERO,
        rotations: (0..n).map(|i| Quat::from_rotation_x(i as f32 * 0.3)).collect(),
        scales: log_scales.into_iter().map(Vec3::exp).collect(),
        opacities: values(n, &mut next).into_iter().map(|v| v * 0.49 + 0.5).collect(),
        sh: Some(Sh { degree: 2, coefficients: sh }),
        // 7 is coprime to 23, so these are distinct. The largest is 22.
        order: (0..n as u32).map(|i| (i * 7 + 3) % 23).collect(),
        n_source: 25,
        features: Some(Features {
            values: features,
            n_latent: 4,
            basis: values(24, &mut next),
            offset: values(6, &mut next),
            extra,
            n_extra: 2,
            encoder: Some(encoder),
        }),
        neighbors: Some(Neighbors {
            k: 2,
            indices: (0..n as u32).flat_map(|i| [i, (i + 1) % n as u32]).collect(),
        }),
        decoder: Some(decoder),
        mask: Some(mask(n)),
        filter: ScreenFilter::Antialiased,
        up: Some(Vec3::new(0.0, -1.0, 0.25)),
        cameras: vec![
            Camera::look_at(Vec3::new(1.0, 2.0, -3.0), Vec3::ZERO, Vec3::NEG_Y, 0.8, UVec2::new(640, 480)),
            Camera::look_at(Vec3::new(0.5, -4.0, 1.0), Vec3::X, Vec3::NEG_Y, 1.1, UVec2::new(480, 640)),
        ],
        frame: None,
        source: Some("made up, \"quoted\"".into()),
        license: Some("CC0-1.0".into()),
    }
}

/// A mask of a channel of numbers, an empty one and one with a name.
fn mask(n: usize) -> Mask {
    let mut mask = Mask::new(n);
    mask.names = ["ink", "", "a \"wave\"", ""].map(String::from);
    (0..n).for_each(|i| mask.weights[i] = [13 * i as u8, 0, 255 - i as u8, 0]);
    mask
}

/// The scene in the source's order.
fn by_source(scene: &Scene) -> Scene {
    let mut indices: Vec<u32> = (0..scene.len() as u32).collect();
    indices.sort_by_key(|&i| scene.order[i as usize]);
    scene.subset(&indices)
}

/// The message of an expected error.
pub(super) fn refused<T>(result: Result<T, FileError>) -> String {
    match result {
        Ok(_) => panic!("no error"),
        Err(error) => error.to_string(),
    }
}

pub(super) fn dir() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

#[test]
fn sgs_keeps_everything() {
    let dir = dir();
    let path = dir.path().join("scene.sgs");
    let scene = full_scene();
    write_scene(&path, &scene).unwrap();
    let Loaded { scene: read, warnings, .. } = read_scene(&path).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert!(stylegaussian::morton::order(&read.means).is_sorted(), "Morton order");
    let (a, b) = (by_source(&scene), by_source(&read));
    assert_eq!(a.order, b.order);
    assert_eq!((a.means, a.scales, a.opacities), (b.means, b.scales, b.opacities));
    assert_eq!(a.rotations, b.rotations);
    assert_eq!(b.n_source, 25);
    assert_eq!(a.neighbors, b.neighbors);
    assert_eq!(a.decoder, b.decoder);
    assert_eq!((a.up, a.source, a.license), (b.up, b.source, b.license));
    let numbers = |camera: &Camera| (camera.view_from_world, camera.focal, camera.center, camera.size);
    assert!(a.cameras.iter().map(numbers).eq(b.cameras.iter().map(numbers)));
    assert_eq!(b.filter, ScreenFilter::Antialiased);
    assert_eq!(a.mask.unwrap().weights, b.mask.unwrap().weights);
    let (a_sh, b_sh) = (a.sh.unwrap(), b.sh.unwrap());
    assert_eq!((a_sh.degree, a_sh.coefficients), (b_sh.degree, b_sh.coefficients));
    let (a, b) = (a.features.unwrap(), b.features.unwrap());
    assert_eq!((a.values, a.n_latent, a.basis, a.offset), (b.values, b.n_latent, b.basis, b.offset));
    assert_eq!((a.extra, a.n_extra, a.encoder), (b.extra, b.n_extra, b.encoder));
}

#[test]
fn sgs_is_the_same_byte_for_byte() {
    let dir = dir();
    let paths = ["a.sgs", "b.sgs"].map(|name| dir.path().join(name));
    for path in &paths {
        write_scene(path, &full_scene()).unwrap();
    }
    assert_eq!(fs::read(&paths[0]).unwrap(), fs::read(&paths[1]).unwrap());
}

#[test]
fn full_rank_and_checkpoint_features_stay_exact() {
    let dir = dir();
    let path = dir.path().join("scene.sgs");
    for full_rank in [false, true] {
        let mut scene = full_scene();
        scene.decoder = None;
        let features = scene.features.as_mut().unwrap();
        if full_rank {
            features.basis = vec![1.0; 16];
            features.offset = vec![0.0; 4];
        } else {
            features.encoder = None;
        }
        features.values[5] = 0.123_456_78;
        write_scene(&path, &scene).unwrap();
        let read = by_source(&read_scene(&path).unwrap().scene);
        assert_eq!(by_source(&scene).features.unwrap().values, read.features.unwrap().values);
    }
}

#[test]
fn ply_keeps_gaussians_and_colors_in_source_order() {
    let dir = dir();
    let path = dir.path().join("scene.PLY");
    let mut scene = full_scene();
    scene.opacities[3] = 1.0;
    scene.opacities[4] = 0.0;
    scene.scales[5].z = 0.0;
    write_scene(&path, &scene).unwrap();
    let Loaded { scene: read, warnings, .. } = read_scene(&path).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let sorted = by_source(&scene);
    assert_eq!(read.up, Some(scene.up.unwrap().normalize()), "a comment in the header");
    assert_eq!(read.filter, ScreenFilter::Antialiased, "another comment");
    assert_eq!(read.means, sorted.means);
    assert_eq!(read.order, (0..20).collect::<Vec<_>>());
    assert_eq!(read.sh.as_ref().unwrap().coefficients, sorted.sh.unwrap().coefficients);
    for i in 0..20 {
        assert!(read.scales[i].abs_diff_eq(sorted.scales[i], 1e-5));
        assert!(read.rotations[i].abs_diff_eq(sorted.rotations[i], 1e-6));
        assert!((read.opacities[i] - sorted.opacities[i]).abs() < 1e-6);
    }
}

#[test]
fn stylized_colors_come_back_from_ply() {
    let dir = dir();
    let path = dir.path().join("styled.ply");
    let mut scene = full_scene();
    let colors: Vec<[f32; 3]> = (0..20).map(|i| [i as f32 / 20.0, 0.5, -0.25]).collect();
    scene.set_colors(&colors);
    write_scene(&path, &scene).unwrap();
    let read = read_scene(&path).unwrap().scene;
    for (i, color) in read.base_colors().into_iter().enumerate() {
        let original = (0..20).find(|&j| scene.means[j] == read.means[i]).unwrap();
        assert!((Vec3::from(color) - Vec3::from(colors[original])).length() < 1e-6);
    }
}

#[test]
fn colors_have_a_row_per_source_gaussian() {
    let dir = dir();
    let path = dir.path().join("colors.safetensors");
    let scene = full_scene();
    let colors: Vec<[f32; 3]> = (0..20).map(|i| [i as f32, 2.0, -1.0]).collect();
    write_colors(&path, &colors, &scene).unwrap();
    let bytes = fs::read(&path).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let rgb = tensors.tensor("rgb").unwrap();
    assert_eq!((rgb.dtype(), rgb.shape()), (safetensors::Dtype::F32, &[25, 3][..]));
    let rgb: Vec<f32> =
        rgb.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let n_missing = rgb.chunks_exact(3).filter(|row| row.iter().all(|v| v.is_nan())).count();
    assert_eq!(n_missing, 5);
    for (i, &source_index) in scene.order.iter().enumerate() {
        assert_eq!(rgb[3 * source_index as usize..][..3], colors[i]);
    }
    assert!(refused(write_colors(&path, &colors[1..], &scene)).contains("19 colors"));
}

/// Three Gaussians of which the first and the last in the scene are parts of source Gaussian 1 of 4.
fn split_scene() -> Scene {
    let mut scene = full_scene().subset(&[0, 1, 2]);
    (scene.order, scene.n_source) = (vec![1, 0, 1], 4);
    scene
}

#[test]
fn parts_of_a_source_gaussian_share_its_row_of_colors() {
    let dir = dir();
    let path = dir.path().join("colors.safetensors");
    write_colors(&path, &[[1.0, 2.0, 3.0], [9.0; 3], [2.0, 2.0, -1.0]], &split_scene()).unwrap();
    let bytes = fs::read(&path).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let rgb = tensors.tensor("rgb").unwrap();
    let rgb: Vec<f32> =
        rgb.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(rgb[..6], [9.0, 9.0, 9.0, 1.5, 2.0, 1.0]);
    assert!(rgb[6..].iter().all(|v| v.is_nan()) && rgb.len() == 12, "{rgb:?}");
}

#[test]
fn parts_survive_files() {
    let dir = dir();
    let (sgs, ply) = (dir.path().join("a.sgs"), dir.path().join("a.ply"));
    write_scene(&sgs, &split_scene()).unwrap();
    let read = read_scene(&sgs).unwrap().scene;
    let mut order = read.order.clone();
    order.sort_unstable();
    assert_eq!((order, read.n_source), (vec![0, 1, 1], 4));
    // A .ply keeps the parts, in the order of the source.
    write_scene(&ply, &read).unwrap();
    assert_eq!(read_scene(&ply).unwrap().scene.means, by_source(&read).means);
}

#[test]
fn decoder_round_trips_in_both_precisions() {
    let dir = dir();
    let path = dir.path().join("a.decoder.safetensors");
    let mut original = decoder(&[6, 4, 3], 8, &mut noise());
    original.encoder = Some("vgg@00ff".parse().unwrap());
    write_decoder(&path, &original, Precision::F32).unwrap();
    assert_eq!(read_decoder(&path).unwrap(), original);
    write_decoder(&path, &original, Precision::F16).unwrap();
    let read = decoder_from_bytes(&fs::read(&path).unwrap(), "bytes").unwrap();
    for (a, b) in original.layers.iter().zip(&read.layers) {
        assert_eq!(a.bias, b.bias);
        assert!(a.weight.iter().zip(&b.weight).all(|(a, b)| (a - b).abs() <= 0.0005 * a.abs() + 1e-7));
    }
    original.activation = Activation::Sigmoid;
    original.residual = 0.0;
    original.smoothing_passes = 4;
    write_decoder(&path, &original, Precision::F32).unwrap();
    assert_eq!(read_decoder(&path).unwrap(), original);
}

/// Replaces one text by another of the same length in a file's bytes.
pub(super) fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect(from);
    let mut bytes = bytes.to_vec();
    bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    bytes
}

#[test]
fn lying_safetensors_are_refused() {
    let dir = dir();
    let path = dir.path().join("scene.sgs");
    write_scene(&path, &full_scene()).unwrap();
    let bytes = fs::read(&path).unwrap();
    let check = |bytes: Vec<u8>, part: &str| {
        fs::write(&path, bytes).unwrap();
        let message = refused(read_scene(&path));
        assert!(message.contains("scene.sgs: found ") && message.contains(part), "{message}");
    };
    check(bytes[..bytes.len() - 1].into(), "broken header");
    check(replaced(&bytes, r#""shape":[20,3]"#, r#""shape":[99,3]"#), "broken header");
    check(replaced(&bytes, "stylegaussian-scene", "stylegaussian-scent"), "`format` = `stylegaussian-scent`");
    check(replaced(&bytes, r#""version":"1""#, r#""version":"2""#), "`version` = `2`");
    check(replaced(&bytes, "leaky_relu:0.2", "leaky_relu:abc"), "activation `leaky_relu:abc`");
    check(replaced(&bytes, r#""transfer":"adain""#, r#""transfer":"wctxx""#), "`transfer` = `wctxx`");
    check(replaced(&bytes, r#""residual":"0.25""#, r#""residual":"0.2x""#), "`residual` = `0.2x`");
    check(replaced(&bytes, r#""residual":"0.25""#, r#""residual":" NaN""#), "`residual` = ");
    check(replaced(&bytes, r#""smooth":"1""#, r#""smooth":"x""#), "`smooth` = `x`");
    check(replaced(&bytes, r#""k":"3""#, r#""k":"4""#), "decoder.layers.0.weight");
    check(replaced(&bytes, r#""noise":"2""#, r#""noise":"9""#), "`noise` = 9");
    check(replaced(&bytes, r#""layers":"2""#, r#""layers":"9""#), "4 decoder tensors");
    check(replaced(&bytes, r#""up":"0 -1 0.25""#, r#""up":"0 -1 0.2x""#), "`up`");
    check(replaced(&bytes, r#""encoder":"vgg@0"#, r#""encoder":"vgg-0"#), "`encoder`");
    check(replaced(&bytes, r#""source_count":"25""#, r#""source_count":"20""#), "source index 22");
    check(replaced(&bytes, r#""filter":"antialiased""#, r#""filter":"antialiaseb""#), "`filter`");
    check(replaced(&bytes, r#""means":"#, r#""meats":"#), "no tensor `means`");
    check(replaced(&bytes, r#""dtype":"U32""#, r#""dtype":"I32""#), "type I32");
    let mut header_of_exabytes = bytes.clone();
    header_of_exabytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    check(header_of_exabytes[..9].iter().copied().chain(*b"{").collect(), "found");
}

#[test]
fn nan_in_a_scene_file_is_refused() {
    let dir = dir();
    let path = dir.path().join("scene.sgs");
    let mut scene = full_scene();
    scene.features.as_mut().unwrap().values[7] = f32::NAN;
    assert!(refused(write_scene(&path, &scene)).contains("NaN or infinity"));
    assert!(!path.exists());
    // Bytes of a mask would come last.
    write_scene(&path, &Scene { mask: None, ..full_scene() }).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let at = bytes.len() - 2; // the last f16 of `sh`
    bytes[at..].copy_from_slice(&half::f16::NAN.to_le_bytes());
    fs::write(&path, bytes).unwrap();
    assert!(refused(read_scene(&path)).contains("NaN"));
}

#[test]
fn values_out_of_range_are_refused() {
    let path = dir().path().join("scene.ply");
    let check = |change: fn(&mut Scene), part: &str| {
        let mut scene = full_scene();
        change(&mut scene);
        let message = refused(write_scene(&path, &scene));
        assert!(message.contains("scene.ply") && message.contains(part), "{message}");
    };
    // Gaussian 2 has source index 2 * 7 + 3 = 17.
    check(|s| s.opacities[2] = 1.5, "opacity 1.5 of source Gaussian 17");
    check(|s| s.rotations[2] = Quat::from_xyzw(0.0, 0.0, 0.0, 2.0), "a rotation of length 2");
    check(|s| s.means[2].x = f32::INFINITY, "NaN or infinity");
    check(|s| s.opacities.truncate(3), "3 opacities, expected 20");
}

#[test]
fn files_of_other_kinds_are_named() {
    let dir = dir();
    let check = |bytes: &[u8], part: &str| {
        let path = dir.path().join("thing.ply");
        fs::write(&path, bytes).unwrap();
        let message = refused(read_scene(&path));
        assert!(message.contains(part) && message.contains("thing.ply"), "{message}");
    };
    check(b"", "an empty file");
    check(b"NGSP\x04\0\0\0", "SPZ");
    check(b"hello, world", "`hello, w`");
    check(b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.", "bare pickle");
    check(b"RAD0\x10\0\0\0{}", ".rad of Spark, which is not supported, expected 3DGS .ply");
    check(b"\x89PNG\r\n\x1a\n", "a PNG image, which is not supported");
    check(b"\xff\xd8\xff\xe0", "a JPEG image, which is not supported");
    check(b"<!DOCTYPE html>", "an HTML or XML page");
    check(b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull");
    assert!(refused(read_scene(&dir.path().join("absent.ply"))).contains("absent.ply"));
    assert!(refused(read_scene(dir.path())).contains(&dir.path().display().to_string()));
    for extension in ["rad", "pth", "ksplat", "x"] {
        let message = refused(write_scene(&dir.path().join("a").with_extension(extension), &full_scene()));
        assert!(message.contains(&format!("extension `{extension}`")), "{message}");
        assert!(message.contains("expected `.ply`,") && message.contains("`.sgs`"), "{message}");
    }
    assert!(refused(write_scene(&dir.path().join("a"), &full_scene())).contains("extension ``"));
    assert!(refused(write_scene(&dir.path().join("a.sgs"), &Scene::default())).contains("no Gaussian"));
}

#[test]
fn a_decoder_for_another_encoder_is_refused() {
    let mut scene = full_scene();
    scene.decoder.as_mut().unwrap().encoder = Some("other@ff".parse().unwrap());
    let message = refused(write_scene(&dir().path().join("a.sgs"), &scene));
    assert!(message.contains("other@ff") && message.contains("vgg@0123"), "{message}");
}

#[test]
fn decoders_that_do_not_chain_are_refused() {
    let path = dir().path().join("a.decoder.safetensors");
    let check = |change: fn(&mut Decoder), part: &str| {
        let mut decoder = decoder(&[6, 4, 3], 2, &mut noise());
        change(&mut decoder);
        let message = refused(write_decoder(&path, &decoder, Precision::F32));
        assert!(message.contains(part), "{message}");
    };
    check(|d| d.layers.truncate(1), "4 outputs");
    check(|d| d.layers[1].d_in = 5, "decoder.layers.0");
    check(|d| d.layers[1].bias[0] = f32::NAN, "NaN");
    check(|d| d.layers.clear(), "0 layers");
    check(|d| d.k = 3, "decoder.layers.0");
}

/// Every format, cut and changed at many places, gives an error or a scene and never a panic.
#[test]
fn damaged_files_never_panic() {
    let dir = dir();
    let mut files: Vec<(&str, Vec<u8>)> = Vec::new();
    for name in ["scene.sgs", "scene.ply", "scene.compressed.ply", "scene.splat"] {
        let path = dir.path().join(name);
        write_scene(&path, &full_scene()).unwrap();
        files.push((name, fs::read(path).unwrap()));
    }
    files.push(("ascii.ply", ply::tests::ascii_sample()));
    files.push(("checkpoint.pth", checkpoint::tests::final_sample()));
    files.push(("a.look.safetensors", look::tests::sample()));
    files.push(("a.mask.safetensors", mask::tests::sample()));
    files.push(("a.ksplat", ksplat::tests::file(1)));
    let all = |name: &str, bytes: &[u8]| {
        let _ = scene_from_bytes(bytes, name);
        let _ = decoder::from_bytes(bytes);
        let _ = style::from_bytes(bytes);
        let _ = look::from_bytes(bytes);
        let _ = mask::from_bytes(bytes);
    };
    for (name, bytes) in &files {
        for end in (0..bytes.len()).step_by(1 + bytes.len() / 400) {
            all(name, &bytes[..end]);
        }
        // Counts stand in headers and directories, at the ends of a file. Those are changed byte by byte.
        let edge = 700.min(bytes.len() / 2);
        let inner = (edge..bytes.len() - edge).step_by(1 + bytes.len() / 400);
        for at in (0..edge).chain(inner).chain(bytes.len() - edge..bytes.len()) {
            for change in [0x00, 0xff, bytes[at] ^ 0x01, bytes[at] ^ 0x80, b'9'] {
                let mut damaged = bytes.clone();
                damaged[at] = change;
                all(name, &damaged);
            }
        }
    }
}

/// The folder of test data, or a loud notice that it is absent.
pub(super) fn shared_data(name: &str) -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let root = std::env::var_os("STYLEGAUSSIAN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let path = root.join(name);
    if !path.exists() {
        eprintln!("SKIPPED: no test data at {}", path.display());
        return None;
    }
    Some(path)
}
