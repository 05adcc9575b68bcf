//! Changes of strokes in a part of a scene, whatever their style.
//!
//! Words carry the amount up to 1 and protection, Gaussian by Gaussian, so these follow a soft edge or a
//! painted weight smoothly. All else is of seeds: a changed stroke has the number of its seed and a number that
//! all of its change have added, which the kernel `splat_strokes` takes away again. Spots change one after
//! another there, as between two paintings ([`mixed`]).

use glam::{Vec2, Vec3};

use super::{
    curve::StrokeCurve,
    mix::mixed,
    motion::StrokeMotion,
    seed::{PlainSeed, StrokeSeed, StrokeWord},
};

/// Least length of a unit direction's part in a surface that strokes follow. Within 17 degrees of the normal,
/// noise decides it.
pub const IN_PLANE: f32 = 0.3;

/// Changes of the strokes in a part of a scene. Factors multiply those of all strokes ([`StrokeKnobs`]), and
/// those of changes below.
///
/// [`StrokeKnobs`]: super::StrokeKnobs
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeFactors {
    /// Factor of all gains, 0 to 10.
    pub amount: f32,
    /// Factor of protection, 0 to 10.
    pub protection: f32,
    /// Factor of the size of strokes, 0.1 to 10. It is 1 in views of strokes that keep their size on screen.
    pub stroke_scale: f32,
    /// Factor of the thickness of paint, 0 to 10.
    pub relief: f32,
    /// Thickness that is added to that of the paint below, 0 to 4, as [`StrokeKnobs::relief`] has it: paint
    /// without any has some then.
    ///
    /// [`StrokeKnobs::relief`]: super::StrokeKnobs::relief
    pub added_relief: f32,
    /// Direction of strokes in scene space, of any length above 0; `None` for their own. Each spot's paint is
    /// turned about the middle of the spot, by less than a right angle.
    pub direction: Option<Vec3>,
    /// A curve in scene space that strokes run along in place of a direction.
    pub curve: Option<StrokeCurve>,
    /// The way in which strokes move; `None` for their own.
    pub motion: Option<StrokeMotion>,
}

impl StrokeFactors {
    /// No change.
    pub const NONE: Self = Self {
        amount: 1.0,
        protection: 1.0,
        stroke_scale: 1.0,
        relief: 1.0,
        added_relief: 0.0,
        direction: None,
        curve: None,
        motion: None,
    };

    /// The changes within their ranges. What is no number changes nothing, and a direction is a unit vector.
    #[must_use]
    pub fn usual(self) -> Self {
        let within = |x: f32, least: f32| if x.is_nan() { 1.0 } else { x.clamp(least, 10.0) };
        Self {
            amount: within(self.amount, 0.0),
            protection: within(self.protection, 0.0),
            stroke_scale: within(self.stroke_scale, 0.1),
            relief: within(self.relief, 0.0),
            // The larger one of NaN and 0 is 0.
            // Also of a number that is none.
            added_relief: if self.added_relief > 0.0 { self.added_relief.min(4.0) } else { 0.0 },
            direction: self.direction.and_then(Vec3::try_normalize),
            curve: self.curve,
            motion: self.motion,
        }
    }

    /// The factors that words carry: of the share that is shown, at most 1, and of protection.
    pub fn of_words(&self) -> [f32; 2] {
        [self.amount.min(1.0), self.protection]
    }

    /// Whether there are changes that words cannot carry.
    pub fn change_seeds(&self) -> bool {
        let [amount, protection] = self.of_words();
        *self != Self { amount, protection, ..Self::NONE }
    }

    /// The strokes of a Gaussian if a share of those `below` is changed. `first_seed` is added to the numbers
    /// of seeds that are changed; at 0, only words are.
    pub fn word(&self, below: StrokeWord, share: f32, first_seed: u32) -> StrokeWord {
        let [amount, protection] = self.of_words().map(|factor| 1.0 + share * (factor - 1.0));
        let word =
            StrokeWord { protection: below.protection_by(protection), share: below.share * amount, ..below };
        match first_seed {
            0 => word,
            _ => mixed(word, StrokeWord { seed: word.seed + first_seed, ..word }, share),
        }
    }

