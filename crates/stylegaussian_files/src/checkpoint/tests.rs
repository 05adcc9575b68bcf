//! Checkpoints that the real torch.save wrote (`tests/data/make_checkpoints.py`), whole, changed and repacked.

use glam::{Quat, Vec3};
use stylegaussian::decoder::Activation;

use super::*;
use crate::archive::tests::{Packing, archive};

const FINAL: &[u8] = include_bytes!("../../tests/data/final.pth");
const FEATURE: &[u8] = include_bytes!("../../tests/data/feature.pth");

/// For tests of all formats together.
pub(crate) fn final_sample() -> Vec<u8> {
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
    let Loaded { scene, warnings, .. } = read(FINAL).unwrap();
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
    let Loaded { scene, warnings, .. } = read(FEATURE).unwrap();
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
    check(b"little", b"big\0\0\0", "byte order"); // `big` padded with zeros
    check(b"final/data/5", b"final/dato/5", "no entry `final/data/5` for `kernels.0`");
    check(b"FloatStorage", b"Int64Storage", "of integers");
    check(b"FloatStorage", b"Float_______", "torch.Float_______");
}

#[test]
fn repacked_checkpoints_read_alike() {
    let mut real = Archive::open(FINAL).unwrap();
    let names: Vec<&str> = real.names().collect();
    let entries: Vec<(&str, Vec<u8>)> =
        names.iter().map(|&name| (name, real.unpack(name).unwrap().into_owned())).collect();
    let scene = read(&archive(&entries, Packing::Zip64)).unwrap().scene;
    check_gaussians(&scene);
}

/// The file names each tensor once. One that names a tensor a million times must not take a million times its
/// size.
#[test]
fn shared_storages_count_each_time() {
    let file = PytorchFile::parse(FINAL).unwrap();
    let xyz = find_parts(&file.pickle).unwrap().tensors[0];
    let source = Source::new(&file);
    let n_reads = (0..FINAL.len()).take_while(|_| source.read("xyz", xyz).is_ok()).count();
    // 6 Gaussians of 3 values, in a file of so many bytes.
    assert_eq!(n_reads, FINAL.len() / 2 / 18);
    let error = source.read("xyz", xyz).unwrap_err();
    assert!(error.found.contains("`xyz` [6, 3], which shares its values"), "{error:?}");
}
