//! The computation of a style: from canvases, statistics and looks to colors and strokes, or to the weights
//! that the GPU needs for them.

#[cfg(target_family = "wasm")]
mod apart;

use std::sync::Arc;

use stylegaussian::{
    Look, Scene,
    fold::StylizeError,
    paint::{Canvas, Direction, Hand, Painted, Pin, Tints, pin},
    restyle::{self, Recipe, RestyleError},
    strokes::Strokes,
    work::{Canceled, Work},
};
use stylegaussian_gpu::style::FoldedLayers;

#[cfg(feature = "meshes")]
use crate::style::make::brushwork::Brushwork;
use crate::{
    colors::{ColorSource, FoldedStyle, StyleColors},
    style::{
        make::{
            beside::Beside,
            later::{Encoded, Failure, Lazy, Stretched, settled},
            packed::LaterInputs,
            worker::{Ground, Painting},
        },
        wish::{
            applied::{AppliedColors, AppliedStyle},
            error::StyleError,
            settings::StyleBackend,
            strokes::StrokeDirection,
        },
    },
    work::{Lane, Running, Workers},
};

/// All that decides the colors of a style. Two that are equal give the same.
#[derive(Clone, PartialEq)]
pub(crate) struct StyleRequest {
    pub(crate) scene: Same<Scene>,
    pub(crate) styles: Styles,
    /// Looks to mix with them.
    pub(crate) looks: Vec<WeightedLook>,
    /// Share of the content's colors or features that stays, 0..1.
    pub(crate) content: f64,
    /// The backend to decode on: the CPU if there are looks, or if the scene is painted.
    pub(crate) backend: StyleBackend,
    /// The strokes that are shown, if only images of the style have changed. They stay unless colors are given.
    pub(crate) under: Option<Same<Strokes>>,
    /// The painted scene that this one is a part of, if it is painted and has no looks.
    pub(crate) beside: Option<Same<Beside>>,
}

/// Images and presets, and their weights.
#[derive(Clone, PartialEq)]
pub(crate) enum Styles {
    /// To paint the scene with, on its surface.
    Painted { canvases: Vec<(Same<LaterCanvas>, f64)>, surface: Same<Ground>, decided: Decided },
    /// To be decoded.
    Decoded { styles: Vec<(Same<LaterStatistics>, f64)>, inputs: Arc<LaterInputs> },
    /// None: there are looks alone.
    None,
}

/// The choices of a source beside its paintings.
#[derive(Clone, PartialEq)]
pub(crate) struct Decided {
    pub(crate) is_collection: bool,
    /// Colors in the paintings' stead.
    pub(crate) tints: Option<GivenTints>,
    /// Strength of the palette, 0..1.
    pub(crate) palette: f32,
    /// Direction of strokes, in scene space.
    pub(crate) direction: Option<StrokeDirection>,
    pub(crate) pins: Vec<Pin>,
}

impl Decided {
    /// Direction of strokes, for painting.
    pub(super) fn direction(&self) -> Option<Direction<'_>> {
        self.direction.as_ref().map(StrokeDirection::of_paint)
    }
}

/// Colors in the paintings' stead.
#[derive(Clone, PartialEq)]
pub(crate) enum GivenTints {
    /// Those of an image or a preset.
    Canvas(Same<LaterCanvas>),
    /// These, display-referred.
    Colors(Vec<[f32; 3]>),
}

impl GivenTints {
    pub(super) fn made(&self, work: &Work) -> Result<Tints, Failure> {
        match self {
            Self::Canvas(canvas) => Ok(canvas.0.get(work)?.tints().clone()),
            Self::Colors(colors) => {
                Tints::of_colors(colors).map_err(|error| Failure::Failed(Arc::new(error.into())))
            }
        }
    }
}

/// A canvas that the style makes if it is the first one.
pub(crate) type LaterCanvas = Lazy<Stretched>;

/// Statistics that the style computes if it is the first one.
pub(crate) type LaterStatistics = Lazy<Encoded>;

/// Share of painting that reading the paintings is said to take.
const CANVASES: f32 = 0.1;

/// Share of a style that is decoded on the CPU that encoding its images is said to take.
const ENCODING: f32 = 0.3;

/// A look of a mix.
#[derive(Clone, PartialEq)]
pub(crate) struct WeightedLook {
    /// The asset's path, for messages.
    pub(crate) name: String,
    pub(crate) look: Same<Look>,
    pub(crate) weight: f64,
}

