//! The styles that an entity wears on a scene, one over another while they change.
//!
//! A transition that is interrupted stays below the next one and continues. If more than four styles are worn,
//! those below the newest are mixed once and frozen.

use std::{sync::Arc, time::Duration};

use stylegaussian::layers::Region;

use crate::{
    colors::{ColorLayer, LayerColors, Mix, StyleColors},
    style::show::{
        place::Place,
        transition::{StyleTransition, TransitionClock, TransitionShape},
    },
};

/// The most styles on one another. A change beyond it freezes the ones below.
const MAX_WORN: usize = 4;

/// The styles of an entity on a scene, the lowest first. Empty for the captured colors, which nobody asked for.
#[derive(Default)]
pub(crate) struct Worn(Vec<WornStyle>);

/// A style, and the way that it has come.
struct WornStyle {
    colors: LayerColors,
    /// The transition and its time so far, or `None` if it is over.
    coming: Option<(StyleTransition, Duration)>,
}

/// Time since the last frame.
#[derive(Clone, Copy)]
pub(crate) struct Passed {
    pub(crate) real: Duration,
    pub(crate) game: Duration,
}

impl Worn {
    /// Whether nothing was ever put on, or all of it is off again.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether a style lies over everything else, or comes over it.
    pub(crate) fn is_topped_by(&self, colors: &Arc<StyleColors>) -> bool {
        let top = self.0.last().map(|worn| &worn.colors);
        matches!(top, Some(LayerColors::Style(top)) if Arc::ptr_eq(top, colors))
    }

    /// Whether a style is coming in. One that comes by the game's clock does not while that is paused.
    pub(crate) fn is_changing(&self, is_game_paused: bool) -> bool {
        self.0.iter().filter_map(|worn| worn.coming.as_ref()).any(|(transition, _)| match transition.clock {
            TransitionClock::Real => true,
            TransitionClock::Virtual => !is_game_paused,
        })
    }

    /// The colors of the style over everything else, or captured ones if there is none.
    pub(crate) fn top(&self) -> LayerColors {
        self.0.last().map_or(LayerColors::Captured, |worn| worn.colors.clone())
    }

    /// Puts a style over the others.
    pub(crate) fn put_on(&mut self, colors: LayerColors, transition: Option<&StyleTransition>) {
        let coming = transition.filter(|transition| !transition.duration.is_zero());
        if coming.is_none() {
            self.0.clear();
        }
        self.0.push(WornStyle {
            colors,
            coming: coming.map(|transition| (transition.clone(), Duration::ZERO)),
        });
    }

    /// Advances transitions, and removes fully covered styles. If `is_own`, captured colors are those below.
    pub(crate) fn advance(&mut self, passed: Passed, is_own: bool) {
        for worn in &mut self.0 {
            if let Some((transition, elapsed)) = &mut worn.coming {
                let delta = match transition.clock {
                    TransitionClock::Real => passed.real,
                    TransitionClock::Virtual => passed.game,
                };
                *elapsed = elapsed.saturating_add(delta);
                if *elapsed >= transition.duration {
                    worn.coming = None;
                }
            }
        }
        if let Some(top) = self.0.iter().rposition(|worn| worn.coming.is_none()) {
            self.0.drain(..top);
        }
        if is_own && matches!(self.0.as_slice(), [WornStyle { colors: LayerColors::Captured, coming: None }])
        {
            self.0.clear();
        }
    }

    /// The styles as layers of a scene. More than a few are frozen as they are now.
    pub(crate) fn layers(&mut self, place: &Place) -> Vec<ColorLayer> {
        let mut layers: Vec<_> = self.0.iter().map(|worn| worn.layer(Some(place))).collect();
        if self.0.len() > MAX_WORN {
            let last = layers.pop();
            let frozen = LayerColors::Mix(Mix::new(std::mem::take(&mut layers)));
            layers.push(ColorLayer::everywhere(frozen.clone(), 1.0));
            layers.extend(last);
            let top = self.0.pop();
            self.0.clear();
            self.0.push(WornStyle { colors: frozen, coming: None });
            self.0.extend(top);
        }
        layers
    }

    /// The styles as one layer in a volume's region and channel of a mask, or `None` if there is none. The
    /// first style fades in, whatever shape its transition has; those that come over it come in their shapes,
    /// as on the cloud at `place`.
    pub(crate) fn volume_layer(
        &mut self,
        place: &Place,
        region: Region,
        strength: f32,
        mask: Option<u32>,
    ) -> Option<ColorLayer> {
        if self.0.len() > MAX_WORN {
            // A volume's layers are of several places, so they cannot be frozen in one of them.
            self.0.remove(0);
            self.0[0].coming = None;
        }
        let layer = |colors: LayerColors, share: f32| ColorLayer {
            region,
            mask,
            ..ColorLayer::everywhere(colors, strength * share)
        };
        match self.0.as_slice() {
            [] => None,
            [only] => Some(layer(only.colors.clone(), only.layer(None).strength)),
            _ => {
                // Before the first one has come, the volume is as strong as its strongest style.
                let share = self.0.iter().map(|worn| worn.layer(None).strength).fold(0.0, f32::max);
                let mut mixed: Vec<_> = self.0.iter().map(|worn| worn.layer(Some(place))).collect();
                mixed[0] = ColorLayer::everywhere(mixed[0].colors.clone(), 1.0);
                Some(layer(LayerColors::Mix(Mix::new(mixed)), share))
            }
        }
    }
}

impl WornStyle {
    /// The style as a layer. Without a place, its transition is a fade.
    fn layer(&self, place: Option<&Place>) -> ColorLayer {
        let colors = self.colors.clone();
        let Some((transition, elapsed)) = &self.coming else { return ColorLayer::everywhere(colors, 1.0) };
        let progress = transition.progress(*elapsed);
        match place {
            Some(place) if transition.shape != TransitionShape::Fade => {
                let (region, strength) = transition.reached(progress, place);
                ColorLayer { region, ..ColorLayer::everywhere(colors, strength) }
            }
            _ => ColorLayer::everywhere(colors, progress),
        }
    }
}
