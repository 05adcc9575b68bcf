//! The default decoder, as bytes, so that a program that only names our crates can stylize without a download.

/// The default decoder, a `*.decoder.safetensors`: K = 8, 256-128-64-32-3 channels, f16. It belongs to the encoder that
/// its metadata names. How it was trained, and on what, is told in `assets/README.md` of the repository.
pub const DECODER: &[u8] = include_bytes!("../default.decoder.safetensors");
