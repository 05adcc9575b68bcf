//! The computation of a style, in a task: from statistics and looks to colors, or to the weights that the GPU needs for
//! them.

use std::sync::Arc;

use stylegaussian::{
    ChannelStatistics, Decoder, Look, Scene,
    fold::{self, StylizeError},
    look,
    paint::{Brush, repaint},
};
use stylegaussian_gpu::style::FoldedLayers;

use crate::{
    colors::{ColorSource, FoldedStyle, StyleColors},
    scene::GaussianScene,
};

use super::{
    applied::{AppliedColors, AppliedStyle},
    asset::StyleStatistics,
    decoder::choose_decoder,
    error::StyleError,
    packed::PackedInputs,
    settings::StyleBackend,
    surfaces::Surfaces,
};

/// Everything that a style is computed from.
pub(super) struct StyleRequest {
    pub(super) scene: GaussianScene,
    /// The entity's decoder, or `None` if it has none of its own.
    pub(super) decoder: Option<Arc<Decoder>>,
    /// Styles to paint or to decode, and their weights.
    pub(super) styles: Vec<(StyleStatistics, f64)>,
    /// Looks to mix with what is decoded.
    pub(super) looks: Vec<WeightedLook>,
    /// Share of the content's features that stays, 0..1.
    pub(super) content: f64,
    /// The backend to decode on: the CPU if there are looks, or if surfaces are painted.
    pub(super) backend: StyleBackend,
    /// Size of the strokes, or `None` if colors are decoded. Every style has paint if there is one.
    pub(super) stroke_scale: Option<f32>,
    pub(super) packed: PackedInputs,
    pub(super) surfaces: Surfaces,
}

/// A look of a mix.
pub(super) struct WeightedLook {
    /// The asset's path, for messages.
    pub(super) name: String,
    pub(super) look: Arc<Look>,
    pub(super) weight: f64,
}

/// A computed style.
#[derive(Clone)]
pub(super) struct StyleResult {
    pub(super) style: AppliedStyle,
    pub(super) colors: Arc<StyleColors>,
}

impl StyleRequest {
    /// Folds the styles into the decoder. On the CPU backend, paints or decodes the colors too and mixes the looks in.
    ///
    /// # Errors
    /// If parts do not go together: a look with the scene, or styles with a scene without features, or with the decoder.
    pub(super) async fn run(&self) -> Result<StyleResult, StyleError> {
        if self.backend == StyleBackend::Gpu {
            return self.fold().await;
        }
        let scene = Arc::clone(self.scene.scene());
        let colors: Arc<[_]> = match self.looks.is_empty() {
            true => self.decode(&scene)?.into(),
            false => self.mix(&scene)?.into(),
        };
        // Kept with the style, so that saving it later costs nothing.
        let style = AppliedStyle { scene, colors: AppliedColors::Known(Arc::clone(&colors)) };
        Ok(StyleResult { colors: StyleColors::new(ColorSource::Rgb(colors), style.scene.len()), style })
    }

    /// The weights from which the GPU decodes the styles.
    async fn fold(&self) -> Result<StyleResult, StyleError> {
        let scene = Arc::clone(self.scene.scene());
        let decoder = self.decoder()?;
        if scene.features.is_none() {
            return Err(StylizeError::NoFeatures.into());
        }
        // Packed in this task: the render thread only uploads.
        let inputs = self.packed.get(&scene, &decoder).await?;
        // The content's statistics are part of the inputs, so a further style of a scene does not pass over its N
        // features.
        let map = inputs.content().transfer(&self.weighted_styles(), self.content)?;
        let layers = FoldedLayers::new(inputs.content(), &decoder, &map)?;
        let colors = AppliedColors::Decoded { decoder, map: Arc::new(map) };
        let folded = ColorSource::Folded(Box::new(FoldedStyle { inputs, layers }));
        let folded = StyleColors::new(folded, scene.len());
        Ok(StyleResult { style: AppliedStyle { scene, colors }, colors: folded })
    }

    /// The colors of the styles `[N]`.
    fn decode(&self, scene: &Arc<Scene>) -> Result<Vec<[f32; 3]>, StyleError> {
        let features = scene.features.as_ref().ok_or(StylizeError::NoFeatures)?;
        // Before painting, too: it checks encoders, weights and content.
        let map = fold::transfer(features, &self.weighted_styles(), self.content)?;
        match self.stroke_scale {
            Some(stroke_scale) => Ok(self.paint(scene, stroke_scale)),
            None => Ok(fold::stylize(scene, &*self.decoder()?, &map)?),
        }
    }

    /// The colors of the styles in their own paint `[N]`.
    fn paint(&self, scene: &Arc<Scene>, stroke_scale: f32) -> Vec<[f32; 3]> {
        let surface = self.surfaces.get(scene, stroke_scale);
        let paint = |(style, weight): &(StyleStatistics, f64)| Some((style.paint.clone()?, *weight));
        let paints: Vec<_> = self.styles.iter().filter_map(paint).collect();
        let paints: Vec<_> = paints.iter().map(|(paint, weight)| (&**paint, *weight)).collect();
        repaint(scene, &surface, &paints, self.content, Brush::default())
    }

    /// The colors of looks and styles together `[N]`.
    fn mix(&self, scene: &Arc<Scene>) -> Result<Vec<[f32; 3]>, StyleError> {
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

    /// Whether another request gives the same colors: all of it is the same, in the same place in memory.
    pub(super) fn gives_the_same(&self, other: &Self) -> bool {
        let same_styles = pairs(&self.styles, &other.styles, |(a, w), (b, v)| {
            let same_paint = match (&a.paint, &b.paint) {
                (Some(a), Some(b)) => Arc::ptr_eq(a, b),
                (a, b) => a.is_none() && b.is_none(),
            };
            w == v && Arc::ptr_eq(&a.statistics, &b.statistics) && same_paint
        });
        let same_looks =
            pairs(&self.looks, &other.looks, |a, b| a.weight == b.weight && Arc::ptr_eq(&a.look, &b.look));
        let same_decoder = match (&self.decoder, &other.decoder) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        // The scene's own decoder goes with the scene.
        Arc::ptr_eq(self.scene.scene(), other.scene.scene())
            && same_styles
            && same_looks
            && same_decoder
            && (self.content, self.stroke_scale, self.backend)
                == (other.content, other.stroke_scale, other.backend)
    }

    fn decoder(&self) -> Result<Arc<Decoder>, StyleError> {
        choose_decoder(self.decoder.as_ref(), self.scene.decoder())
    }

    fn weighted_styles(&self) -> Vec<(&ChannelStatistics, f64)> {
        self.styles.iter().map(|(style, weight)| (&*style.statistics, *weight)).collect()
    }
}

/// Whether two lists are of one length and all of their pairs are the same.
fn pairs<T>(a: &[T], b: &[T], are_same: impl Fn(&T, &T) -> bool) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| are_same(a, b))
}
