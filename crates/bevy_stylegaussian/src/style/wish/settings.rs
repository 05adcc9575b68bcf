//! Settings of the app: three resources.

use bevy::{prelude::*, render::extract_resource::ExtractResource};

/// Backend that decodes features to colors. A resource; changing it affects later changes of style.
///
/// It is the decoder's alone: paint ([`StyleMethod::Paint`], the default) is laid on by the CPU, and looks are
/// colors already, whichever backend is set.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Resource, Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum StyleBackend {
    /// The GPU, or the CPU if the adapter is software (such as llvmpipe), where the CPU's own decoder is
    /// faster. Also the CPU if the scene or its decoder is too large for the GPU.
    #[default]
    Auto,
    /// The CPU, in the background.
    Cpu,
    /// The GPU.
    Gpu,
}

/// How a style becomes colors. A resource; changing it affects later changes of style.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Resource, Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum StyleMethod {
    /// The painting's own strokes over colors of its palette ([`stylegaussian::paint`]), drawn by the pixel.
    /// Any scene will do, and any image: neither features nor an encoder take part. The colors are computed on
    /// the CPU in the background: a few seconds for 70,000 Gaussians on two cores at a scene's first style,
    /// less if it is prepared, and about half a second afterwards. While another painting is laid on, the scene
    /// is shown recolored in its palette, which takes milliseconds, except under
    /// [`HiddenUntilStyled`](crate::HiddenUntilStyled). Events are those of the paint.
    ///
    /// A scene with a decoder of its own, an entity with a
    /// [`StyleDecoder`](crate::style::decoder::StyleDecoder), and presets without paint are decoded instead.
    #[default]
    Paint,
    /// The decoder alone, as in the paper, on the [`StyleBackend`]: the painting's palette, without its
    /// strokes. The scene needs features, and images an encoder.
    Decoder,
}

/// GPU time per frame for all style changes that the decoder computes, together. A resource.
///
/// A change that takes longer is spread over several frames, and the old colors stay until the new ones are
/// complete. The GPU's timestamps measure the time. If the device has no timestamps, the speed of an old
/// integrated GPU is assumed.
///
/// Each frame decodes at least 128 Gaussians in one layer, even if that exceeds the budget. Devices with small
/// limits split the inputs of a layer and may exceed it by more. [`StyleBackend::Cpu`] has no budget: it works
/// in the background, and so does paint ([`StyleMethod::Paint`], the default), which takes no GPU time.
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
