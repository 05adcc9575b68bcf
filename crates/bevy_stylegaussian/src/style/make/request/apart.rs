//! Paint that the browser's worker lays on.

use std::sync::Arc;

use stylegaussian::{
    apart::{self, ApartError, Call, Choices, Laying, TintsOf},
    paint::Painted,
    restyle::{self, Recipe},
    work::Work,
};

use super::{Decided, Failure, GivenTints, Same, StyleRequest, StyleResult, Styles, WeightedLook, made};
use crate::{
    style::{
        make::worker::{Ground, Painting},
        wish::{applied::AppliedColors, error::StyleError},
    },
    work::browser::{self, Fail},
};

/// A painted style.
struct Wanted<'a> {
    paintings: &'a [(Arc<Painting>, f64)],
    ground: &'a Ground,
    /// The painted scene that it is a part of.
    beside: Option<&'a Ground>,
    decided: &'a Decided,
    /// The painting in whose colors it is.
    tints: Option<Arc<Painting>>,
    work: &'a Work,
}

impl StyleRequest {
    /// The style as the worker lays it on, or `Ok(None)` if the page's thread has to.
    pub(super) async fn lay_apart(
        &self,
        like: Option<&StyleResult>,
        work: &Work,
    ) -> Result<Option<StyleResult>, Failure> {
        let Styles::Painted { canvases, surface, decided } = &self.styles else { return Ok(None) };
        if self.under.is_some() {
            return Ok(None);
        }
        // The worker tells how far it is.
        let paintings = made(canvases, &work.part(0.0, 0.0))?;
        let tints = match &decided.tints {
            Some(GivenTints::Canvas(canvas)) => Some(canvas.0.get(&work.part(0.0, 0.0))?),
            Some(GivenTints::Colors(_)) | None => None,
        };
        let mut all = paintings.iter().map(|(painting, _)| painting).chain(&tints);
        // Strokes that are to follow an image must know its canvas.
        if surface.0.is_here() || all.any(|painting| painting.is_here()) {
            return Ok(None);
        }
        let beside = self.beside.as_ref().filter(|_| self.looks.is_empty());
        let beside = beside.map(|Same(beside)| &*beside.surface);
        if beside.is_some_and(Ground::is_here) {
            return Ok(None);
        }
        let wanted = Wanted { paintings: &paintings, ground: &surface.0, beside, decided, tints, work };
        loop {
            match self.laid(like, &wanted).await {
                Ok(result) => return Ok(Some(result?)),
                Err(Fail::Replaced) => {}
                Err(Fail::Absent) => return Ok(None),
                Err(Fail::Canceled) => return Err(Failure::Canceled),
                Err(Fail::Said(reason)) => {
                    return Err(Failure::Failed(Arc::new(StyleError::Source(reason))));
                }
            }
        }
    }

    async fn laid(
        &self,
        like: Option<&StyleResult>,
        wanted: &Wanted<'_>,
    ) -> Result<Result<StyleResult, Failure>, Fail> {
        let surface = wanted.ground.number().await?;
        let beside = match wanted.beside {
            Some(beside) => Some(beside.number().await?),
            None => None,
        };
        let mut numbers = Vec::new();
        for (painting, weight) in wanted.paintings {
            numbers.push((painting.number().await?, *weight));
        }
        let tints = match (&wanted.tints, &wanted.decided.tints) {
            (Some(painting), _) => Some(TintsOf::Canvas(painting.number().await?)),
            (None, Some(GivenTints::Colors(colors))) => Some(TintsOf::Colors(colors)),
            (None, _) => None,
        };
        let Decided { is_collection, palette, ref pins, .. } = *wanted.decided;
        let hand = Choices { is_collection, tints, palette, direction: wanted.decided.direction(), pins };
        let pinned = Laying { surface, whole: beside, paintings: &numbers, hand, content: self.content };
        let known = like.and_then(|like| match &like.style.colors {
            AppliedColors::Known { colors, .. } => Some((Arc::clone(colors), like.unpinned.clone())),
            AppliedColors::Decoded { .. } => None,
        });
        let (colors, unpinned) = match known {
            Some(known) => known,
            None => {
                let mut laying = pinned;
                if self.only_moves() {
                    laying.hand.pins = &[];
                }
                let mut painted = self.painted_apart(wanted, &Call::Lay(laying)).await?;
                // The answer has textures of its own. Each would take one of the few places on the GPU.
                let known = self.beside.iter().flat_map(|Same(beside)| &beside.strokes.textures);
                for texture in &mut painted.strokes.textures {
                    if let Some(known) = known.clone().find(|known| **known == *texture) {
                        *texture = Arc::clone(known);
                    }
                }
                let looks = self.looks.iter().map(WeightedLook::as_part).collect();
                let weight = numbers.iter().map(|(_, weight)| weight).sum();
                let styles = restyle::Styles::Laid { painted, weight };
                let recipe = Recipe { looks, styles, content: self.content };
                match recipe.restyle(&self.scene.0, wanted.work) {
                    Ok(Painted { colors, strokes, .. }) => {
                        (colors.into(), (!strokes.seeds.is_empty()).then(|| Arc::new(strokes)))
                    }
                    Err(error) => return Ok(Err(error.into())),
                }
            }
        };
        let mut strokes = unpinned.clone();
        if let Some(strokes) = strokes.as_mut().filter(|_| self.only_moves() && !pins.is_empty()) {
            let call = Call::Pin(pinned, &strokes.seeds);
            let answer = browser::call(&call.pieces(), wanted.work, false).await?;
            let seeds = apart::pinned_seeds(&answer, strokes.seeds.len()).map_err(said)?;
            Arc::make_mut(strokes).seeds = seeds;
        }
        Ok(Ok(self.result(colors, strokes, unpinned)))
    }

    /// The answer to a call that lays on paint.
    async fn painted_apart(&self, wanted: &Wanted<'_>, call: &Call<'_>) -> Result<Painted, Fail> {
        let answer = browser::call(&call.pieces(), wanted.work, false).await?;
        let painted = Painted::from_bytes(&answer).map_err(said)?;
        let (found, expected) = (painted.colors.len(), self.scene.0.len());
        if found != expected {
            return Err(Fail::Said(format!("found {found} painted colors, expected {expected}")));
        }
        Ok(painted)
    }
}

fn said(error: ApartError) -> Fail {
    Fail::Said(error.to_string())
}
