//! All strokes of a scene.

use std::sync::Arc;

use super::{
    seed::{StrokeSeed, StrokeWord},
    texture::StrokeTexture,
};

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

impl Strokes {
    /// The strokes of the Gaussians at `indices`, in that order, with the seeds that they use. All textures
    /// stay. Words whose seed is not there get no strokes.
    ///
    /// # Panics
    /// If an index is not below N.
    #[must_use]
    pub fn subset(&self, indices: &[u32]) -> Self {
        let mut new_from_old = vec![None; self.seeds.len()];
        let mut seeds = Vec::new();
        let moved = |&i: &u32| {
            let word = StrokeWord::unpacked(self.words[i as usize]);
            let old = word.seed as usize;
            let Some(seed) = self.seeds.get(old) else { return StrokeWord::NONE.packed() };
            let new = *new_from_old[old].get_or_insert_with(|| {
                seeds.push(*seed);
                seeds.len() as u32 - 1
            });
            StrokeWord { seed: new, ..word }.packed()
        };
        let words = indices.iter().map(moved).collect();
        Self { seeds, words, textures: self.textures.clone() }
    }
}
