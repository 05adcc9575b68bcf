//! Encoders: a network or an ONNX graph that opens also runs on a small picture, or is refused.

use stylegaussian_encoder::{Encoder, Image};

/// Opens the encoder, as either kind of file, and encodes a picture of 32x32 pixels.
pub fn read(data: &[u8]) {
    for encoder in ["fuzz", "fuzz.onnx"].into_iter().flat_map(|name| Encoder::from_bytes(name, data.to_vec()))
    {
        let (width, height) = (32, 32);
        let picture = Image { width, height, rgb: vec![0.5; 3 * 32 * 32], alpha: None };
        if let Ok(features) = encoder.encode(&picture) {
            assert!(features.values.iter().all(|value| value.is_finite()));
        }
    }
}
