//! The computation of a style, in a task: from canvases, statistics and looks to colors and strokes, or to the
//! weights that the GPU needs for them.

use std::sync::Arc;

use stylegaussian::{
    ChannelStatistics, Decoder, Look, Scene,
    fold::{self, StylizeError},
    look,
    paint::{self, Canvas, Painted},
    strokes::Strokes,
};
use stylegaussian_gpu::style::FoldedLayers;

use crate::{
    colors::{ColorSource, FoldedStyle, StyleColors},
    scene::GaussianScene,
};

use super::{
    applied::{AppliedColors, AppliedStyle},
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
    pub(super) styles: Styles,
    /// Looks to mix with them.
    pub(super) looks: Vec<WeightedLook>,
    /// Share of the content's colors or features that stays, 0..1.
    pub(super) content: f64,
    /// The backend to decode on: the CPU if there are looks, or if the scene is painted.
    pub(super) backend: StyleBackend,
    pub(super) packed: PackedInputs,
    pub(super) surfaces: Surfaces,
}

/// Images and presets, and their weights.
pub(super) enum Styles {
    /// To paint the scene with.
    Painted(Vec<(Arc<Canvas>, f64)>),
    /// To be decoded.
    Decoded(Vec<(Arc<ChannelStatistics>, f64)>),
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
    /// Folds the styles into the decoder. On the CPU backend, paints or decodes the scene and mixes the looks
    /// in.
    ///
    /// # Errors
    /// If parts do not go together: a look with the scene, or decoded styles with a scene without features, or
    /// with the decoder.
    pub(super) async fn run(&self) -> Result<StyleResult, StyleError> {
        if self.backend == StyleBackend::Gpu {
            return self.fold().await;
        }
        let scene = Arc::clone(self.scene.scene());
        let Painted { colors, strokes, .. } = match self.looks.is_empty() {
            true => self.colors(&scene).await?,
            false => self.mix(&scene).await?,
        };
        let colors: Arc<[_]> = colors.into();
        let strokes = (!strokes.seeds.is_empty()).then(|| Arc::new(strokes));
        let shown = StyleColors::known(Arc::clone(&colors), strokes.clone());
        // Kept with the style, so that saving it later costs nothing.
        let style = AppliedStyle { scene, colors: AppliedColors::Known { colors, strokes } };
        Ok(StyleResult { colors: shown, style })
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
        // The content's statistics are part of the inputs, so a further style of a scene does not pass over its
        // N features.
        let map = inputs.content().transfer(&self.weighted_styles(), self.content)?;
        let layers = FoldedLayers::new(inputs.content(), &decoder, &map)?;
        let colors = AppliedColors::Decoded { decoder, map: Arc::new(map) };
        let folded = ColorSource::Folded(Box::new(FoldedStyle { inputs, layers }));
        let folded = StyleColors::new(folded, scene.len());
        Ok(StyleResult { style: AppliedStyle { scene, colors }, colors: folded })
    }

    /// The scene in the styles, painted or decoded.
    async fn colors(&self, scene: &Arc<Scene>) -> Result<Painted, StyleError> {
        let canvases = match &self.styles {
            Styles::Painted(canvases) => canvases,
            Styles::Decoded(_) => return Ok(Painted { colors: self.decode(scene)?, ..Painted::default() }),
        };
        fold::normalized(&canvases.iter().map(|(_, weight)| *weight).collect::<Vec<_>>())?;
        if !(0.0..=1.0).contains(&self.content) {
            return Err(StylizeError::Content { found: self.content }.into());
        }
        let surface = self.surfaces.get(scene).await;
        let canvases: Vec<_> = canvases.iter().map(|(canvas, weight)| (&**canvas, *weight)).collect();
        Ok(paint::lay(scene, &surface, &canvases, self.content))
    }

    /// The colors of the decoded styles `[N]`.
    fn decode(&self, scene: &Arc<Scene>) -> Result<Vec<[f32; 3]>, StyleError> {
        let features = scene.features.as_ref().ok_or(StylizeError::NoFeatures)?;
        let map = fold::transfer(features, &self.weighted_styles(), self.content)?;
        Ok(fold::stylize(scene, &*self.decoder()?, &map)?)
    }

