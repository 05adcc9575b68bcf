//! Which decoder styles a scene: the entity's, else the scene's own, else the default one.

use std::sync::Arc;

use stylegaussian::Decoder;

use super::event::StyleError;

/// The decoder for a scene without one.
///
/// # Errors
/// When the plugin was built without its feature `defaults`.
#[cfg(feature = "defaults")]
pub(super) fn default_decoder() -> Result<Arc<Decoder>, StyleError> {
    use std::sync::OnceLock;

    use stylegaussian::file::decoder_from_bytes;

    static DECODER: OnceLock<Option<Arc<Decoder>>> = OnceLock::new();
    let parsed = || {
        let decoder = decoder_from_bytes(stylegaussian_defaults::DECODER, "the default decoder");
        decoder.inspect_err(|error| bevy::log::error!("{error}")).ok().map(Arc::new)
    };
    DECODER.get_or_init(parsed).clone().ok_or(StyleError::NoDecoder)
}

/// The decoder for a scene without one.
///
/// # Errors
/// Always: the plugin was built without its feature `defaults`.
#[cfg(not(feature = "defaults"))]
pub(super) fn default_decoder() -> Result<Arc<Decoder>, StyleError> {
    Err(StyleError::NoDecoder)
}
