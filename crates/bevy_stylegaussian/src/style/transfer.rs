//! The computing of a look, in the background: from statistics to colors, or to what the GPU needs for them.

use std::sync::Arc;

use stylegaussian::{
    ChannelStatistics, Decoder,
    fold::{self, StylizeError},
};

use crate::asset::GaussianScene;

use stylegaussian_gpu::style::FoldedLayers;

use super::{
    decoder::default_decoder,
    event::{AppliedStyle, StyleError},
    look::{FoldedStyle, LookColors},
    packed::PackedInputs,
    settings::StyleBackend,
};

/// All that a look is computed from.
pub(super) struct Order {
    pub(super) scene: GaussianScene,
    /// The entity's own decoder.
    pub(super) decoder: Option<Arc<Decoder>>,
    pub(super) styles: Vec<(Arc<ChannelStatistics>, f64)>,
    /// How much of the content stays, 0..1.
    pub(super) content: f64,
    /// Where to decode.
    pub(super) backend: StyleBackend,
    pub(super) packed: PackedInputs,
}

/// A computed look.
pub(super) struct Transferred {
    pub(super) style: AppliedStyle,
    pub(super) colors: LookColors,
}

impl Order {
    /// Folds the transfer, and on the processor decodes the colors.
    ///
    /// # Errors
    /// No features, no decoder, or parts that do not go together.
    pub(super) fn carry_out(self) -> Result<Transferred, StyleError> {
        let scene = Arc::clone(self.scene.scene());
        let decoder = match self.decoder.as_ref().or(self.scene.decoder()) {
            Some(decoder) => Arc::clone(decoder),
            None => default_decoder()?,
        };
        let features = scene.features.as_ref().ok_or(StylizeError::NoFeatures)?;
        let styles: Vec<_> = self.styles.iter().map(|(style, weight)| (&**style, *weight)).collect();
        if self.backend == StyleBackend::Gpu {
            let inputs = self.packed.get(&scene, &decoder)?;
            let map = inputs.content().transfer(&styles, self.content)?;
            let layers = FoldedLayers::new(inputs.content(), &decoder, &map)?;
            let style = AppliedStyle { scene, decoder, map: Arc::new(map), colors: None };
            return Ok(Transferred {
                style,
                colors: LookColors::Folded(Arc::new(FoldedStyle { inputs, layers })),
            });
        }
        let map = Arc::new(fold::transfer(features, &styles, self.content)?);
        let mut style = AppliedStyle { scene, decoder, map, colors: None };
        let rgb = style.colors()?;
        style.colors = Some(Arc::clone(&rgb));
        Ok(Transferred { style, colors: LookColors::Rgb(rgb) })
    }
}
