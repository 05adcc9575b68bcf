//! Every file that a fuzz target once failed on, read again by the target's own reader: none may panic.

use std::{fs, panic, path::Path};

#[path = "../../../fuzz/readers/cameras.rs"]
mod cameras;
#[path = "../../../fuzz/readers/checkpoint.rs"]
mod checkpoint;
#[path = "../../../fuzz/readers/decoder.rs"]
mod decoder;
#[path = "../../../fuzz/readers/encoder.rs"]
mod encoder;
#[path = "../../../fuzz/readers/image.rs"]
mod image;
#[path = "../../../fuzz/readers/look.rs"]
mod look;
#[path = "../../../fuzz/readers/paint.rs"]
mod paint;
#[path = "../../../fuzz/readers/pytorch.rs"]
mod pytorch;
#[path = "../../../fuzz/readers/scene.rs"]
mod scene;
#[path = "../../../fuzz/readers/style.rs"]
mod style;

/// The readers, by the names of their folders.
const READERS: [(&str, fn(&[u8])); 10] = [
    ("cameras", cameras::read),
    ("checkpoint", checkpoint::read),
    ("decoder", decoder::read),
    ("encoder", encoder::read),
    ("image", image::read),
    ("look", look::read),
    ("paint", paint::read),
    ("pytorch", pytorch::read),
    ("scene", scene::read),
    ("style", style::read),
];

#[test]
fn files_that_once_failed_are_read_or_refused() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/regressions");
    let mut n_read = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let target = entry.file_name().into_string().unwrap();
        let (_, read) = READERS.iter().find(|(name, _)| *name == target).expect("a folder for each target");
        for file in fs::read_dir(entry.path()).unwrap() {
            let path = file.unwrap().path();
            let bytes = fs::read(&path).unwrap();
            assert!(panic::catch_unwind(|| read(&bytes)).is_ok(), "{}", path.display());
            n_read += 1;
        }
    }
    assert!(n_read > 0);
}

/// Wrong bytes in every place of a good file, one at a time. A short stand-in for the fuzzer, which runs elsewhere.
#[test]
fn small_files_with_wrong_bytes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/regressions");
    for (target, read) in READERS {
        let Ok(files) = fs::read_dir(folder.join(target)) else { continue };
        for file in files {
            let good = fs::read(file.unwrap().path()).unwrap();
            for i in (0..good.len()).step_by(good.len() / 64 + 1) {
                let mut bytes = good.clone();
                bytes[i] ^= 0x81;
                read(&bytes);
                read(&good[..i]);
            }
        }
    }
}
