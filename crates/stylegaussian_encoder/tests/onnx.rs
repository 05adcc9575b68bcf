//! Encoders as ONNX files: `tests/onnx` has the graphs.

#![cfg(feature = "onnx")]

use std::{fs, path::PathBuf};

use stylegaussian_encoder::{
    Encoder, Image,
    onnx::{Graph, OnnxError, Planes},
};

/// A file of `tests/onnx`.
fn graph(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/onnx").join(name)
}

fn message(name: &str) -> String {
    Encoder::open(&graph(name)).err().unwrap_or_else(|| panic!("{name} was opened")).to_string()
}

/// Opens the bytes as `encoder.onnx`, which must fail with a message that names it.
fn failure(bytes: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("encoder.onnx");
    fs::write(&path, bytes).unwrap();
    let message = Encoder::open(&path).err().expect("a broken encoder opened").to_string();
    assert!(message.contains("encoder.onnx"), "{message}");
}

#[test]
fn a_graph_of_any_width_and_stride() {
    let encoder = Encoder::open(&graph("tiny.onnx")).unwrap();
    assert_eq!((encoder.n_channels(), encoder.id().name.as_str()), (2, "tiny"));
    assert_eq!(encoder.id().hash.len(), 16);
    assert!(encoder.runtime().starts_with("tract ") || encoder.runtime().starts_with("ONNX Runtime "));
    // Left half red, right half blue: features (1, 1) and (0, 0).
    let rgb = (0..8 * 8).flat_map(|i| if i % 8 < 4 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] }).collect();
    let features = encoder.encode(&Image { width: 8, height: 8, rgb, alpha: None }).unwrap();
    assert_eq!((features.width, features.height, features.n_channels), (4, 4, 2));
    assert_eq!(features.values[..8], [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn garbage_is_refused() {
    failure(b"");
    failure(b"this is no protobuf");
    failure(&[0xFF; 1000]);
    let whole = fs::read(graph("tiny.onnx")).unwrap();
    for length in [whole.len() / 4, whole.len() / 2, whole.len() - 3] {
        failure(&whole[..length]);
    }
}

/// tract panics over many of these files.
#[test]
fn corrupted_files_never_panic() {
    let whole = fs::read(graph("blur.onnx")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("corrupted.onnx");
    let mut n_refused = 0;
    // Every twelfth byte, to keep the test short. The values are the least, the greatest of one varint byte,
    // and the least that continues.
    for index in (0..whole.len()).step_by(12) {
        for byte in [0, 0x7F, 0x80] {
            let mut bytes = whole.clone();
            bytes[index] = byte;
            fs::write(&path, bytes).unwrap();
            n_refused += u32::from(Encoder::open(&path).is_err());
        }
    }
    // Many of the bytes are weights or names, in which any value is valid.
    assert!(n_refused > 20, "only {n_refused} of the corrupted files were refused");
}

#[test]
fn graphs_that_are_no_encoder() {
    let infinite = message("infinite.onnx");
    assert!(infinite.contains("inf") && infinite.contains("finite"), "{infinite}");
    let gray = message("gray.onnx");
    assert!(gray.contains("[1, any, any]") && gray.contains("[3, 64, 64]"), "{gray}");
}

/// A convolution over less than its kernel makes tract read past its input.
#[test]
fn images_smaller_than_a_kernel_are_refused() {
    let encoder = Encoder::open(&graph("wide.onnx")).unwrap();
    let image = |side: u32| Image {
        width: side,
        height: side,
        rgb: vec![0.5; (side * side * 3) as usize],
        alpha: None,
    };
    assert!(encoder.encode(&image(16)).is_err());
    let features = encoder.encode(&image(32)).unwrap();
    assert_eq!((features.width, features.height, features.n_channels), (16, 16, 2));
    // 3 x 17 x 17 weights of 0.01 over gray.
    assert!(features.values.iter().all(|value| (value - 4.335).abs() < 1e-4), "{:?}", features.values[0]);
    // Four pixels remain of 64 after four halvings: too few for a kernel of 5.
    let halved = message("halved.onnx");
    if halved.contains("tract") {
        assert!(halved.contains("[1, 3, 64, 64]") && halved.contains("too small"), "{halved}");
    }
}

#[test]
fn one_graph_takes_any_size() {
    let graph = Graph::load("gray", fs::read(graph("gray.onnx")).unwrap()).unwrap();
    assert_eq!(graph.input(), [Some(1), None, None]);
    // The first size comes again: a run must leave nothing of the last one behind.
    for (height, width) in [(2, 2), (5, 3), (2, 2), (64, 31)] {
        let values: Vec<f32> = (0..height * width).map(|i| i as f32 - 3.0).collect();
        let found = graph.run(&Planes { channels: 1, height, width, values: values.clone() }).unwrap();
        assert_eq!((found.height, found.width), (height, width));
        assert_eq!(found.values, values.iter().map(|value| value.max(0.0)).collect::<Vec<_>>());
    }
    let error = graph.run(&Planes { channels: 2, height: 3, width: 3, values: vec![0.0; 18] }).unwrap_err();
    assert!(matches!(error, OnnxError::Signature { .. }), "{error}");
    assert!(
        error.to_string().contains("[1, any, any]") && error.to_string().contains("[2, 3, 3]"),
        "{error}"
    );
    assert!(graph.run(&Planes { values: vec![0.0; 8], channels: 1, height: 3, width: 3 }).is_err());
}