impl WeightedLook {
    fn as_part(&self) -> restyle::WeightedLook<'_> {
        restyle::WeightedLook { name: &self.name, look: &self.look.0, weight: self.weight }
    }
}

/// A shared value, equal to itself alone.
pub(crate) struct Same<T: ?Sized>(pub(crate) Arc<T>);

impl<T: ?Sized> PartialEq for Same<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl<T: ?Sized> Clone for Same<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

/// A computed style.
#[derive(Clone)]
pub(crate) struct StyleResult {
    pub(crate) style: AppliedStyle,
    pub(crate) colors: Arc<StyleColors>,
    /// The strokes without pinned places, for a request that pins others.
    unpinned: Option<Arc<Strokes>>,
}

/// A style, or the reason why there is none. All who want it share the reason.
pub(crate) type Computed = Result<StyleResult, Arc<StyleError>>;

impl StyleRequest {
    /// Starts the computation. `like` is the result of a request that [pins other places](Self::pins_others).
    pub(crate) fn start(self: &Arc<Self>, like: Option<StyleResult>, workers: &Workers) -> Running<Computed> {
        let (request, moves) = (Arc::clone(self), like.is_some());
        let compute = async move |work: Work| settled(request.run(like.as_ref(), &work).await);
        let lane = match self.styles {
            // Mixing looks must not wait for a painting, and neither must moving strokes.
            Styles::None => Lane::Short,
            _ if moves => Lane::Short,
            Styles::Painted { .. } | Styles::Decoded { .. } => Lane::Styles,
        };
        workers.start_async(lane, compute)
    }

    /// Whether the style may have strokes.
    pub(crate) fn has_strokes(&self) -> bool {
        matches!(self.styles, Styles::Painted { .. })
            || self.looks.iter().any(|look| look.look.0.has_strokes())
    }

    /// The paint of the style, which has these `strokes`, for meshes beside the scene. `None` if it is none.
    #[cfg(feature = "meshes")]
    pub(crate) fn brushwork(&self, strokes: Arc<Strokes>) -> Option<Brushwork> {
        let beside = self.to_others(strokes)?;
        let Styles::Painted { canvases, decided, .. } = &self.styles else { return None };
        Some(Brushwork::new(canvases.clone(), decided.clone(), self.content, Some(beside)))
    }

    /// The painted scene, which has these `strokes`, for others beside it. `None` if it is not painted.
    pub(crate) fn to_others(&self, strokes: Arc<Strokes>) -> Option<Beside> {
        let Styles::Painted { surface, .. } = &self.styles else { return None };
        Some(Beside::new(Arc::clone(&surface.0), strokes))
    }

    /// The same style in other colors of its paintings, under the `strokes` that it has, or `None` if `colors`
    /// gives none for any of them.
    #[cfg(feature = "images")]
    pub(crate) fn following(
        &self,
        strokes: Arc<Strokes>,
        colors: &dyn Fn(usize) -> Option<Arc<LaterCanvas>>,
    ) -> Option<Self> {
        let Styles::Painted { canvases, surface, decided } = &self.styles else { return None };
        let present = |(i, (canvas, weight)): (usize, &(Same<LaterCanvas>, f64))| {
            (colors(i).map_or_else(|| canvas.clone(), Same), *weight)
        };
        let present: Vec<_> = canvases.iter().enumerate().map(present).collect();
        (present != *canvases).then(|| Self {
            styles: Styles::Painted { canvases: present, surface: surface.clone(), decided: decided.clone() },
            under: Some(Same(strokes)),
            ..self.clone()
        })
    }

    /// Folds the styles into the decoder, or restyles the scene on the CPU.
    async fn run(&self, like: Option<&StyleResult>, work: &Work) -> Result<StyleResult, Failure> {
        #[cfg(target_family = "wasm")]
        if let Some(result) = self.lay_apart(like, work).await? {
            return Ok(result);
        }
        if let Some(StyleResult { style, unpinned, .. }) = like
            && let AppliedColors::Known { colors, .. } = &style.colors
        {
            return self.shown(Arc::clone(colors), unpinned.clone(), work);
        }
        match &self.styles {
            Styles::Decoded { styles, inputs } if self.backend == StyleBackend::Gpu => {
                self.fold(&made(styles, work)?, inputs, work).await
            }
            _ => self.restyle(work),
        }
    }