    /// The thickness of paint if that below has this one.
    pub fn thickness(&self, below: f32) -> f32 {
        self.relief * below + self.added_relief
    }

    /// A seed whose strokes are changed, before it moves. It is the twin of what the kernel makes of a changed
    /// number.
    pub fn seed(&self, seed: &StrokeSeed) -> PlainSeed {
        let plain = seed.plain();
        let gain = self.amount.max(1.0);
        let plain = PlainSeed {
            fine: gain * plain.fine,
            wide: gain * plain.wide,
            pitch: plain.pitch / self.stroke_scale,
            ..plain
        };
        let toward = self.curve.map(|curve| curve.at(plain.at)).or(self.direction);
        toward.map_or(plain, |toward| plain.turned(seed.direction(), toward))
    }
}

impl PlainSeed {
    /// The seed turned in its plane, by less than a right angle, so that strokes that have the direction
    /// `stroke` in the painting run along the unit vector `toward` on the scene. As it is if that is nearly
    /// across the surface.
    fn turned(self, stroke: Vec2, toward: Vec3) -> Self {
        let in_plane = Vec2::new(self.right.dot(toward), self.down.dot(toward));
        if in_plane.length() <= IN_PLANE {
            return self;
        }
        let to = in_plane.normalize();
        let (cos, sin) = (stroke.dot(to), stroke.perp_dot(to));
        // Strokes have no head.
        let (cos, sin) = if cos < 0.0 { (-cos, -sin) } else { (cos, sin) };
        Self { right: self.right * cos + self.down * sin, down: self.down * cos - self.right * sin, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        layers::Region,
        strokes::{StrokeLayer, mix_strokes},
    };

    fn seed() -> StrokeSeed {
        let turn = glam::Quat::from_rotation_z(0.4);
        let (right, down, place) = (turn * Vec3::X, turn * Vec3::Y, Vec2::new(300.0, 200.0));
        let pitch = Vec2::new(300.0, 450.0);
        PlainSeed { at: Vec3::ONE, right, down, pitch, place, fine: 0.5, wide: 0.25, texture: 3 }
            .packed()
            .with_direction(Vec2::new(1.0, 2.0))
    }

    #[test]
    fn strokes_turn_toward_a_direction_about_their_middle() {
        let seed = seed();
        let stroke = seed.direction();
        for direction in [Vec3::X, Vec3::NEG_Y, Vec3::new(1.0, 1.0, 1.0).normalize()] {
            let found = StrokeFactors { direction: Some(direction), ..StrokeFactors::NONE }.seed(&seed);
            let along = found.right * stroke.x + found.down * stroke.y;
            let expected = direction.reject_from_normalized(Vec3::Z).normalize();
            assert!(along.dot(expected).abs() > 0.999, "{along} along {expected}");
            let before = seed.plain();
            assert!(found.right.dot(before.right) > -1e-4 && found.right.dot(found.down).abs() < 1e-4);
            assert_eq!((found.at, found.place, found.pitch), (before.at, before.place, before.pitch));
        }
        // A curve is one direction here and another there.
        let curve = StrokeCurve::new(&[Vec3::ZERO, 2.0 * Vec3::X, Vec3::new(2.0, 9.0, 0.0)]);
        let along_curve = StrokeFactors { curve, direction: Some(Vec3::Y), ..StrokeFactors::NONE };
        let turn = Vec3::X + Vec3::new(1.0, 1.0, 0.0).normalize();
        let found = along_curve.seed(&seed);
        let along = found.right * stroke.x + found.down * stroke.y;
        assert!(along.dot(turn.normalize()).abs() > 0.999, "{along}");
        // Nearly along the normal there is no direction.
        let across = StrokeFactors { direction: Some(Vec3::Z), ..StrokeFactors::NONE };
        assert_eq!(across.seed(&seed), seed.plain());
        assert_eq!(StrokeFactors::NONE.seed(&seed), seed.plain());
        let found = StrokeFactors { amount: 2.0, stroke_scale: 3.0, ..StrokeFactors::NONE }.seed(&seed);
        assert_eq!((found.fine, found.pitch), (2.0 * seed.plain().fine, seed.plain().pitch / 3.0));
    }

    #[test]
    fn what_is_no_number_changes_nothing() {
        let bad = StrokeFactors {
            amount: f32::NAN,
            protection: f32::NAN,
            stroke_scale: f32::NAN,
            relief: f32::NAN,
            added_relief: f32::NAN,
            direction: Some(Vec3::NAN),
            curve: None,
            motion: None,
        };
        assert_eq!(bad.usual(), StrokeFactors::NONE);
        let far = StrokeFactors {
            amount: f32::INFINITY,
            protection: -1.0,
            stroke_scale: 0.0,
            relief: -3.0,
            added_relief: 9.0,
            direction: Some(Vec3::ZERO),
            curve: None,
            motion: None,
        };
        let expected = StrokeFactors {
            amount: 10.0,
            protection: 0.0,
            stroke_scale: 0.1,
            relief: 0.0,
            added_relief: 4.0,
            ..StrokeFactors::NONE
        };
        assert_eq!(far.usual(), expected);
    }

    /// A mask steers amount, protection and seeds where it is painted, and nothing else.
    #[test]
    fn a_mask_steers_what_it_should_and_nothing_else() {
        let n = 256;
        let of = |i: usize| StrokeWord { seed: i as u32 % 50, protection: 0.5, share: 0.8 };
        let words: Vec<u32> = (0..n).map(|i| of(i).packed()).collect();
        let mask: Vec<[u8; 4]> = (0..n).map(|i| [0, i as u8, 0, 0]).collect();
        let means = vec![Vec3::ZERO; n];
        let below = StrokeLayer {
            words: Some(&words),
            first_seed: 0,
            region: Region::EVERYWHERE,
            strength: 1.0,
            mask: None,
            factors: None,
        };
        let mixed = |factors: StrokeFactors, first_seed: u32| -> Vec<StrokeWord> {
            let mask = Some((&mask[..], 1));
            let change = StrokeLayer { words: None, first_seed, mask, factors: Some(factors), ..below };
            mix_strokes(&means, &[below, change]).into_iter().map(StrokeWord::unpacked).collect()
        };
        let found = mixed(StrokeFactors { amount: 0.25, protection: 2.0, ..StrokeFactors::NONE }, 0);
        for (i, found) in found.iter().enumerate() {
            let (weight, before) = (i as f32 / 255.0, StrokeWord::unpacked(of(i).packed()));
            // To half of a step of seven bits.
            let expected = before.share * (1.0 - 0.75 * weight);
            assert!((found.share - expected).abs() < 0.005, "{i}: {} for {expected}", found.share);
            let factor = 1.0 + weight;
            // q^2 = 1, times the factor's square.
            let expected = factor * factor / (1.0 + factor * factor);
            assert!((found.protection - expected).abs() < 0.012, "{i}: {}", found.protection);
            assert_eq!(found.seed, before.seed);
        }
        // No paint at all leaves none.
        assert_eq!(mixed(StrokeFactors { amount: 0.0, ..StrokeFactors::NONE }, 0)[255].share, 0.0);
        // Seeds change spot by spot, and keep what their words carry.
        let scaled = StrokeFactors { stroke_scale: 2.0, ..StrokeFactors::NONE };
        assert!(scaled.change_seeds() && !StrokeFactors::NONE.change_seeds());
        let found = mixed(scaled, 64);
        let before = StrokeWord::unpacked(of(0).packed());
        assert_eq!(found[0], before);
        assert_eq!(found[255].seed, 64 + 255 % 50);
        assert!((found[255].share - before.share).abs() < 0.01 && found[255].protection == before.protection);
        let n_changed = found[100..156].iter().filter(|word| word.seed >= 64).count();
        assert!((15..=41).contains(&n_changed), "{n_changed} of 56 at about a half");
        // Without a change, not a bit differs.
        let plain = mix_strokes(&means, &[below]);
        let same = mixed(StrokeFactors::NONE, 0);
        assert!(same.iter().zip(plain).all(|(found, word)| found.packed() == word));
    }
}
