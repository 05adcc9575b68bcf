//! Which encoder a command uses, and whose weights its losses see through.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{Encoder, encoder::named_by_environment, resolve};

use crate::cli::output::warn;

/// Opens the encoder that `path` names, else the environment's, else the default one, and prints its warning.
///
/// # Errors
/// When it cannot be opened.
pub fn open_encoder(path: Option<&Path>) -> Result<Encoder> {
    let encoder = resolve(path, Some((ENCODER_NAME, ENCODER)))?;
    warn(encoder.warning());
    Ok(encoder)
}

/// VGG-19's weights, for losses: in the file that `vgg` names, else in the encoder's own.
///
/// # Errors
/// When the encoder is none of VGG's weights, which the message explains.
pub fn loss_weights(vgg: Option<&Path>, encoder: Option<&Path>) -> Result<PathBuf> {
    let is_onnx = |path: &PathBuf| path.extension().is_some_and(|name| name.eq_ignore_ascii_case("onnx"));
    let own = || encoder.map(PathBuf::from).or_else(named_by_environment).filter(|path| !is_onnx(path));
    vgg.map(PathBuf::from).or_else(own).context(
        "the loss looks through VGG-19 whatever the encoder: name its weights (safetensors) with --vgg FILE",
    )
}
