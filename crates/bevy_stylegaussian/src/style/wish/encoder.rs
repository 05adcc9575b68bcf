//! The encoder of style images that are decoded: the asset, and the setting of the app.

use std::{
    error::Error,
    sync::{Arc, LazyLock},
};

use bevy::prelude::*;
use stylegaussian_encoder::{Encoder, EncoderError};

use crate::loader::FromFile;

/// An encoder of style images, for the decoder: an `.encoder.safetensors` that `stylegaussian distill` wrote,
/// or with the feature `onnx` an `.onnx` file from RGB 0..1 `[1, 3, H, W]` to features `[1, D, h, w]`. Use it
/// with [`StyleEncoder`].
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

/// The encoder of style images that are decoded. A resource. Paint needs none.
///
/// The default handle names the bundled encoder, which needs the feature `bundled_models` and is opened in the
/// background when the first image has to be encoded. If the handle or its asset changes, all images are
/// encoded again.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::style::decoder::StyleEncoder;
/// # fn system(mut commands: Commands, assets: Res<AssetServer>) {
/// commands.insert_resource(StyleEncoder(assets.load("vgg19_relu3_1.encoder.safetensors")));
/// # }
/// ```
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Resource, Clone, Debug, Default, PartialEq)]
pub struct StyleEncoder(pub Handle<ImageEncoder>);

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
