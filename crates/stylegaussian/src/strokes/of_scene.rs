//! All strokes of a scene.

use std::sync::Arc;

use super::{seed::StrokeSeed, texture::StrokeTexture};

/// Strokes of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Strokes {
    /// The seeds `[M]`, at most [`MAX_SEEDS`](super::MAX_SEEDS).
    pub seeds: Vec<StrokeSeed>,
    /// The strokes of each Gaussian `[N]`: see [`StrokeWord`](super::StrokeWord).
    pub words: Vec<u32>,
    /// Textures that seeds name by their position, at most [`MAX_TEXTURES`](super::MAX_TEXTURES).
    pub textures: Vec<Arc<StrokeTexture>>,
}
