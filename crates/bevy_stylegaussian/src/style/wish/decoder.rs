//! The choice of the decoder that styles a scene.

use std::sync::Arc;

use stylegaussian::Decoder;

use crate::style::wish::error::StyleError;

/// The decoder of an entity's style: the entity's own, else the one that its scene carries, else the bundled
/// one.
///
/// # Errors
/// If it is the bundled one, and that is not compiled in or does not parse.
pub(crate) fn choose_decoder(
    of_entity: Option<&Arc<Decoder>>,
    of_scene: Option<&Arc<Decoder>>,
) -> Result<Arc<Decoder>, StyleError> {
    of_entity.or(of_scene).map_or_else(bundled_decoder, |decoder| Ok(Arc::clone(decoder)))
}

/// The bundled decoder, parsed at the first call.
#[cfg(feature = "bundled_models")]
fn bundled_decoder() -> Result<Arc<Decoder>, StyleError> {
    use std::sync::LazyLock;

    use stylegaussian_files::decoder_from_bytes;

    // One `Arc` for all scenes of the process. Packed inputs are found by the decoder's address, so a second
    // copy would pack again.
    static DECODER: LazyLock<Result<Arc<Decoder>, String>> = LazyLock::new(|| {
        let decoder = decoder_from_bytes(stylegaussian_defaults::DECODER, "the bundled decoder");
        decoder.map(Arc::new).map_err(|error| error.to_string())
    });
    DECODER.clone().map_err(StyleError::BundledDecoder)
}

#[cfg(not(feature = "bundled_models"))]
fn bundled_decoder() -> Result<Arc<Decoder>, StyleError> {
    Err(StyleError::NoDecoder)
}
