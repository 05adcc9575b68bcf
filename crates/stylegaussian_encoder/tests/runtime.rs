//! The choice of the engine of ONNX files, and that both give the same. The choice is made once per process, so
//! the tests run this file's own binary again with another environment.

#![cfg(feature = "onnx")]

mod twin;

use std::{env, fs, path::Path, process::Command};

use stylegaussian_encoder::onnx::{
    Graph, Planes,
    runtime::{DYLIB_VARIABLE, Runtime},
};

/// Set for the inner run: the file to which it writes its result.
const REPORT: &str = "STYLEGAUSSIAN_TEST_REPORT";

/// Runs the test `name` of this binary again, with `library` as ONNX Runtime, and returns its report.
fn run_again(name: &str, library: Option<&Path>) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report");
    let mut command = Command::new(env::current_exe().unwrap());
    // The variable is set for the child alone: `env::set_var` is unsafe while other tests run.
    command.args(["--exact", name]).env(REPORT, &report).env_remove(DYLIB_VARIABLE);
    if let Some(library) = library {
        command.env(DYLIB_VARIABLE, library);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    fs::read(report).unwrap()
}

#[test]
fn an_unusable_library_leaves_tract_and_a_warning() {
    if let Some(report) = env::var_os(REPORT) {
        let runtime = Runtime::get();
        fs::write(report, format!("{}\n{}", runtime.name(), runtime.warning().unwrap_or("none"))).unwrap();
        return;
    }
    let again = |library| {
        let report = run_again("an_unusable_library_leaves_tract_and_a_warning", library);
        String::from_utf8(report).unwrap()
    };
    let none = again(None);
    assert!(none.starts_with("tract 0.") && none.ends_with("\nnone"), "{none}");

    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("libonnxruntime.so");
    fs::write(&text, "this is no library").unwrap();
    for library in [Path::new("/nowhere/libonnxruntime.so"), &text] {
        let found = again(Some(library));
        let names_both = found.contains(DYLIB_VARIABLE) && found.contains(&library.display().to_string());
        assert!(found.starts_with("tract ") && names_both, "{found}");
    }
}

/// Layers like VGG's on a fixed image, run twice.
fn features() -> Planes {
    let onnx = include_bytes!("onnx/layers.onnx").to_vec();
    let graph = Graph::load("layers.onnx", onnx).unwrap();
    // Odd and not square, so that padding, pooling and strides meet a remainder.
    let image = twin::random_image(101, 77);
    let input = Planes { channels: 3, height: 77, width: 101, values: image.rgb };
    let first = graph.run(&input).unwrap();
    assert!(graph.run(&input).unwrap() == first, "the same input gave another output");
    first
}

#[test]
fn both_engines_agree() {
    if let Some(report) = env::var_os(REPORT) {
        let bytes: Vec<u8> = features().values.iter().flat_map(|value| value.to_le_bytes()).collect();
        fs::write(report, bytes).unwrap();
        return;
    }
    if env::var_os(DYLIB_VARIABLE).is_none() {
        eprintln!("SKIPPED: {DYLIB_VARIABLE} names no ONNX Runtime to compare tract with");
        return;
    }
    let runtime = Runtime::get();
    assert!(runtime.name().starts_with("ONNX Runtime"), "{:?}", runtime.warning());
    let by_onnx_runtime = features();
    let by_tract = run_again("both_engines_agree", None);
    let by_tract = by_tract.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes));
    assert_eq!(by_tract.len(), by_onnx_runtime.values.len());
    let error = by_tract.zip(&by_onnx_runtime.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("{}: differs from tract by {error:e}", runtime.name());
    // Ten times what was measured.
    assert!(error < 2e-4, "{error}");
}
