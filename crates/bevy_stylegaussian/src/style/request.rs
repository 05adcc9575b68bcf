//! The computation of a style, in a task: from statistics to colors, or to the weights that the GPU needs for them.

use std::sync::Arc;

use stylegaussian::{
    ChannelStatistics, Decoder,
    fold::{self, StylizeError},
};
use stylegaussian_gpu::style::FoldedLayers;

use crate::{
    colors::{ColorSource, FoldedStyle},
    scene::GaussianScene,
};

use super::{
    applied::AppliedStyle, decoder::choose_decoder, error::StyleError, packed::PackedInputs,
    settings::StyleBackend,
};

/// Everything that a style is computed from.
pub(super) struct StyleRequest {
    pub(super) scene: GaussianScene,
    /// The entity's decoder, or `None` if it has none of its own.
    pub(super) decoder: Option<Arc<Decoder>>,
    /// Styles and their weights.
    pub(super) styles: Vec<(Arc<ChannelStatistics>, f64)>,
    /// Share of the content's features that stays, 0..1.
    pub(super) content: f64,
    /// The backend to decode on.
    pub(super) backend: StyleBackend,
    pub(super) packed: PackedInputs,
}

/// A computed style.
pub(super) struct StyleResult {
    pub(super) style: AppliedStyle,
    pub(super) colors: ColorSource,
}

impl StyleRequest {
    /// Folds the style into the decoder. On the CPU backend, decodes the colors too.
    ///
    /// # Errors
    /// If there are no features or no decoder, or if the parts do not go together.
    pub(super) fn run(self) -> Result<StyleResult, StyleError> {
        let scene = Arc::clone(self.scene.scene());
        let decoder = choose_decoder(self.decoder.as_ref(), self.scene.decoder())?;
        let features = scene.features.as_ref().ok_or(StylizeError::NoFeatures)?;
        let styles: Vec<_> = self.styles.iter().map(|(style, weight)| (&**style, *weight)).collect();
        if self.backend == StyleBackend::Gpu {
            // Packed in this task: the render thread only uploads.
            let inputs = self.packed.get(&scene, &decoder)?;
            // The content's statistics are part of the inputs, so a further style of a scene does not pass over its N
            // features.
            let map = inputs.content().transfer(&styles, self.content)?;
            let layers = FoldedLayers::new(inputs.content(), &decoder, &map)?;
            let style = AppliedStyle { scene, decoder, map: Arc::new(map), colors: None };
            let colors = ColorSource::Folded(Arc::new(FoldedStyle { inputs, layers }));
            return Ok(StyleResult { style, colors });
        }
        let map = Arc::new(fold::transfer(features, &styles, self.content)?);
        let mut style = AppliedStyle { scene, decoder, map, colors: None };
        // Kept with the style, so that saving it later costs nothing.
        let rgb = style.colors()?;
        style.colors = Some(Arc::clone(&rgb));
        Ok(StyleResult { style, colors: ColorSource::Rgb(rgb) })
    }
}