    /// The colors and the strokes of looks and styles together.
    async fn mix(&self, scene: &Arc<Scene>) -> Result<Painted, StyleError> {
        // All weights in a row, the looks' first.
        let looks = self.looks.iter().map(|look| look.weight);
        let weights = fold::normalized(&looks.chain(self.styles.weights()).collect::<Vec<_>>())?;
        let (of_looks, of_styles) = weights.split_at(self.looks.len());
        // Before the styles, which take longer: a look of another scene must not make its user wait.
        let (mut looks, mut strokes_of_looks) = (Vec::new(), Vec::new());
        for (WeightedLook { name, look, .. }, weight) in self.looks.iter().zip(of_looks) {
            let failed = |source| StyleError::Look { look: name.clone(), source };
            looks.push((look.colors_for(scene).map_err(failed)?, *weight));
            let mut strokes = look.strokes_for(scene).map_err(failed)?.unwrap_or_default();
            strokes.fade(1.0 - self.content as f32);
            strokes_of_looks.push((strokes, *weight));
        }
        let share: f64 = of_styles.iter().sum();
        let styled = if share > 0.0 { self.colors(scene).await? } else { Painted::default() };
        let colors = (share > 0.0).then_some((&*styled.colors, share));
        let colors = look::mix(&scene.base_colors(), self.content, &looks, colors)?;
        let strokes = mixed_strokes(std::iter::once((styled.strokes, share)).chain(strokes_of_looks));
        Ok(Painted { colors, strokes, ..Painted::default() })
    }

    /// Whether the style may have strokes.
    pub(super) fn has_strokes(&self) -> bool {
        matches!(self.styles, Styles::Painted(_)) || self.looks.iter().any(|look| look.look.has_strokes())
    }

    /// Whether another request gives the same colors: all of it is the same, in the same place in memory.
    pub(super) fn gives_the_same(&self, other: &Self) -> bool {
        let same_styles = match (&self.styles, &other.styles) {
            (Styles::Painted(a), Styles::Painted(b)) => same_shares(a, b),
            (Styles::Decoded(a), Styles::Decoded(b)) => same_shares(a, b),
            _ => false,
        };
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
            && (self.content, self.backend) == (other.content, other.backend)
    }

    fn decoder(&self) -> Result<Arc<Decoder>, StyleError> {
        choose_decoder(self.decoder.as_ref(), self.scene.decoder())
    }

    fn weighted_styles(&self) -> Vec<(&ChannelStatistics, f64)> {
        match &self.styles {
            Styles::Painted(_) => Vec::new(),
            Styles::Decoded(styles) => styles.iter().map(|(style, weight)| (&**style, *weight)).collect(),
        }
    }
}

impl Styles {
    /// Their weights.
    fn weights(&self) -> Vec<f64> {
        match self {
            Self::Painted(styles) => styles.iter().map(|(_, weight)| *weight).collect(),
            Self::Decoded(styles) => styles.iter().map(|(_, weight)| *weight).collect(),
        }
    }
}

/// Strokes in a mix by their weights. Each spot shows those of one part, and some show none if a part has none.
fn mixed_strokes(parts: impl Iterator<Item = (Strokes, f64)>) -> Strokes {
    let (mut mixed, mut total) = (Strokes::default(), 0.0);
    for (strokes, weight) in parts.filter(|(_, weight)| *weight > 0.0) {
        total += weight;
        mixed.mix(&strokes, (weight / total) as f32);
    }
    mixed
}

/// Whether two lists are of the same things and weights, each in the same place in memory.
fn same_shares<T>(a: &[(Arc<T>, f64)], b: &[(Arc<T>, f64)]) -> bool {
    pairs(a, b, |(a, w), (b, v)| w == v && Arc::ptr_eq(a, b))
}

/// Whether two lists are of one length and all of their pairs are the same.
fn pairs<T>(a: &[T], b: &[T], are_same: impl Fn(&T, &T) -> bool) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| are_same(a, b))
}
