//! Checkpoints that the real torch.save wrote (`tests/data/make_checkpoints.py`), and archives made here byte by byte.

use glam::{Quat, Vec3};

use super::*;
use crate::decoder::Activation;

const FINAL: &[u8] = include_bytes!("../../../tests/data/final.pth");
const FEATURE: &[u8] = include_bytes!("../../../tests/data/feature.pth");

/// For tests of all formats together.
pub(in crate::file) fn final_sample() -> Vec<u8> {
    FINAL.to_vec()
}

/// The values of `make_checkpoints.py`.
fn ramp(seed: usize, n: usize) -> Vec<f32> {
    (0..n).map(|i| ((7 * i + seed) % 32) as f32 / 32.0 - 0.5).collect()
}

fn check_gaussians(scene: &Scene) {
    let vec3 = |values: &[f32]| values.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>();
    assert_eq!(scene.means, vec3(&ramp(1, 18)));
    assert_eq!((scene.n_source, &scene.order[..]), (6, &[0, 1, 2, 3, 4, 5][..]));
    assert!(scene.sh.is_none());
    for (scale, log) in scene.scales.iter().zip(vec3(&ramp(2, 18))) {
        assert!(scale.abs_diff_eq(log.exp(), 1e-6));
    }
    for (rotation, wxyz) in scene.rotations.iter().zip(ramp(3, 24).chunks_exact(4)) {
        let expected = Quat::from_xyzw(wxyz[1], wxyz[2], wxyz[3], wxyz[0]).normalize();
        assert!(rotation.abs_diff_eq(expected, 1e-6));
    }
    for (opacity, logit) in scene.opacities.iter().zip(ramp(4, 6)) {
        assert!((opacity - 1.0 / (1.0 + (-logit).exp())).abs() < 1e-6);
    }
}

#[test]
fn reads_a_trained_model_that_torch_saved() {
    let Loaded { scene, warnings } = read(FINAL).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    check_gaussians(&scene);
    let features = scene.features.as_ref().unwrap();
    // A view that starts at the third row of its storage.
    assert_eq!((features.n_latent, &features.values[..]), (5, &ramp(5, 40)[10..]));
    let identity: Vec<f32> = (0..25).map(|i| if i % 6 == 0 { 1.0 } else { 0.0 }).collect();
    assert_eq!((&features.basis, &features.offset), (&identity, &vec![0.0; 5]));
    let decoder = scene.decoder.as_ref().unwrap();
    assert_eq!((decoder.k, decoder.activation, decoder.residual), (3, Activation::Sigmoid, 0.0));
    let [first, second] = &decoder.layers[..] else { panic!("{} layers", decoder.layers.len()) };
    assert_eq!((first.d_in, first.d_out, &first.weight), (5, 4, &ramp(6, 60)));
    assert_eq!(first.bias, ramp(8, 4));
    // Saved transposed: element [o, c] is element [c, o] of the storage.
    let stored = ramp(7, 36);
    let transposed: Vec<f32> = (0..36).map(|i| stored[i % 12 * 3 + i / 12]).collect();
    assert_eq!((second.d_in, second.d_out, &second.weight), (4, 3, &transposed));
    assert_eq!(second.bias, ramp(9, 3));
}

#[test]
fn reads_a_feature_model_saved_with_its_iteration() {
    let Loaded { scene, warnings } = read(FEATURE).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    check_gaussians(&scene);
    assert!(scene.decoder.is_none());
    let features = scene.features.unwrap();
    assert_eq!((features.n_latent, features.values), (2, ramp(12, 12)));
    assert_eq!((features.basis, features.offset), (ramp(10, 10), ramp(11, 5)));
}

/// Replaces all occurrences of a text by one of the same length.
fn replaced(from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut bytes = FINAL.to_vec();
    let places: Vec<usize> =
        (0..bytes.len() - from.len()).filter(|&i| bytes[i..].starts_with(from)).collect();
    assert!(!places.is_empty(), "{from:?}");
    for at in places {
        bytes[at..at + to.len()].copy_from_slice(to);
    }
    bytes
}

fn refused(bytes: &[u8]) -> String {
    let Mismatch { found, expected } = read(bytes).expect_err("an error");
    format!("found {found}, expected {expected}")
}

#[test]
fn unknown_globals_are_errors() {
    let message = refused(&replaced(b"_rebuild_parameter", b"_rebuild_something"));
    assert!(message.contains("`torch._utils._rebuild_something`"), "{message}");
    let message = refused(&replaced(b"collections\nOrderedDict", b"builtinsxxx\neval_______"));
    assert!(message.contains("builtinsxxx.eval_______"), "{message}");
}

