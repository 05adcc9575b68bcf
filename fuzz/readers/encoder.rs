//! Encoders: a network or an ONNX graph that opens also runs on a small picture, or is refused.

use stylegaussian_encoder::{Encoder, Image};

/// Opens the encoder and encodes a picture of 32x32 pixels.
pub fn read(data: &[u8]) {
    if let Ok(encoder) = Encoder::from_bytes("fuzz", data.to_vec()) {
        let (width, height) = (32, 32);
        let picture = Image { width, height, rgb: vec![0.5; 3 * 32 * 32] };
        if let Ok(features) = encoder.encode(&picture) {
            assert!(features.values.iter().all(|value| value.is_finite()));
        }
    }
}
