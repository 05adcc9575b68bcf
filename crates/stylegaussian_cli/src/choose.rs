//! The choice of decoder, encoder and loss weights that all commands share.

use std::{
    env,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use stylegaussian::{Decoder, Scene, file};
use stylegaussian_defaults::{DECODER, ENCODER, ENCODER_NAME};
use stylegaussian_encoder::Encoder;

use crate::terminal::warn;

/// The environment variable that names the encoder's file if no flag does.
const ENCODER_VARIABLE: &str = "STYLEGAUSSIAN_ENCODER";

/// Opens the encoder that `path` names, else the environment's, else the default one, and prints its warning.
///
/// # Errors
/// If it cannot be opened.
pub fn open_encoder(path: Option<&Path>) -> Result<Encoder> {
    let encoder = match path.map(PathBuf::from).or_else(named_by_environment) {
        Some(path) => Encoder::open(&path)?,
        None => Encoder::from_onnx(ENCODER_NAME, ENCODER.to_vec())?,
    };
    warn(encoder.warning());
    Ok(encoder)
}

/// The file that [`ENCODER_VARIABLE`] names.
fn named_by_environment() -> Option<PathBuf> {
    env::var_os(ENCODER_VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from)
}

/// VGG-19's weights for losses: the file that `vgg` names, or the encoder's own.
///
/// # Errors
/// If the encoder is not VGG-19. The message names the flag.
pub fn loss_weights(vgg: Option<&Path>, encoder: Option<&Path>) -> Result<PathBuf> {
    let is_onnx = |path: &PathBuf| path.extension().is_some_and(|name| name.eq_ignore_ascii_case("onnx"));
    let of_encoder =
        || encoder.map(PathBuf::from).or_else(named_by_environment).filter(|path| !is_onnx(path));
    vgg.map(PathBuf::from).or_else(of_encoder).context(
        "the loss needs VGG-19, whatever the encoder is: name its weights (safetensors) with --vgg FILE",
    )
}

/// A decoder and its name: its path, `scene` or `default`.
pub struct NamedDecoder {
    /// The decoder.
    pub decoder: Decoder,
    /// The name.
    pub name: String,
}

/// The decoder that `path` names, else the scene's own, else the default one.
///
/// # Errors
/// If the file cannot be read.
pub fn decoder(path: Option<&Path>, scene: &Scene) -> Result<NamedDecoder> {
    let (decoder, name) = match (path, &scene.decoder) {
        (Some(path), _) => (file::read_decoder(path)?, path.display().to_string()),
        (None, Some(decoder)) => (decoder.clone(), "scene".into()),
        (None, None) => (file::decoder_from_bytes(DECODER, "the default decoder")?, "default".into()),
    };
    Ok(NamedDecoder { decoder, name })
}
