//! Strokes that move: redrawn some times a second (*boil*), or running along their own direction (*flow*).
//!
//! A motion changes the places of seeds before records are made, so pixels cost no more than those of still
//! strokes. It is a function of the seed and of the time alone: the same time gives the same picture.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::{
    of_scene::Strokes,
    seed::{PlainSeed, StrokeSeed},
};

/// Width of a stroke in texels: fine detail ends at 8 pixels of a painting, which is read at a half of 512
/// pixels, or at all of them.
pub const STROKE: f32 = 16.0;

/// The most by which a stroke that is redrawn is turned, in radians, at an amount of 1: at the rim of its spot,
/// half a stroke away, that is a fifth of the shift of its place.
pub const TURN: f32 = 0.4;

/// Part of a run at either end of it within which a flowing stroke comes or goes.
pub const FADE: f32 = 0.1;

/// Cosine between a stroke and the direction of its flow above which it runs at full speed. Strokes across the
/// flow stand still, so that neighbors that differ little do not run against each other.
pub const ACROSS: f32 = 0.25;

/// Share of the full speed from which on a stroke fades between its runs. Slower ones jump by less than a
/// quarter of their width at a usual length.
pub const SLOW: f32 = 0.125;

/// The lowest bit of [`StrokeSeed::look`] that says the direction of strokes, and the number of directions.
pub const DIRECTION_SHIFT: u32 = 26;
/// Directions that a seed tells apart: six bits for half of a circle.
pub const DIRECTIONS: u32 = 64;

/// `kind` of strokes that stand still.
pub const KIND_STILL: u32 = 0;
/// `kind` of strokes that are redrawn.
pub const KIND_BOIL: u32 = 1;
/// `kind` of strokes that run.
pub const KIND_FLOW: u32 = 2;

/// A way to move. A rate or an amount that is not a number above 0 stands still.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum StrokeMotion {
    /// Strokes stay where they are.
    #[default]
    Still,
    /// Every stroke is drawn anew, a little beside its place and a little turned, as in a film that is painted
    /// picture by picture. Between two times of that, nothing changes.
    Boil {
        /// Times per second.
        rate: f32,
        /// Distance from its place at most, in widths of a stroke.
        amount: f32,
    },
    /// Strokes run along their own direction, and begin anew at different times: wind, water.
    Flow {
        /// Runs per second. After a second over this rate, all is as it was.
        rate: f32,
        /// Length of a run, in widths of a stroke.
        amount: f32,
        /// Direction in scene space to whose side strokes run. Strokes across it stand still.
        toward: Vec3,
    },
}

/// A motion at a time, as the kernel takes it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionNow {
    /// One of the `KIND_` constants.
    pub kind: u32,
    /// Number of the present drawing of strokes that are redrawn, modulo 2^32.
    pub drawing: u32,
    /// Part of the present run of strokes that run, 0..1.
    pub part: f32,
    /// Distance in widths of a stroke.
    pub amount: f32,
    /// The unit direction of a flow, in scene space.
    pub toward: Vec3,
}

impl StrokeMotion {
    /// The motion at `seconds`. Fractions are taken in f64, so that hours of a game lose nothing.
    pub fn at(self, seconds: f64) -> MotionNow {
        let moves = |rate: f32, amount: f32| {
            rate > 0.0 && rate.is_finite() && amount > 0.0 && amount.is_finite() && seconds.is_finite()
        };
        match self {
            Self::Boil { rate, amount } if moves(rate, amount) => {
                // Times before 0 have drawings too. The cast to 64 bits saturates, and that to 32 bits wraps.
                let drawing = (seconds * f64::from(rate)).floor() as i64 as u32;
                MotionNow { kind: KIND_BOIL, drawing, amount, ..MotionNow::default() }
            }
            Self::Flow { rate, amount, toward } if moves(rate, amount) && toward.is_finite() => {
                let part = (seconds * f64::from(rate)).rem_euclid(1.0) as f32;
                // In f64: the square of a long direction is no f32.
                let toward = toward.as_dvec3().normalize_or_zero().as_vec3();
                MotionNow { kind: KIND_FLOW, part, amount, toward, ..MotionNow::default() }
            }
            _ => MotionNow::default(),
        }
    }

    /// Whether strokes ever move.
    pub fn is_still(self) -> bool {
        self.at(0.0).kind == KIND_STILL
    }
}

/// A hash: the finalizer of MurmurHash3 by Appleby.
fn hash(mut h: u32) -> u32 {
    h = (h ^ (h >> 16)).wrapping_mul(0x85EB_CA6B);
    h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
    h ^ (h >> 16)
}

/// The upper 24 bits of a hash, which f32 holds exactly, as a number of 0..1.
fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 / (1_u32 << 24) as f32
}

/// From 0 to 1 without a bend at either end.
fn smooth(x: f32) -> f32 {
    x * x * (3.0 - 2.0 * x)
}

