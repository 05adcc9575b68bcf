//! The computation of a style, in a task: from statistics and looks to colors, or to the weights that the GPU needs for
//! them.

use std::sync::Arc;

use stylegaussian::{
    ChannelStatistics, Decoder, Look, Scene,
    fold::{self, StylizeError},
    look,
};
use stylegaussian_gpu::style::FoldedLayers;

use crate::{
    colors::{ColorSource, FoldedStyle},
    scene::GaussianScene,
};

use super::{
    applied::{AppliedColors, AppliedStyle},
    decoder::choose_decoder,
    error::StyleError,
    packed::PackedInputs,
    settings::StyleBackend,
};

/// Everything that a style is computed from.
pub(super) struct StyleRequest {
    pub(super) scene: GaussianScene,
    /// The entity's decoder, or `None` if it has none of its own.
    pub(super) decoder: Option<Arc<Decoder>>,
    /// Styles to decode, and their weights.
    pub(super) styles: Vec<(Arc<ChannelStatistics>, f64)>,
    /// Looks to mix with what is decoded.
    pub(super) looks: Vec<WeightedLook>,
    /// Share of the content's features that stays, 0..1.
    pub(super) content: f64,
    /// The backend to decode on: the CPU if there are looks.
    pub(super) backend: StyleBackend,
    pub(super) packed: PackedInputs,
}

/// A look of a mix.
pub(super) struct WeightedLook {
    /// The asset's path, for messages.
    pub(super) name: String,
    pub(super) look: Arc<Look>,
    pub(super) weight: f64,
}

/// A computed style.
pub(super) struct StyleResult {
    pub(super) style: AppliedStyle,
    pub(super) colors: ColorSource,
}

impl StyleRequest {
    /// Folds the styles into the decoder. On the CPU backend, decodes the colors too and mixes the looks in.
    ///
    /// # Errors
    /// If parts do not go together: a look with the scene, or styles with a scene without features, or with the decoder.
    pub(super) fn run(self) -> Result<StyleResult, StyleError> {
        if self.backend == StyleBackend::Gpu {
            return self.fold();
        }
        let scene = Arc::clone(self.scene.scene());
        let colors: Arc<[_]> = match self.looks.is_empty() {
            true => self.decode(&scene)?.into(),
            false => self.mix(&scene)?.into(),
        };
        // Kept with the style, so that saving it later costs nothing.
        let style = AppliedStyle { scene, colors: AppliedColors::Known(Arc::clone(&colors)) };
        Ok(StyleResult { style, colors: ColorSource::Rgb(colors) })
    }

    /// The weights from which the GPU decodes the styles.
    fn fold(self) -> Result<StyleResult, StyleError> {
        let scene = Arc::clone(self.scene.scene());
        let decoder = self.decoder()?;
        if scene.features.is_none() {
            return Err(StylizeError::NoFeatures.into());
        }
        // Packed in this task: the render thread only uploads.
        let inputs = self.packed.get(&scene, &decoder)?;
        // The content's statistics are part of the inputs, so a further style of a scene does not pass over its N
        // features.
        let map = inputs.content().transfer(&self.weighted_styles(), self.content)?;
        let layers = FoldedLayers::new(inputs.content(), &decoder, &map)?;
        let colors = AppliedColors::Decoded { decoder, map: Arc::new(map) };
        let folded = ColorSource::Folded(Arc::new(FoldedStyle { inputs, layers }));
        Ok(StyleResult { style: AppliedStyle { scene, colors }, colors: folded })
    }

    /// The colors of the styles `[N]`.
    fn decode(&self, scene: &Scene) -> Result<Vec<[f32; 3]>, StyleError> {
        let decoder = self.decoder()?;
        let features = scene.features.as_ref().ok_or(StylizeError::NoFeatures)?;
        let map = fold::transfer(features, &self.weighted_styles(), self.content)?;
        Ok(fold::stylize(scene, &decoder, &map)?)
    }

    /// The colors of looks and styles together `[N]`.
    fn mix(&self, scene: &Scene) -> Result<Vec<[f32; 3]>, StyleError> {
        // All weights in a row, the looks' first.
        let looks = self.looks.iter().map(|look| look.weight);
        let weights = looks.chain(self.styles.iter().map(|(_, weight)| *weight));
        let weights = fold::normalized(&weights.collect::<Vec<_>>())?;
        let (of_looks, of_styles) = weights.split_at(self.looks.len());
        let colors = |(WeightedLook { name, look, .. }, weight): (&WeightedLook, &f64)| {
            let colors = look.colors_for(scene);
            let colors = colors.map_err(|source| StyleError::Look { look: name.clone(), source })?;
            Ok((colors, *weight))
        };
        // Before the styles are decoded, which takes longer: a look of another scene must not make its user wait.
        let looks = self.looks.iter().zip(of_looks).map(colors).collect::<Result<Vec<_>, StyleError>>()?;
        let share: f64 = of_styles.iter().sum();
        let decoded = if share > 0.0 { Some(self.decode(scene)?) } else { None };
        let decoded = decoded.as_deref().map(|colors| (colors, share));
        Ok(look::mix(&scene.base_colors(), self.content, &looks, decoded)?)
    }

    fn decoder(&self) -> Result<Arc<Decoder>, StyleError> {
        choose_decoder(self.decoder.as_ref(), self.scene.decoder())
    }

    fn weighted_styles(&self) -> Vec<(&ChannelStatistics, f64)> {
        self.styles.iter().map(|(style, weight)| (&**style, *weight)).collect()
    }
}
