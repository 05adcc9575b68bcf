//! The default encoder and the default decoder as bytes, so that a program can stylize without a download.
//!
//! `assets/README.md` of the repository describes how and on which pictures they were trained.

/// The default decoder, a `*.decoder.safetensors` with K = 8, 256-128-64-32-3 channels and f16 weights. Its
/// metadata names the encoder that it belongs to.
pub const DECODER: &[u8] = include_bytes!("../default.decoder.safetensors");

/// The default encoder, a `*.encoder.safetensors`. It maps RGB 0..1 to 256 channels at a quarter of the size,
/// and was distilled from VGG-19's relu3_1.
pub const ENCODER: &[u8] = include_bytes!("../distilled_relu3_1.encoder.safetensors");

/// Name of the default encoder, its file's name without extension. Features, style statistics and decoders made
/// with it carry this name.
pub const ENCODER_NAME: &str = "distilled_relu3_1";
