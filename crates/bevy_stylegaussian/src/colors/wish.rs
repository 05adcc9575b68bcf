//! The colors that an entity should have, and the render world's answer.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian_gpu::style::{FoldedLayers, StyleInputs};

/// The colors that an entity's splats should have. Entities without it have the captured colors.
#[derive(Component, Clone, Default)]
pub(crate) struct ColorWish {
    /// Number of changes so far. It tells an outdated answer of the render world from a current one.
    pub(crate) generation: u64,
    pub(crate) source: ColorSource,
}

/// The source of colors.
#[derive(Clone, Default)]
pub(crate) enum ColorSource {
    /// The scene's view-dependent colors.
    #[default]
    Captured,
    /// Colors that were computed on the CPU `[N]`.
    Rgb(Arc<[[f32; 3]]>),
    /// A style that the style pass has to decode.
    Folded(Arc<FoldedStyle>),
}

/// A style folded into the decoder's weights, ready for the GPU.
pub(crate) struct FoldedStyle {
    /// The scene's part.
    pub(crate) inputs: Arc<StyleInputs>,
    /// The style's part.
    pub(crate) layers: FoldedLayers,
}

impl ColorWish {
    pub(crate) fn set(&mut self, source: ColorSource) {
        self.generation += 1;
        self.source = source;
    }
}

/// The render world's answer to a wish that it cannot fulfil at once.
pub(crate) struct ColorReport {
    pub(crate) entity: Entity,
    /// The generation of the wish.
    pub(crate) generation: u64,
    /// Ok if the colors are drawn from this frame on, otherwise the reason why the GPU cannot show them.
    pub(crate) result: Result<(), String>,
}
