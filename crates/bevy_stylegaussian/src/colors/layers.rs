//! The colors that an entity should have: layers of styles.

use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicU64, Ordering},
};

use bevy::prelude::*;
use stylegaussian::{
    layers::Region,
    strokes::{StrokeFactors, StrokeKnobs, StrokeMotion},
};

use super::styles::StyleColors;

/// The colors that an entity's splats should have. Without layers, they are the captured ones.
#[derive(Component, Clone, Default)]
pub(crate) struct ColorLayers {
    /// Number of changes so far.
    pub(crate) generation: u64,
    /// The layers, the lowest first.
    pub(crate) layers: Vec<ColorLayer>,
    /// How the strokes of all layers are drawn. A change of them is no new generation.
    pub(crate) knobs: StrokeKnobs,
    /// Whether the entity is not drawn.
    pub(crate) is_hidden: bool,
    /// The first generation of the present scene.
    pub(super) first: u64,
    /// Whether the event of the present scene was sent.
    pub(super) is_announced: bool,
    /// Latest generation that the render world is ready to draw.
    drawn: Arc<AtomicU64>,
}

/// Colors in a region of the scene, or a change of the strokes there.
#[derive(Clone)]
pub(crate) struct ColorLayer {
    pub(crate) colors: LayerColors,
    pub(crate) region: Region,
    /// Share of the colors below that is replaced within the region, 0..1.
    pub(crate) strength: f32,
    /// The channel of the entity's mask that counts, or `None` if all of the region does.
    pub(crate) mask: Option<u32>,
    /// The way in which its strokes move, those of mixes in it too.
    pub(crate) motion: StrokeMotion,
    /// Changes of the strokes below, in place of colors; else `None`.
    pub(crate) factors: Option<StrokeFactors>,
}

/// The colors of a layer.
#[derive(Clone)]
pub(crate) enum LayerColors {
    /// The scene's view-dependent colors.
    Captured,
    /// Colors of a style.
    Style(Arc<StyleColors>),
    /// Layers that are mixed by themselves.
    Mix(Arc<Mix>),
}

/// Layers that are mixed once, into colors of their own.
// They are taken out when they are mixed. A look that is interrupted again and again would otherwise keep all
// that was ever shown alive.
pub(crate) struct Mix(Mutex<Vec<ColorLayer>>);

impl ColorLayers {
    /// Sets the layers, if they differ from the present ones.
    pub(crate) fn set(layers: &mut Mut<Self>, new: Vec<ColorLayer>, knobs: StrokeKnobs, is_hidden: bool) {
        // Compared before it is borrowed mutably, which counts as a change.
        if layers.knobs != knobs {
            layers.knobs = knobs;
        }
        if layers.layers != new || layers.is_hidden != is_hidden {
            layers.generation += 1;
            layers.layers = new;
            layers.is_hidden = is_hidden;
        }
    }

    /// Whether any strokes move.
    pub(super) fn are_moving(&self) -> bool {
        let moves = |layer: &ColorLayer| {
            let by_change = layer.factors.and_then(|factors| factors.motion);
            !layer.motion.is_still() || by_change.is_some_and(|motion| !motion.is_still())
        };
        self.layers.iter().any(moves)
    }

    /// Makes the layers count as changed: they are of another scene.
    pub(super) fn renew(&mut self) {
        self.generation += 1;
        self.first = self.generation;
        self.is_announced = false;
    }

    /// Whether the colors of `generation`, or later ones, are drawn.
    pub(crate) fn is_drawn(&self, generation: u64) -> bool {
        self.drawn.load(Ordering::Relaxed) >= generation
    }

    /// Notes that the present generation is drawn.
    pub(crate) fn mark_drawn(&self) {
        self.drawn.store(self.generation, Ordering::Relaxed);
    }
}

impl ColorLayer {
    /// A layer over all of the scene.
    pub(crate) fn everywhere(colors: LayerColors, strength: f32) -> Self {
        let (region, motion) = (Region::EVERYWHERE, StrokeMotion::Still);
        Self { colors, region, strength, mask: None, motion, factors: None }
    }

    /// A change of the strokes below, over all of the scene.
    pub(crate) fn change(factors: StrokeFactors) -> Self {
        Self { factors: Some(factors), ..Self::everywhere(LayerColors::Captured, 1.0) }
    }

    /// Whether nothing of the colors below is left.
    pub(crate) fn covers_all(&self) -> bool {
        let is_whole = self.region == Region::EVERYWHERE && self.mask.is_none();
        is_whole && self.strength >= 1.0 && self.factors.is_none()
    }
}

impl PartialEq for ColorLayer {
    fn eq(&self, other: &Self) -> bool {
        let same_colors = match (&self.colors, &other.colors) {
            (LayerColors::Captured, LayerColors::Captured) => true,
            (LayerColors::Style(a), LayerColors::Style(b)) => Arc::ptr_eq(a, b),
            (LayerColors::Mix(a), LayerColors::Mix(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        same_colors
            && self.region == other.region
            && self.strength == other.strength
            && self.mask == other.mask
            && self.motion == other.motion
            && self.factors == other.factors
    }
}

impl Mix {
    pub(crate) fn new(layers: Vec<ColorLayer>) -> Arc<Self> {
        Arc::new(Self(Mutex::new(layers)))
    }

    /// The layers.
    pub(super) fn layers(&self) -> Vec<ColorLayer> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Forgets the layers, since they are mixed.
    pub(super) fn forget_layers(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}