impl StrokeSeed {
    /// The same seed whose strokes have `direction` in the painting, x right and y down, of either sign. Half a
    /// circle has [`DIRECTIONS`].
    pub fn with_direction(self, direction: Vec2) -> Self {
        let angle = if direction.is_finite() { direction.to_angle() } else { 0.0 };
        let number = (angle / PI * DIRECTIONS as f32).round().rem_euclid(DIRECTIONS as f32) as u32;
        let others = (1 << DIRECTION_SHIFT) - 1;
        Self { look: self.look & others | (number % DIRECTIONS) << DIRECTION_SHIFT, ..self }
    }

    /// The direction of its strokes in the painting, a unit vector; the painting's x axis unless something else
    /// was set.
    pub fn direction(&self) -> Vec2 {
        Vec2::from_angle((self.look >> DIRECTION_SHIFT) as f32 * (PI / DIRECTIONS as f32))
    }

    /// The seed in plain numbers, moved.
    pub fn plain_at(&self, now: &MotionNow) -> PlainSeed {
        let seed = self.plain();
        // Of what a seed is and not of its number, which differs from mix to mix.
        let own = hash(self.place ^ self.rotation_xy.rotate_left(16));
        let widths = STROKE * now.amount * Vec2::new(1.0, seed.pitch.y / seed.pitch.x);
        match now.kind {
            KIND_BOIL => {
                let first = hash(own ^ hash(now.drawing));
                let second = hash(first);
                let third = hash(second);
                let [x, y, turn] = [first, second, third].map(|h| 2.0 * unit(h) - 1.0);
                let (sin, cos) = (TURN * now.amount * turn).sin_cos();
                PlainSeed {
                    place: seed.place + widths * Vec2::new(x, y),
                    right: seed.right * cos + seed.down * sin,
                    down: seed.down * cos - seed.right * sin,
                    ..seed
                }
            }
            KIND_FLOW => {
                let part = (now.part + unit(own)).fract();
                let direction = self.direction();
                let cosine = (seed.right * direction.x + seed.down * direction.y).dot(now.toward);
                let speed = (cosine / ACROSS).clamp(-1.0, 1.0);
                let open = smooth((part.min(1.0 - part) / FADE).clamp(0.0, 1.0));
                let gain = 1.0 - (speed.abs() / SLOW).min(1.0) * (1.0 - open);
                PlainSeed {
                    place: seed.place - widths * direction * ((part - 0.5) * speed),
                    fine: gain * seed.fine,
                    wide: gain * seed.wide,
                    ..seed
                }
            }
            _ => seed,
        }
    }
}

