//! Assets that a style is made of: statistics, looks, decoders and encoders.

use std::{
    error::Error,
    sync::{Arc, LazyLock},
};

use bevy::prelude::*;
use stylegaussian::{ChannelStatistics, Decoder, Look, paint::Paint};
use stylegaussian_encoder::{Encoder, EncoderError};
use stylegaussian_files::{decoder_from_bytes, look_from_bytes, paint_from_bytes, style_from_bytes};

use crate::loader::FromFile;

/// A style that was read from an image before: `.style.safetensors`, as `stylegaussian style IMAGE` writes it.
/// It needs no encoder at run time, not even to be decoded.
#[derive(Asset, Clone, Reflect)]
#[reflect(opaque)]
#[reflect(Clone)]
pub struct StyleStatistics {
    /// Statistics of the style's features, which the decoder takes.
    pub statistics: Arc<ChannelStatistics>,
    /// The painting's own paint, or `None` if the file carries none. Such a style cannot be painted, only
    /// decoded, for which the scene needs features: see [`StyleMethod`](crate::StyleMethod).
    pub paint: Option<Arc<Paint>>,
}

impl FromFile for StyleStatistics {
    const EXTENSIONS: &[&str] = &["style.safetensors"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let statistics = Arc::new(style_from_bytes(&bytes, path)?);
        Ok(Self { statistics, paint: paint_from_bytes(&bytes, path)?.map(Arc::new) })
    }
}

/// Baked colors of one scene, and the strokes over them: `.look.safetensors`, as `stylegaussian bake` writes
/// them. It belongs to the scene that it was baked for, from whichever file that is loaded, and needs neither
/// features nor a decoder.
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct StyleLook(pub Arc<Look>);

impl FromFile for StyleLook {
    const EXTENSIONS: &[&str] = &["look.safetensors"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self(Arc::new(look_from_bytes(&bytes, path)?)))
    }
}

/// A decoder from features to colors: `.decoder.safetensors`, as `stylegaussian train` writes them. Use it with
/// [`StyleDecoder`](crate::StyleDecoder).
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct GaussianDecoder(pub Arc<Decoder>);

impl FromFile for GaussianDecoder {
    const EXTENSIONS: &[&str] = &["decoder.safetensors"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self(Arc::new(decoder_from_bytes(&bytes, path)?)))
    }
}

/// An encoder of style images, for the decoder: an `.encoder.safetensors` that `stylegaussian distill` wrote,
/// or with the feature `onnx` an `.onnx` file from RGB 0..1 `[1, 3, H, W]` to features `[1, D, h, w]`. Use it
/// with [`StyleEncoder`](crate::StyleEncoder).
#[derive(Asset, Clone, Reflect)]
#[reflect(opaque)]
#[reflect(Clone)]
pub struct ImageEncoder(
    // Lazy, so that an app that uses presets alone never pays for opening the bundled encoder. The lock opens
    // it once, even if two images need it at the same time.
    Arc<LazyLock<Opened, Box<dyn FnOnce() -> Opened + Send>>>,
);

/// An open encoder, or the reason why it cannot be used.
type Opened = Result<Encoder, Arc<EncoderError>>;

impl ImageEncoder {
    /// An encoder that a program has opened, for example from VGG-19 weights: see [`Encoder::open`].
    pub fn new(encoder: Encoder) -> Self {
        Self::lazy(move || Ok(encoder))
    }

    fn lazy(open: impl FnOnce() -> Opened + Send + 'static) -> Self {
        Self(Arc::new(LazyLock::new(Box::new(open))))
    }

    /// The encoder. The first call opens the bundled one, which takes a moment: not for the main thread.
    pub(crate) fn get(&self) -> Result<&Encoder, Arc<EncoderError>> {
        LazyLock::force(&self.0).as_ref().map_err(Arc::clone)
    }
}

impl FromFile for ImageEncoder {
    const EXTENSIONS: &[&str] = &["encoder.safetensors", "onnx"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self::new(Encoder::from_bytes(path, bytes)?))
    }
}

/// Adds the bundled encoder as the default asset, so that `Handle::default()` names it. It is opened at its
/// first use.
#[cfg(feature = "bundled_models")]
pub(crate) fn add_bundled_encoder(world: &mut World) {
    use stylegaussian_defaults::{ENCODER, ENCODER_NAME};

    let bundled =
        ImageEncoder::lazy(|| Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec()).map_err(Arc::new));
    // An explicit id: `Assets::add` would draw a new one, which no default handle names.
    let added = world.resource_mut::<Assets<ImageEncoder>>().insert(AssetId::default(), bundled);
    added.expect("the default id is a UUID, which is always valid");
}