    /// The colors and strokes of the scene.
    fn restyle(&self, work: &Work) -> Result<StyleResult, Failure> {
        let scene = &*self.scene.0;
        let looks = self.looks.iter().map(WeightedLook::as_part).collect();
        let content = self.content;
        let painted = match &self.styles {
            Styles::Painted { canvases, surface, decided } => {
                let canvases = made(canvases, &work.part(0.0, CANVASES))?;
                let work = &work.part(CANVASES, 1.0);
                let tints =
                    decided.tints.as_ref().map(|tints| tints.made(&work.part(0.0, 0.0))).transpose()?;
                let paintings = as_parts(&canvases);
                let hand = Hand {
                    is_collection: decided.is_collection,
                    tints: tints.as_ref(),
                    palette: decided.palette,
                    direction: decided.direction(),
                    // Those that only move strokes are honored afterwards.
                    pins: if self.only_moves() { &[] } else { &decided.pins },
                };
                let is_alone = !self.looks.is_empty() || self.under.is_some();
                let company = match self.beside.as_ref().filter(|_| !is_alone) {
                    Some(Same(beside)) => beside.company(&paintings, &hand, work)?,
                    None => None,
                };
                let styles = restyle::Styles::Painted { paintings, surface: &surface.0, hand };
                let recipe = Recipe { looks, styles, content };
                // In given colors, textures are no image's own and cannot follow it: strokes are laid on anew.
                if let Some(Same(under)) = self.under.as_ref().filter(|_| decided.tints.is_none()) {
                    let colors = recipe.recolor(scene, under, work)?;
                    return Ok(self.recolored(colors, under, &canvases));
                }
                recipe.restyle_beside(scene, company, work)
            }
            Styles::Decoded { styles, inputs } => {
                let styles = made(styles, &work.part(0.0, ENCODING))?;
                let work = &work.part(ENCODING, 1.0);
                let styles = styles.iter().map(|(statistics, weight)| (&**statistics, *weight)).collect();
                let styles = restyle::Styles::Decoded { styles, decode: &mut &*inputs.decoder };
                Recipe { looks, styles, content }.restyle(scene, work)
            }
            Styles::None => Recipe { looks, styles: restyle::Styles::None, content }.restyle(scene, work),
        };
        self.painted(painted?, work)
    }

    /// The result of paint.
    fn painted(&self, Painted { colors, strokes, .. }: Painted, work: &Work) -> Result<StyleResult, Failure> {
        self.shown(colors.into(), (!strokes.seeds.is_empty()).then(|| Arc::new(strokes)), work)
    }

    /// The result of these colors and strokes, which are moved to pinned places if they are not there yet.
    fn shown(
        &self,
        colors: Arc<[[f32; 3]]>,
        unpinned: Option<Arc<Strokes>>,
        work: &Work,
    ) -> Result<StyleResult, Failure> {
        let mut strokes = unpinned.clone();
        if let (Styles::Painted { canvases, surface, decided }, true) = (&self.styles, self.only_moves()) {
            let canvases = made(canvases, &work.part(1.0, 1.0))?;
            let paintings = as_parts(&canvases);
            if let Some(strokes) = strokes.as_mut().filter(|_| !decided.pins.is_empty()) {
                let hand = Hand { direction: decided.direction(), pins: &decided.pins, ..Hand::default() };
                pin(Arc::make_mut(strokes), &surface.0, &paintings, &hand)
                    .map_err(|error| Failure::Failed(Arc::new(StyleError::Source(error.to_string()))))?;
            }
        }
        Ok(self.result(colors, strokes, unpinned))
    }

    /// The result of these colors and strokes.
    fn result(
        &self,
        colors: Arc<[[f32; 3]]>,
        strokes: Option<Arc<Strokes>>,
        unpinned: Option<Arc<Strokes>>,
    ) -> StyleResult {
        let shown = StyleColors::known(Arc::clone(&colors), strokes.clone());
        // Kept with the style, so that saving it later costs nothing.
        let colors = AppliedColors::Known { colors, strokes };
        let style = AppliedStyle { scene: Arc::clone(&self.scene.0), colors };
        StyleResult { colors: shown, style, unpinned }
    }

    /// Whether pinned places move strokes and change nothing else. In a collection, they choose paintings, and
    /// beside looks, strokes are mixed.
    fn only_moves(&self) -> bool {
        self.looks.is_empty()
            && matches!(&self.styles, Styles::Painted { decided, .. } if !decided.is_collection)
    }

