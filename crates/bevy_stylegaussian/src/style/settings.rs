//! Settings of the app: where styles are decoded, and which encoder reads images.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
};

use bevy::{prelude::*, render::extract_resource::ExtractResource};
use stylegaussian_encoder::{Encoder, EncoderError, encoder::BuiltIn};

/// The encoder that comes with the plugin.
#[cfg(feature = "defaults")]
const BUILT_IN: Option<BuiltIn<'_>> =
    Some((stylegaussian_defaults::ENCODER_NAME, stylegaussian_defaults::ENCODER));
#[cfg(not(feature = "defaults"))]
const BUILT_IN: Option<BuiltIn<'_>> = None;

/// Where features are decoded to colors.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Resource, Clone, Debug, Default, PartialEq)]
pub enum StyleBackend {
    /// On the GPU, unless it is one in name only (software Vulkan), which the processor's own decoder beats.
    #[default]
    Auto,
    /// On the processor, in the background.
    Cpu,
    /// On the GPU.
    Gpu,
}

/// How much of each frame changes of style may take on the GPU, all of them together. A change that takes longer is spread
/// over frames; the old look stays until the new one is complete.
///
/// What the GPU does in that time is measured by its own clock; where it has none, an old integrated GPU is assumed. A frame
/// can exceed the budget by what decodes 128 Gaussians in one layer (more on devices whose small limits cut a layer's
/// inputs). It says nothing about [`StyleBackend::Cpu`], which works in the background.
#[derive(Resource, ExtractResource, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Resource, Clone, Debug, Default, PartialEq)]
pub struct StyleBudget {
    /// Milliseconds, at least 0. Infinite by default: a change is complete in the frame in which it begins.
    pub ms_per_frame: f32,
}

impl Default for StyleBudget {
    fn default() -> Self {
        Self { ms_per_frame: f32::INFINITY }
    }
}

/// The encoder that reads style images: VGG-19 weights or an ONNX file, opened in the background when the first image is
/// to be encoded. Without a path it is the one that the environment variable `STYLEGAUSSIAN_ENCODER` names, otherwise the
/// default one, which comes with the feature `defaults`.
///
/// Insert another one to change it: all images are then encoded anew.
#[derive(Resource, Clone, Default, Reflect)]
#[reflect(Resource, Clone, Default)]
pub struct StyleEncoder {
    path: Option<PathBuf>,
    #[reflect(ignore)]
    opened: Arc<OnceLock<Result<Encoder, Arc<EncoderError>>>>,
}

impl StyleEncoder {
    /// The encoder in this file: `.safetensors` or `.pth` weights of VGG-19, or `.onnx`.
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self { path: Some(path.into()), ..Self::default() }
    }

    /// Its file, unless the environment names it.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// Opens the encoder at the first call, which takes a moment, and keeps it.
    pub(crate) fn open(&self) -> Result<&Encoder, Arc<EncoderError>> {
        let opened = || stylegaussian_encoder::resolve(self.path(), BUILT_IN).map_err(Arc::new);
        self.opened.get_or_init(opened).as_ref().map_err(Arc::clone)
    }
}
