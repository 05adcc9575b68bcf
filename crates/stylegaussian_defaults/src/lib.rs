//! The default decoder, as bytes.

/// The default decoder, a `*.decoder.safetensors`.
pub const DECODER: &[u8] = &[];
