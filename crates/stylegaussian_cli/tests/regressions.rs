//! Every file that a fuzz target once failed on, read again by the target's own reader: none may panic.

use std::{
    env, fs, panic,
    path::Path,
    time::{Duration, Instant},
};

use stylegaussian::random::Random;

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
#[path = "../../../fuzz/readers/mask.rs"]
mod mask;
#[path = "../../../fuzz/readers/paint.rs"]
mod paint;
#[path = "../../../fuzz/readers/pins.rs"]
mod pins;
#[path = "../../../fuzz/readers/pytorch.rs"]
mod pytorch;
#[path = "../../../fuzz/readers/scene.rs"]
mod scene;
#[path = "../../../fuzz/readers/style.rs"]
mod style;
#[path = "../../../fuzz/readers/world.rs"]
mod world;

/// A folder of `fuzz/regressions`, and the reader of its files.
type Target = (&'static str, fn(&[u8]));

/// The readers, by the names of their folders.
const READERS: [Target; 13] = [
    ("cameras", cameras::read),
    ("checkpoint", checkpoint::read),
    ("decoder", decoder::read),
    ("encoder", encoder::read),
    ("image", image::read),
    ("look", look::read),
    ("mask", mask::read),
    ("paint", paint::read),
    ("pins", pins::read),
    ("pytorch", pytorch::read),
    ("scene", scene::read),
    ("style", style::read),
    ("world", world::read),
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

/// Wrong bytes in every place of a good file, one at a time. A short stand-in for the fuzzer, which runs
/// elsewhere.
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

/// Random changes of the corpus that `cargo xtask fuzz` fills, without coverage and without nightly Rust: for
/// each target STYLEGAUSSIAN_MUTATE_SECONDS, or 20. A file that fails is kept in `fuzz/artifacts`.
#[test]
#[ignore = "minutes, and needs a corpus"]
fn changed_files_of_the_corpus() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz");
    let seconds =
        env::var("STYLEGAUSSIAN_MUTATE_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(20);
    let only = env::var("STYLEGAUSSIAN_MUTATE_TARGET").ok();
    for (target, read) in READERS.iter().filter(|(name, _)| only.as_deref().is_none_or(|only| only == *name))
    {
        let Ok(files) = fs::read_dir(fuzz.join("corpus").join(target)) else { continue };
        let mut seeds: Vec<Vec<u8>> = files.map(|file| fs::read(file.unwrap().path()).unwrap()).collect();
        seeds.retain(|seed| !seed.is_empty());
        // A folder has no order.
        seeds.sort();
        if seeds.is_empty() {
            eprintln!("{target}: SKIPPED, no corpus");
            continue;
        }
        let mut random = Random::new(1);
        let (began, mut n) = (Instant::now(), 0_u64);
        let mut slowest = Duration::ZERO;
        while began.elapsed() < Duration::from_secs(seconds) {
            let bytes = changed(&seeds, &mut random);
            let start = Instant::now();
            let outcome = panic::catch_unwind(|| read(&bytes));
            slowest = slowest.max(start.elapsed());
            n += 1;
            if outcome.is_err() {
                let folder = fuzz.join("artifacts").join(target);
                fs::create_dir_all(&folder).unwrap();
                fs::write(folder.join(format!("changed-{n}")), &bytes).unwrap();
                panic!("{target}: file {n} of {} bytes, kept in {}", bytes.len(), folder.display());
            }
        }
        eprintln!("{target}: {} seeds, {n} files, the slowest {slowest:?}", seeds.len());
    }
}

/// One of the files with a few changes: of bits, bytes, numbers, runs and the end.
fn changed(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].clone();
    for _ in 0..=random.below(6) {
        let at = random.below(bytes.len());
        match random.below(8) {
            0 | 1 => bytes[at] ^= 1 << random.below(8),
            2 | 3 => bytes[at] = random.below(256) as u8,
            4 => {
                let number =
                    [0_u64, 1, 0x7F, 0xFF, 0x7FFF_FFFF, u64::MAX, 1 << 40, 0x7F80_0000][random.below(8)];
                let n = [1, 2, 4, 8][random.below(4)].min(bytes.len() - at);
                bytes[at..at + n].copy_from_slice(&number.to_le_bytes()[..n]);
            }
            // A digit in a header becomes a large number.
            5 => drop(bytes.splice(at..at, *b"9999999")),
            6 => bytes.truncate(at.max(1)),
            _ => {
                let other = &seeds[random.below(seeds.len())];
                let from = random.below(other.len());
                let n = random.below(64).min(other.len() - from);
                drop(bytes.splice(at..at, other[from..from + n].iter().copied()));
            }
        }
    }
    bytes
}
