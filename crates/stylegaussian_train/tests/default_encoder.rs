//! The encoder that ships.

#[expect(dead_code, reason = "the tests share these, and each uses a part")]
mod support;

use std::{fs, path::Path};

use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{Encoder, Image};
use stylegaussian_train::encoder::compare;
use support::data;

/// Most bytes that it may have: the crate's limit is 5 MB, and the decoder has 2.
const MAX_BYTES: usize = 2 << 20;

fn repository() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

#[test]
fn it_is_small_and_is_the_file_of_its_name() {
    assert!(ENCODER.len() <= MAX_BYTES, "{} bytes", ENCODER.len());
    let built_in = Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec()).unwrap();
    let file = repository().join(format!("crates/stylegaussian_defaults/{ENCODER_NAME}.encoder.safetensors"));
    let file = Encoder::open(&file).unwrap();
    assert_eq!(built_in.id().to_string(), file.id().to_string());
    assert_eq!(built_in.n_channels(), 256);
    // A quarter of the size, rounded up twice, as VGG's: 37 -> 19 -> 10 and 50 -> 25 -> 13.
    let gray = Image { width: 37, height: 50, rgb: vec![0.5; 37 * 50 * 3], alpha: None };
    let features = built_in.encode(&gray).unwrap();
    assert_eq!((features.width, features.height), (10, 13));
}

#[test]
fn it_stands_in_for_vgg_on_paintings_it_has_never_seen() {
    let (Some(vgg), Some(styles)) = (data("vgg"), data("styles")) else { return };
    let names = fs::read_to_string(repository().join("assets/held_out_paintings.txt")).unwrap();
    let paintings: Vec<_> = names.lines().map(|name| styles.join(name)).collect();
    let teacher = Encoder::open(&vgg.join("vgg19_normalised_relu3_1.safetensors")).unwrap();
    let student = Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec()).unwrap();
    let report = compare(&teacher, &student, &paintings).unwrap();
    println!("{}", report.table());
    assert!(report.correlation_median >= 0.9, "{report:?}");
    assert!(report.correlation_10th >= 0.7, "{report:?}");
    assert!(report.mean_error <= 0.1 && report.std_dev_error <= 0.1, "{report:?}");
}