#[test]
fn other_contents_are_errors() {
    let check = |from: &[u8], to: &[u8], part: &str| {
        let message = refused(&replaced(from, to));
        assert!(message.contains(part), "{message}");
    };
    check(b"kernels.0", b"kernols.0", "without `layer.weight`");
    check(b"kernels.1", b"kernols.1", "4 outputs"); // the only layer left does not give RGB
    check(b"bias.1", b"bios.1", "without `bias.1`");
    check(b"final/data.pkl", b"final/data.pko", "without `data.pkl`");
    check(b"final/data/5", b"final/dato/5", "no entry `final/data/5` for `kernels.0`");
    check(b"FloatStorage", b"Int64Storage", "of integers");
    check(b"FloatStorage", b"Float_______", "torch.Float_______");
}

#[test]
fn big_endian_storages_are_swapped() {
    // The same bytes read the other way round are not the same means, nor an error.
    let scene = read(&replaced(b"little", b"big\0\0\0")).map(|_| ());
    assert!(scene.is_err(), "`big` padded with zeros is no byte order");
    let entries =
        [("a/data.pkl", Vec::new()), ("a/byteorder", b"big".to_vec()), ("a/data/0", vec![0x3f, 0x80, 0, 0])];
    let archive = archive(&entries, false);
    let archive = zip::Archive::open(&archive).unwrap();
    // (storage): one number, viewed as a scalar.
    let pickle = Pickle::read(&scalar_pickle()).unwrap();
    let storages = Storages::new(&archive, "a/", &pickle).unwrap();
    let Object::Tensor(info) = pickle.object(pickle.root) else { panic!("no tensor") };
    assert_eq!(storages.read("one", info).unwrap().values, [1.0]);
}

/// A pickle of one scalar tensor in storage '0' of one float.
fn scalar_pickle() -> Vec<u8> {
    let mut pickle = b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n((".to_vec();
    pickle.extend(b"X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x06\0\0\0cuda:0K\x01tQ");
    pickle.extend(b"K\x00))\x89NtR.");
    pickle
}

/// Fields of a record, one after the other.
fn record(signature: &[u8; 4], fields: &[&[u8]]) -> Vec<u8> {
    [&signature[..], &fields.concat()].concat()
}

/// A zip archive of stored entries; with `zip64`, every size and offset stands in the 64-bit fields.
fn archive(entries: &[(&str, Vec<u8>)], zip64: bool) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, data) in entries {
        let local = bytes.len() as u64;
        let (len, size) = (data.len() as u64, data.len() as u32);
        let n_name = (name.len() as u16).to_le_bytes();
        bytes.extend(record(
            b"PK\x03\x04",
            &[&[0; 14], &size.to_le_bytes(), &size.to_le_bytes(), &n_name, &[5, 0]],
        ));
        bytes.extend(name.as_bytes());
        bytes.extend(*b"FB\x01\0Z"); // padding in an extra field, as torch aligns its storages
        bytes.extend(data);
        let (size, offset) = if zip64 { (u32::MAX, u32::MAX) } else { (size, local as u32) };
        let mut extra = Vec::new();
        if zip64 {
            extra.extend(*b"\x01\0\x18\0");
            extra.extend([len, len, local].map(u64::to_le_bytes).concat());
        }
        let n_extra = (extra.len() as u16).to_le_bytes();
        let fields: [&[u8]; 7] = [
            &[0; 16],
            &size.to_le_bytes(),
            &size.to_le_bytes(),
            &n_name,
            &n_extra,
            &[0; 10],
            &offset.to_le_bytes(),
        ];
        directory.extend(record(b"PK\x01\x02", &fields));
        directory.extend([name.as_bytes(), &extra].concat());
    }
    let (start, n) = (bytes.len() as u64, entries.len() as u64);
    let n_directory = directory.len() as u64;
    bytes.extend(directory);
    let end = bytes.len() as u64;
    if zip64 {
        let fields = [n, n, n_directory, start].map(u64::to_le_bytes).concat();
        bytes.extend(record(b"PK\x06\x06", &[&44_u64.to_le_bytes(), &[0; 12], &fields]));
        bytes.extend(record(b"PK\x06\x07", &[&[0; 4], &end.to_le_bytes(), &[1, 0, 0, 0]]));
    }
    let (n, size, start) = match zip64 {
        true => (u16::MAX, u32::MAX, u32::MAX),
        false => (n as u16, n_directory as u32, start as u32),
    };
    let n = n.to_le_bytes();
    bytes.extend(record(
        b"PK\x05\x06",
        &[&[0; 4], &n, &n, &size.to_le_bytes(), &start.to_le_bytes(), &[0; 2]],
    ));
    bytes
}

#[test]
fn zip_and_zip64_give_the_same_entries() {
    let entries = [("x/data.pkl", b"one".to_vec()), ("x/data/0", vec![7; 300])];
    for zip64 in [false, true] {
        let bytes = archive(&entries, zip64);
        let archive = zip::Archive::open(&bytes).unwrap();
        assert_eq!(archive.names().count(), 2);
        for (name, data) in &entries {
            assert_eq!(archive.get(name), Some(&data[..]), "zip64: {zip64}");
        }
    }
}

