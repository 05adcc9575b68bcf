//! What becomes of a style: messages and observers, and the component that keeps what is shown.

use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use bevy::prelude::*;
use stylegaussian::{
    Decoder, Scene,
    fold::{self, ChannelMap, StylizeError},
};
use stylegaussian_encoder::EncoderError;

use super::settings::StyleBackend;

/// An entity's new look is complete and is drawn from this frame on (or begins to fade in).
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct StyleApplied {
    /// The entity.
    pub entity: Entity,
    /// Where the colors were computed: [`StyleBackend::Cpu`] or [`StyleBackend::Gpu`].
    pub backend: StyleBackend,
    /// From the change that asked for it to now.
    pub elapsed: Duration,
}

/// An entity could not be styled as asked; it keeps the look it has.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct StyleFailed {
    /// The entity.
    pub entity: Entity,
    /// Why, and what to do about it.
    #[reflect(ignore, default = "unknown_error")]
    pub error: Arc<StyleError>,
}

/// What a [`StyleFailed`] made by reflection says, as errors do not reflect.
fn unknown_error() -> Arc<StyleError> {
    Arc::new(StyleError::Gpu("unknown".into()))
}

/// Why a style could not be applied.
#[derive(Debug, thiserror::Error)]
pub enum StyleError {
    /// Scene, decoder, styles or weights do not go together, or the scene was never embedded.
    #[error(transparent)]
    Stylize(#[from] StylizeError),
    /// No decoder at all.
    #[error(
        "the scene carries no decoder and the plugin was built without its default one: enable the feature `defaults`, or \
         add a StyleDecoder to the entity"
    )]
    NoDecoder,
    /// An image is to be encoded, nobody named an encoder, and the plugin was built without its default one.
    #[error(
        "a style image needs an encoder: enable the feature `defaults`, or name its file in StyleGaussianPlugin {{ encoder \
         }}, in the resource StyleEncoder or in the environment variable STYLEGAUSSIAN_ENCODER; StyleSource::preset needs \
         none (`stylegaussian style IMAGE` makes presets)"
    )]
    NoEncoder,
    /// The encoder could not be opened or used.
    #[error("{image}: {source}")]
    Encoder {
        /// The image.
        image: String,
        /// What the encoder said.
        source: Arc<EncoderError>,
    },
    /// The image has no pixels that can be encoded.
    #[error("{image}: the image cannot be encoded: {found}")]
    Image {
        /// The image.
        image: String,
        /// What it is instead of an image with 8-bit pixels in main memory.
        found: String,
    },
    /// An asset that the style needs could not be loaded. The message names it.
    #[error("{0}")]
    Load(String),
    /// The graphics processor cannot take the scene or the decoder.
    #[error("the scene cannot be styled on this GPU: {0}; StyleBackend::Cpu can style it")]
    Gpu(String),
}

/// The style that an entity shows: there once [`StyleApplied`] was sent, gone with [`StyleSource::none`] or the scene.
///
/// [`StyleSource::none`]: crate::StyleSource::none
#[derive(Component, Clone, Reflect)]
#[reflect(opaque)]
#[reflect(Component, Clone)]
pub struct AppliedStyle {
    pub(crate) scene: Arc<Scene>,
    pub(crate) decoder: Arc<Decoder>,
    pub(crate) map: Arc<ChannelMap>,
    /// Known already where the processor computed them.
    pub(crate) colors: Option<Arc<[[f32; 3]]>>,
}

impl AppliedStyle {
    /// One color per Gaussian of the scene `[N]`, display-referred RGB, not clamped. Where the GPU styled the entity they
    /// are computed anew on the processor, which can take seconds: call it on a task pool.
    ///
    /// # Errors
    /// None for what [`StyleApplied`] was sent for.
    pub fn colors(&self) -> Result<Arc<[[f32; 3]]>, StylizeError> {
        match &self.colors {
            Some(colors) => Ok(Arc::clone(colors)),
            None => Ok(fold::stylize(&self.scene, &self.decoder, &self.map)?.into()),
        }
    }

    /// The scene in the colors it is shown in, to be written with `stylegaussian::file::write_scene`.
    ///
    /// # Errors
    /// As [`Self::colors`].
    pub fn styled_scene(&self) -> Result<Scene, StylizeError> {
        let colors = self.colors()?;
        let mut scene = Scene::clone(&self.scene);
        scene.set_colors(&colors);
        Ok(scene)
    }
}

/// How many style passes the GPU has run since the app started. A frame in which no style changed adds none.
#[derive(Resource, Clone, Debug, Default, Reflect)]
#[reflect(opaque)]
#[reflect(Resource, Clone, Debug, Default)]
pub struct StylePassCount(Arc<AtomicU64>);

impl StylePassCount {
    /// The count.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    pub(crate) fn add_one(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}