impl Strokes {
    /// The strokes as they are at `seconds`. Still ones are as they were, to the bit.
    pub fn moved(&self, motion: StrokeMotion, seconds: f64) -> Self {
        let now = motion.at(seconds);
        let seed = |seed: &StrokeSeed| match now.kind {
            KIND_STILL => *seed,
            _ => seed.plain_at(&now).packed().with_direction(seed.direction()),
        };
        Self { seeds: self.seeds.iter().map(seed).collect(), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{random::Random, strokes::PERIOD};

    fn seeds(n: usize) -> Vec<StrokeSeed> {
        let mut random = Random::new(7);
        let mut three = || Vec3::from_array(std::array::from_fn(|_| random.uniform() - 0.5));
        let seed = |_| {
            let turn = glam::Quat::from_axis_angle(three().normalize(), 6.0 * three().x);
            let (right, down) = (turn * Vec3::X, turn * Vec3::Y);
            let (pitch, place) = (Vec2::new(300.0, 450.0), PERIOD * (three().truncate() + 0.5));
            PlainSeed { at: three(), right, down, pitch, place, fine: 1.0, wide: 0.5, texture: 3 }
                .packed()
                .with_direction(three().truncate())
        };
        (0..n).map(seed).collect()
    }

    fn strokes(n: usize) -> Strokes {
        Strokes { seeds: seeds(n), ..Strokes::default() }
    }

    const BOIL: StrokeMotion = StrokeMotion::Boil { rate: 8.0, amount: 0.5 };
    const FLOW: StrokeMotion = StrokeMotion::Flow { rate: 0.5, amount: 2.0, toward: Vec3::X };

    #[test]
    fn directions_survive_packing() {
        let seed = seeds(1)[0];
        for i in 0..100 {
            let direction = Vec2::from_angle(i as f32 * 0.0628);
            let with = seed.with_direction(direction);
            // Half of a step of 2.8 degrees.
            assert!(with.direction().dot(direction).abs() > 0.9996, "{direction} {}", with.direction());
            assert_eq!((with.plain(), with.with_texture(9).direction()), (seed.plain(), with.direction()));
        }
        assert_eq!(StrokeSeed::default().direction(), Vec2::X);
        assert_eq!(seed.with_direction(Vec2::NAN).direction(), Vec2::X);
    }

    #[test]
    fn boil_redraws_at_its_rate_and_nothing_between() {
        let strokes = strokes(500);
        let at = |seconds: f64| strokes.moved(BOIL, seconds);
        // An hour later, in the middle and at the end of a drawing.
        for start in [0.0, 3600.0, -1.0] {
            assert_eq!(at(start), at(start + 0.124));
            assert_ne!(at(start), at(start + 0.126));
        }
        let (mut shifts, mut turns) = (Vec2::ZERO, 0.0);
        for (moved, seed) in at(2.0).seeds.iter().zip(&strokes.seeds) {
            let (moved, seed) = (moved.plain(), seed.plain());
            let apart =
                (moved.place - seed.place + PERIOD * 1.5).rem_euclid(Vec2::splat(PERIOD)) - PERIOD / 2.0;
            // Half of a stroke, and half as much more in y, of which there are as many texels.
            assert!(apart.x.abs() < 8.1 && apart.y.abs() < 12.1, "{apart}");
            let turn = moved.right.angle_between(seed.right);
            assert!(turn < 0.21 && moved.right.dot(moved.down).abs() < 1e-3, "{turn}");
            assert_eq!((moved.at, moved.pitch, moved.texture), (seed.at, seed.pitch, seed.texture));
            shifts += apart.abs();
            turns += turn;
        }
        // Evenly to all sides: half of the most.
        let [x, y, turn] = [shifts.x, shifts.y, turns].map(|sum| sum / 500.0);
        assert!(
            (x - 4.0).abs() < 0.5 && (y - 6.0).abs() < 0.7 && (turn - 0.1).abs() < 0.02,
            "{x} {y} {turn}"
        );
    }

    #[test]
    fn flow_runs_along_strokes_and_closes() {
        let strokes = strokes(500);
        let at = |seconds: f64| strokes.moved(FLOW, seconds);
        // A run takes two seconds. Half a day is exact in f64.
        assert_eq!(at(0.75), at(2.75));
        assert_eq!(at(0.75), at(43_200.75));
        let mut n_seen = 0;
        for (i, seed) in strokes.seeds.iter().enumerate() {
            let plain = seed.plain();
            let [before, after] = [1.0, 1.02].map(|seconds| at_seed(seed, seconds));
            // In widths, along the direction: a hundredth of a run of two strokes at most.
            let step = (after.place - before.place) / Vec2::new(1.0, 1.5);
            let direction = seed.direction();
            let scene = plain.right * direction.x + plain.down * direction.y;
            assert!(step.perp_dot(direction).abs() < 1e-3, "{i}: {step}");
            if step.length() < 0.33 {
                // The pattern runs against the place.
                assert!(-step.dot(direction) * scene.x >= -1e-4, "{i}: {step}");
                let changes = (after.fine - before.fine).abs();
                assert!(changes < 0.16, "{i}: {changes}");
                n_seen += usize::from(step.length() > 0.25);
            } else if step.length() > 4.0 {
                // It begins anew, of which nothing is seen.
                assert!(before.fine < 0.05 && after.fine < 0.05, "{i}: {} {}", before.fine, after.fine);
            }
        }
        assert!(n_seen > 250, "{n_seen}");
    }

    fn at_seed(seed: &StrokeSeed, seconds: f64) -> PlainSeed {
        seed.plain_at(&FLOW.at(seconds))
    }

    #[test]
    fn what_does_not_move_stays_to_the_bit() {
        let (strokes, bad) = (strokes(50), [0.0, -1.0, f32::NAN, f32::INFINITY]);
        let mut motions = vec![StrokeMotion::Still];
        for bad in bad {
            motions.push(StrokeMotion::Boil { rate: bad, amount: 1.0 });
            motions.push(StrokeMotion::Boil { rate: 1.0, amount: bad });
            motions.push(StrokeMotion::Flow { rate: bad, amount: 1.0, toward: Vec3::X });
        }
        motions.push(StrokeMotion::Flow { rate: 1.0, amount: 1.0, toward: Vec3::NAN });
        for motion in motions {
            assert!(motion.is_still() && strokes.moved(motion, 12.3) == strokes, "{motion:?}");
        }
        assert!(strokes.moved(BOIL, f64::NAN) == strokes);
        assert!(!BOIL.is_still() && !FLOW.is_still());
        // Fast, and for a long time: a part of a run all the same.
        let fast = StrokeMotion::Flow { rate: 1e9, amount: 1.0, toward: Vec3::X };
        assert!((0.0..=1.0).contains(&fast.at(1e12).part) && (0.0..=1.0).contains(&fast.at(-1e12).part));
        assert_eq!(StrokeMotion::Boil { rate: 1e9, amount: 1.0 }.at(1e300).kind, KIND_BOIL);
        // A direction of any length.
        for length in [1e-30, 1e30] {
            let flow = StrokeMotion::Flow { rate: 0.5, amount: 2.0, toward: length * Vec3::X };
            assert_eq!(flow.at(1.3), FLOW.at(1.3));
        }
        // No direction at all: strokes stand still, and do not fade.
        let nowhere = StrokeMotion::Flow { rate: 1.0, amount: 1.0, toward: Vec3::ZERO };
        assert_eq!(strokes.seeds[0].plain_at(&nowhere.at(0.3)), strokes.seeds[0].plain());
    }
}