#[test]
fn repacked_checkpoints_read_alike() {
    let real = zip::Archive::open(FINAL).unwrap();
    let mut names: Vec<&str> = real.names().collect();
    names.sort_unstable();
    let entries: Vec<(&str, Vec<u8>)> =
        names.iter().map(|&name| (name, real.get(name).unwrap().to_vec())).collect();
    let scene = read(&archive(&entries, true)).unwrap().scene;
    check_gaussians(&scene);
}

#[test]
fn damaged_archives_are_errors() {
    let entries = [("x/data.pkl", b"one".to_vec())];
    let good = archive(&entries, true);
    let check = |bytes: Vec<u8>, part: &str| {
        let Err(Mismatch { found, .. }) = zip::Archive::open(&bytes) else { panic!("no error for {part}") };
        assert!(found.contains(part), "{found}");
    };
    check(good[..good.len() - 1].into(), "no end record");
    check(good[..10].into(), "too few bytes");
    let at = |signature: &[u8]| good.windows(4).position(|w| w == signature).unwrap();
    let changed = |at: usize, value: u8| {
        let mut bytes = good.clone();
        bytes[at] = value;
        bytes
    };
    check(changed(at(b"PK\x01\x02") + 10, 8), "compressed (method 8)");
    check(changed(at(b"PK\x01\x02"), 0), "damaged central directory");
    check(changed(at(b"PK\x03\x04"), 0), "no entry where");
    // A count of 2^63 entries, and an offset of 2^63.
    check(changed(at(b"PK\x06\x06") + 39, 0x80), "past its end");
    check(changed(at(b"PK\x06\x06") + 55, 0x80), "past its end");
    check(changed(at(b"PK\x06\x07") + 15, 0x80), "past its end");
}

#[test]
fn views_outside_their_storage_are_errors() {
    let archive = archive(&[("data/0", vec![0; 4])], false);
    let archive = zip::Archive::open(&archive).unwrap();
    let pickle = Pickle::read(&scalar_pickle()).unwrap();
    let storages = Storages::new(&archive, "", &pickle).unwrap();
    let Object::Tensor(scalar) = pickle.object(pickle.root) else { panic!("no tensor") };
    let read = |offset, shape: &[usize], strides: &[usize]| {
        let info = TensorInfo { offset, shape: shape.into(), strides: strides.into(), ..scalar.clone() };
        storages.read("view", &info).map(|tensor| tensor.values.len())
    };
    assert_eq!(read(0, &[], &[]).unwrap(), 1);
    assert_eq!(read(0, &[0, usize::MAX], &[1, 1]).unwrap(), 0);
    assert!(read(1, &[], &[]).is_err());
    assert!(read(0, &[2], &[1]).is_err());
    assert!(read(0, &[1 << 40], &[0]).is_err(), "a repeated number must not allocate terabytes");
    assert!(read(0, &[usize::MAX, 2], &[1, 1]).is_err());
    assert!(read(0, &[2, 2], &[usize::MAX, usize::MAX]).is_err());
    assert!(read(0, &[1], &[]).is_err());
}

#[test]
fn damaged_pickles_are_errors() {
    let check = |pickle: &[u8], part: &str| {
        let Err(Mismatch { found, .. }) = Pickle::read(pickle) else { panic!("no error for {part}") };
        assert!(found.contains(part), "{found}");
    };
    check(b"\x80\x02", "no end");
    check(b"\x80\x02.", "empty stack");
    check(b"(K\x01(0.", "empty stack"); // nothing is popped from under a mark
    check(b"t", "no mark");
    check(b"h\x05.", "no memo 5");
    check(b"X\xff\xff\xff\xffabc.", "no end");
    check(b"}K\x01K\x02K\x03\x86R.", "a call of an integer");
    check(b"]K\x01s.", "empty stack");
    check(b"K\x01K\x02a.", "items appended to an integer");
    check(b"(K\x01d.", "a key without a value");
    check(b"\x8a\x09123456789.", "past 64 bits");
    check(b"cos\nsystem\n.", "global `os.system`");
    check(b"I1\n.", "opcode 0x49");
    // A list that contains itself.
    assert!(Pickle::read(b"]q\0h\0a.").is_ok());
}

#[test]
fn numbers_of_a_pickle() {
    let numbers =
        |bytes: &[u8]| Pickle::read(bytes).map(|pickle| pickle.object(pickle.root).clone()).unwrap();
    assert_eq!(numbers(b"J\xfe\xff\xff\xff."), Object::Integer(-2));
    assert_eq!(numbers(b"M\x00\x80."), Object::Integer(32_768));
    assert_eq!(numbers(b"\x8a\x02\x00\x80."), Object::Integer(-32_768));
    assert_eq!(numbers(b"\x8a\x00."), Object::Integer(0));
    assert_eq!(numbers(b"\x8a\x05\0\0\0\0\x01."), Object::Integer(1 << 32));
}
