//! Errors of styling.

use stylegaussian::{
    fold::StylizeError,
    look::LookError,
    paint::{AreaError, OtherScene, TintsError},
};

/// A style cannot be applied.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StyleError {
    /// Scene, decoder, styles or weights do not go together, or a scene that was never embedded is to be
    /// decoded.
    #[error(transparent)]
    Stylize(#[from] StylizeError),
    /// A preset cannot be painted, and the scene has no features to decode.
    #[error(
        "{preset}: the preset carries no paint (`stylegaussian style IMAGE` makes one that does), and the \
         scene has no features to decode it with"
    )]
    NoPaint {
        /// The preset.
        preset: String,
    },
    /// Neither entity nor scene has a decoder, and the plugin was built without the bundled one.
    #[error(
        "the scene carries no decoder and the plugin was built without the bundled one: enable the feature \
         `bundled_models`, or add a StyleDecoder to the entity"
    )]
    NoDecoder,
    /// The bundled decoder is damaged.
    #[error("the decoder that is bundled with the plugin cannot be read: {0}")]
    BundledDecoder(String),
    /// An image has to be encoded for a decoder, but no encoder is set and the plugin was built without the
    /// bundled one.
    #[error(
        "a decoded style image needs an encoder, and the plugin was built without the bundled one: enable the \
         feature `bundled_models`, or set the resource StyleEncoder to an `.encoder.safetensors` asset; \
         StyleSource::preset needs no encoder (`stylegaussian style IMAGE` makes presets)"
    )]
    NoEncoder,
    /// The encoder cannot be opened or used.
    #[cfg(feature = "images")]
    #[error("{image}: {source}")]
    Encoder {
        /// The image.
        image: String,
        /// The encoder's error.
        source: std::sync::Arc<stylegaussian_encoder::EncoderError>,
    },
    /// The style is an image, and the plugin was built without images.
    #[error(
        "{image}: the plugin was built without images: enable the feature `images`, or use a preset \
         (`stylegaussian style IMAGE` makes presets) or a look"
    )]
    NoImages {
        /// The image.
        image: String,
    },
    /// The image has no pixels that can be read.
    #[error("{image}: the image cannot be read: {found}")]
    Image {
        /// The image.
        image: String,
        /// The reason. An image needs 8-bit pixels in main memory.
        found: String,
    },
    /// The part of an image that is to be used is no part of it.
    #[error("{image}: {source}")]
    Crop {
        /// The image or preset.
        image: String,
        /// The part.
        source: AreaError,
    },
    /// All of an image or preset is transparent.
    #[error("{image}: all of the painting is transparent, expected pixels to paint from")]
    Transparent {
        /// The image or preset.
        image: String,
    },
    /// The given colors are no palette.
    #[error(transparent)]
    Palette(#[from] TintsError),
    /// Pinned places belong to another scene.
    #[error("{pins}: {source}")]
    OtherScene {
        /// The file.
        pins: String,
        /// The fingerprints of both scenes.
        source: OtherScene,
    },
    /// A number of the source, or a pinned place, is out of its range.
    #[error("{0}")]
    Source(String),
    /// A mesh cannot be painted.
    #[error("{mesh}: the mesh cannot be painted: {found}")]
    Mesh {
        /// The mesh.
        mesh: String,
        /// What was found, and what was expected.
        found: String,
    },
    /// A sky cannot be painted.
    #[error("{sky}: the sky cannot be painted: {found}")]
    Sky {
        /// The image.
        sky: String,
        /// What was found, and what was expected.
        found: String,
    },
    /// A look belongs to another scene.
    #[error("{look}: {source}")]
    Look {
        /// The look.
        look: String,
        /// The fingerprints of both scenes.
        source: LookError,
    },
    /// The decoder fails.
    #[error("the style cannot be decoded: {0}")]
    Decode(String),
    /// A computation panicked.
    #[error("the computation of the style ended early: the log says why")]
    Ended,
    /// A style cannot be refined. It stays as it is.
    #[error("the style cannot be refined: {0}")]
    Refine(String),
    /// An asset that the style needs could not be loaded. The message names it.
    #[error("{0}")]
    Load(String),
    /// [`StyleBackend::Gpu`](crate::style::decoder::StyleBackend::Gpu) is set, but the app does not render.
    #[error(
        "StyleBackend::Gpu is set but the app has no GPU; StyleBackend::Auto and StyleBackend::Cpu need none"
    )]
    NoGpu,
    /// The scene or the decoder is too large for the GPU.
    #[error("the scene cannot be styled on this GPU: {0}; StyleBackend::Cpu can style it")]
    Gpu(String),
}
