//! The default encoder and the default decoder, as bytes, so that a program that only names our crates can stylize without a
//! download. How they were trained, and on what, is told in `assets/README.md` of the repository.

/// The default decoder, a `*.decoder.safetensors`: K = 8, 256-128-64-32-3 channels, f16. It belongs to the encoder that
/// its metadata names.
pub const DECODER: &[u8] = include_bytes!("../default.decoder.safetensors");

/// The default encoder, an ONNX file: RGB 0..1 `[1, 3, H, W]` to 256 channels at a quarter of the size, distilled from
/// VGG-19's relu3_1.
pub const ENCODER: &[u8] = include_bytes!("../distilled_relu3_1.onnx");

/// Its file's name without `.onnx`: what features, style statistics and decoders that belong to it call it.
pub const ENCODER_NAME: &str = "distilled_relu3_1";
