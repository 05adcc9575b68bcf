//! Strokes under layers of looks.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    factors::StrokeFactors,
    of_scene::Strokes,
    seed::{MAX_SEEDS, MAX_TEXTURES, StrokeSeed, StrokeWord},
};
use crate::layers::Region;

/// Range of shares within which a stroke goes and another one comes.
pub const EDGE: f32 = 0.1;

/// Strokes in a region.
#[derive(Clone, Copy, Debug)]
pub struct StrokeLayer<'a> {
    /// One word per Gaussian `[N]`, or `None` for a look without strokes.
    pub words: Option<&'a [u32]>,
    /// Number of the layer's first seed in the table that all layers share; of changes, what is added to the
    /// numbers of changed seeds, or 0 if seeds stay as they are.
    pub first_seed: u32,
    /// The part of the scene that gets them.
    pub region: Region,
    /// Opacity within the region, 0..1.
    pub strength: f32,
    /// Painted weights and the channel of them that counts here; `None` if all of the region counts.
    pub mask: Option<(&'a [[u8; 4]], usize)>,
    /// Changes of the strokes below, in place of strokes of its own; else `None`.
    pub factors: Option<StrokeFactors>,
}

/// The strokes of a Gaussian if a share of those `below` is replaced by those `above`.
///
/// A mean of two strokes is no stroke, so each spot shows those of one painting: spots change one after another
/// while the share grows, each through nothing. Half of a scene in either painting shows half of its spots in
/// either. If only one of the two has strokes, they fade.
pub fn mixed(below: StrokeWord, above: StrokeWord, share: f32) -> StrokeWord {
    mixed_by(above.seed, below, above, share)
}

/// As [`mixed`], where `number` decides when the spot changes.
fn mixed_by(number: u32, below: StrokeWord, above: StrokeWord, share: f32) -> StrokeWord {
    if above.share <= 0.0 {
        return StrokeWord { share: below.share * (1.0 - share), ..below };
    }
    if below.share <= 0.0 {
        return StrokeWord { share: above.share * share, ..above };
    }
    if below.seed == above.seed {
        return StrokeWord { share: below.share + share * (above.share - below.share), ..above };
    }
    // Multiples of the golden ratio: numbers that follow one another are far apart in 0..1, and any part of it
    // has its share.
    let random = (number.wrapping_mul(2_654_435_769) >> 8) as f32 / 16_777_216.0;
    let turn = EDGE + (1.0 - 2.0 * EDGE) * random;
    let open = ((share - turn).abs() / EDGE).min(1.0);
    let shown = if share > turn { above } else { below };
    StrokeWord { share: shown.share * open, ..shown }
}

impl Strokes {
    /// Replaces a share of the strokes by those of `above`, Gaussian by Gaussian: see [`mixed`]. Seeds without
    /// words are no strokes, so with [`Strokes::default`] above, the strokes fade.
    ///
    /// Strokes that a table has no room for beside these ([`MAX_SEEDS`], [`MAX_TEXTURES`]) are left out, and
    /// these fade.
    ///
    /// # Panics
    /// If both have words, and not as many.
    pub fn mix(&mut self, above: &Self, share: f32) {
        if self.words.is_empty() {
            self.words = vec![StrokeWord::NONE.packed(); above.words.len()];
        }
        assert!(above.words.is_empty() || above.words.len() == self.words.len(), "one word per Gaussian");
        let first_seed = self.seeds.len() as u32;
        if self.seeds.len() + above.seeds.len() <= MAX_SEEDS
            && self.textures.len() + above.textures.len() <= MAX_TEXTURES
            && !above.words.is_empty()
        {
            self.mix_by(above, share, |seed| seed + first_seed);
        } else {
            self.fade(1.0 - share);
        }
    }

    /// As [`mix`](Self::mix), whatever room a table has. The `number` of each of the seeds above decides when
    /// its spots change.
    pub(crate) fn mix_by(&mut self, above: &Self, share: f32, number: impl Fn(u32) -> u32) {
        let (first_seed, first_texture) = (self.seeds.len() as u32, self.textures.len());
        for (word, above) in self.words.iter_mut().zip(&above.words) {
            let above = StrokeWord::unpacked(*above);
            let number = number(above.seed);
            let above = StrokeWord { seed: above.seed + first_seed, ..above };
            *word = mixed_by(number, StrokeWord::unpacked(*word), above, share).packed();
        }
        let with_texture =
            |seed: &StrokeSeed| seed.with_texture((usize::from(seed.plain().texture) + first_texture) as u8);
        self.seeds.extend(above.seeds.iter().map(with_texture));
        self.textures.extend_from_slice(&above.textures);
    }

    /// Multiplies the share of strokes that are shown.
    pub fn fade(&mut self, share: f32) {
        for word in &mut self.words {
            let of = StrokeWord::unpacked(*word);
            *word = StrokeWord { share: share * of.share, ..of }.packed();
        }
    }
}

/// The words of N Gaussians under `layers`, from nothing up `[N]`. The kernel is `mix_strokes`.
///
/// # Panics
/// If words or a mask do not have one entry per mean.
pub fn mix_strokes(means: &[Vec3], layers: &[StrokeLayer]) -> Vec<u32> {
    for layer in layers {
        assert!(layer.words.is_none_or(|words| words.len() == means.len()), "one word per Gaussian");
        assert!(layer.mask.is_none_or(|(mask, _)| mask.len() == means.len()), "one weight per Gaussian");
    }
    let of_gaussian = |(i, &mean): (usize, &Vec3)| {
        let sum = layers.iter().fold(StrokeWord::NONE, |below, layer| {
            let painted = layer.mask.map_or(1.0, |(mask, channel)| f32::from(mask[i][channel]) / 255.0);
            let share = layer.strength * painted * layer.region.weight(mean);
            if let Some(factors) = layer.factors {
                return factors.usual().word(below, share, layer.first_seed);
            }
            let above = layer.words.map_or(StrokeWord::NONE, |words| StrokeWord::unpacked(words[i]));
            let above = StrokeWord { seed: above.seed + layer.first_seed, ..above };
            mixed(below, above, share)
        });
        sum.packed()
    };
    means.par_iter().enumerate().map(of_gaussian).collect()
}