    /// Whether another request differs in pinned places alone, and these only move strokes.
    pub(crate) fn pins_others(&self, other: &Self) -> bool {
        // Strokes of images that changed stay as they are.
        self.only_moves() && self.under.is_none() && self.without_pins() == other.without_pins()
    }

    /// The request without pinned places.
    fn without_pins(&self) -> Self {
        let mut without = self.clone();
        if let Styles::Painted { decided, .. } = &mut without.styles {
            decided.pins.clear();
        }
        without
    }

    /// The style in these colors under strokes that stay. Their textures on the GPU follow the images, and
    /// those of the style that can be saved are of the paintings that gave the colors.
    fn recolored(
        &self,
        colors: Vec<[f32; 3]>,
        under: &Arc<Strokes>,
        canvases: &[(Arc<Painting>, f64)],
    ) -> StyleResult {
        let colors: Arc<[_]> = colors.into();
        let shown = StyleColors::known(Arc::clone(&colors), Some(Arc::clone(under)));
        let mut strokes = Strokes::clone(under);
        for texture in &mut strokes.textures {
            if let Some((canvas, _)) = canvases.iter().find(|(canvas, _)| canvas.follows(texture)) {
                *texture = Arc::clone(canvas.texture());
            }
        }
        let colors = AppliedColors::Known { colors, strokes: Some(Arc::new(strokes)) };
        let style = AppliedStyle { scene: Arc::clone(&self.scene.0), colors };
        StyleResult { colors: shown, style, unpinned: None }
    }

    /// The weights from which the GPU decodes the styles.
    async fn fold(
        &self,
        styles: &[(Arc<stylegaussian::ChannelStatistics>, f64)],
        inputs: &LaterInputs,
        work: &Work,
    ) -> Result<StyleResult, Failure> {
        let scene = Arc::clone(&self.scene.0);
        if scene.features.is_none() {
            return Err(StylizeError::NoFeatures.into());
        }
        // Packed here: the render thread only uploads.
        let (inputs, decoder) = (Arc::clone(inputs.packed(work).await?), &inputs.decoder);
        // The content's statistics are part of the inputs, so a further style of a scene does not pass over its
        // N features.
        let styles: Vec<_> = styles.iter().map(|(style, weight)| (&**style, *weight)).collect();
        let map = inputs.content().transfer(&styles, self.content)?;
        let layers = FoldedLayers::new(inputs.content(), decoder, &map)?;
        let colors = AppliedColors::Decoded { decoder: Arc::clone(decoder), map: Arc::new(map) };
        let folded = ColorSource::Folded(Box::new(FoldedStyle { inputs, layers }));
        let folded = StyleColors::new(folded, scene.len());
        Ok(StyleResult { style: AppliedStyle { scene, colors }, colors: folded, unpinned: None })
    }
}

/// Paintings and their weights, as a recipe takes them.
pub(super) fn as_parts(paintings: &[(Arc<Painting>, f64)]) -> Vec<(&Canvas, f64)> {
    let mut parts: Vec<(&Canvas, f64)> = Vec::new();
    for (painting, weight) in paintings {
        parts.push((painting, *weight));
    }
    parts
}

/// Values that are made later, made now, with their weights.
pub(super) fn made<T: Clone>(later: &[(Same<Lazy<T>>, f64)], work: &Work) -> Result<Vec<(T, f64)>, Failure> {
    let n = later.len().max(1) as f32;
    let mut made = Vec::new();
    for (i, (later, weight)) in later.iter().enumerate() {
        made.push((later.0.get(&work.part(i as f32 / n, (i + 1) as f32 / n))?, *weight));
    }
    work.at(1.0)?;
    Ok(made)
}

impl From<RestyleError> for Failure {
    fn from(error: RestyleError) -> Self {
        let error = match error {
            RestyleError::Stylize(error) => error.into(),
            RestyleError::Look { name, source } => StyleError::Look { look: name, source },
            RestyleError::Decode(error) => match error.downcast::<StylizeError>() {
                Ok(error) => StyleError::Stylize(*error),
                Err(error) => StyleError::Decode(error.to_string()),
            },
            error @ (RestyleError::Palette { .. }
            | RestyleError::Direction { .. }
            | RestyleError::Paintings { .. }
            | RestyleError::Pin(_)) => StyleError::Source(error.to_string()),
            RestyleError::Canceled(Canceled) => return Self::Canceled,
        };
        Self::Failed(Arc::new(error))
    }
}

impl From<StylizeError> for Failure {
    fn from(error: StylizeError) -> Self {
        Self::Failed(Arc::new(error.into()))
    }
}
