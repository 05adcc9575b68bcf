//! Strokes as `--stroke-scale`, `--paint-amount` and `--protection` want them.

use clap::Args;
use stylegaussian::strokes::{MAX_GAIN, PlainSeed, StrokeKnobs, StrokeWord, Strokes};

use crate::arguments::{FACTORS, within};

/// Options of strokes.
#[derive(Args, Debug)]
pub struct StrokeArgs {
    /// Size of the strokes, as a factor. 1: as in the painting, if the scene is seen at 512 pixels.
    // Beyond a hundred, one stroke covers a scene, or none is seen.
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = within(0.01_f32..=100.0))]
    stroke_scale: f32,
    /// Strength of the strokes, as a factor: 0 leaves the colors under them.
    #[arg(
        long,
        value_name = "FACTOR",
        default_value = "1",
        allow_negative_numbers = true,
        value_parser = within(FACTORS),
    )]
    paint_amount: f32,
    /// How much of what stands out keeps its own detail, as a factor: below 1, more of it is painted.
    #[arg(
        long,
        value_name = "FACTOR",
        default_value = "1",
        allow_negative_numbers = true,
        value_parser = within(FACTORS),
    )]
    protection: f32,
}

impl StrokeArgs {
    /// Changes `strokes` so that they are drawn with these options by whoever draws them, and stored with them.
    pub fn apply(&self, strokes: &mut Strokes) {
        let knobs = StrokeKnobs {
            amount: self.paint_amount,
            protection: self.protection,
            stroke_scale: self.stroke_scale,
            ..StrokeKnobs::DEFAULT
        };
        // Seeds are rounded when they are packed.
        if knobs != StrokeKnobs::DEFAULT {
            fix(strokes, &knobs);
        }
    }
}

/// Applies `knobs` to the strokes themselves.
fn fix(strokes: &mut Strokes, knobs: &StrokeKnobs) {
    for seed in &mut strokes.seeds {
        let plain = seed.plain();
        let gain = |gain: f32| (knobs.amount * gain).min(MAX_GAIN);
        let (fine, wide) = (gain(plain.fine), gain(plain.wide));
        let changed = PlainSeed { fine, wide, pitch: plain.pitch / knobs.stroke_scale, ..plain };
        *seed = changed.packed().with_direction(seed.direction());
    }
    for word in &mut strokes.words {
        let of = StrokeWord::unpacked(*word);
        *word = StrokeWord { protection: of.protection_by(knobs.protection), ..of }.packed();
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;

    #[test]
    fn options_become_a_part_of_the_strokes() {
        let seed = PlainSeed {
            at: Vec3::ONE,
            right: Vec3::X,
            down: Vec3::Y,
            pitch: Vec2::new(100.0, 50.0),
            place: Vec2::new(32.0, 64.0),
            fine: 0.8,
            wide: 1.6,
            texture: 3,
        };
        let word = StrokeWord { seed: 0, protection: 0.5, share: 1.0 };
        let before = Strokes { seeds: vec![seed.packed()], words: vec![word.packed()], textures: Vec::new() };
        let with = |stroke_scale: f32, paint_amount: f32, protection: f32| {
            let mut strokes = before.clone();
            StrokeArgs { stroke_scale, paint_amount, protection }.apply(&mut strokes);
            (strokes.seeds[0].plain(), StrokeWord::unpacked(strokes.words[0]))
        };
        assert_eq!(with(1.0, 1.0, 1.0).0, before.seeds[0].plain());
        let (seed, word) = with(2.0, 0.5, 2.0);
        assert_eq!((seed.pitch, seed.texture), (Vec2::new(50.0, 25.0), 3));
        assert!((seed.fine - 0.4).abs() < 0.01 && (seed.wide - 0.8).abs() < 0.01);
        // By twice as much: q^2 = 4, p = 4 / 5.
        assert!((word.protection - 0.8).abs() < 0.01 && word.share == 1.0);
        assert_eq!(with(1.0, 2.0, 1.0).0.wide, MAX_GAIN);
        assert_eq!(with(1.0, 0.0, 1.0).0.fine, 0.0);
    }
}
