//! One encoder, many threads.

use rayon::{ThreadPoolBuilder, prelude::*};
use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{Encoder, Image};

/// Sides of the pictures: products large enough to be spread over threads.
const SIDE: u32 = 192;

/// A picture of random colors.
fn picture(seed: u64) -> Image {
    let mut random = stylegaussian::random::Random::new(seed);
    Image {
        width: SIDE,
        height: SIDE,
        rgb: (0..SIDE * SIDE * 3).map(|_| random.uniform()).collect(),
        alpha: None,
    }
}

/// A thread that waits for its share of a product may take up the next picture meanwhile. More threads than
/// cores, so that waiting is common.
#[test]
fn many_pictures_at_once_are_encoded_as_one_by_one() {
    let encoder = Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec()).unwrap();
    let pictures: Vec<Image> = (0..48).map(picture).collect();
    let in_turn: Vec<_> = pictures.iter().map(|picture| encoder.encode(picture).unwrap()).collect();
    let pool = ThreadPoolBuilder::new().num_threads(16).build().unwrap();
    let at_once: Vec<_> =
        pool.install(|| pictures.par_iter().map(|picture| encoder.encode(picture).unwrap()).collect());
    assert!(in_turn == at_once);
}
