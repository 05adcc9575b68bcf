//! Strokes that move.

use bevy::prelude::*;
use stylegaussian::strokes::StrokeMotion;

/// The way in which the strokes of a [`StyleSource`](crate::StyleSource) move.
///
/// They move by the game's clock, `Time<Virtual>`: they are paused, slowed and recorded with it, and a frame of
/// the same time is the same picture. A change is shown in the next frame and computes nothing. While strokes
/// move, an app that draws on demand draws in each frame.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{StyleSource, StyleVolume, style::StyleMotion};
/// # fn system(mut commands: Commands, mut source: Single<&mut StyleSource>, assets: Res<AssetServer>) {
/// // A film that is painted eight times a second.
/// source.motion = StyleMotion::boil(8.0);
/// // A waterfall.
/// let water = StyleSource::image(assets.load("wave.jpg"))
///     .with_motion(StyleMotion::flow(0.5).with_toward(Vec3::NEG_Y));
/// commands.spawn((StyleVolume::new(Cuboid::new(1.0, 4.0, 1.0)), water));
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum StyleMotion {
    /// Strokes stay where they are.
    #[default]
    Still,
    /// Every stroke is drawn anew, a little beside its place and a little turned. In between, frames are equal.
    Boil {
        /// Times per second, 0 to 60.
        rate: f32,
        /// Distance from its place at most, in widths of a stroke, 0 to 8.
        amount: f32,
    },
    /// Strokes run along their own direction, fade, and begin anew, each at a time of its own.
    Flow {
        /// Runs per second, 0 to 60. Another rate is another place in the run; to slow strokes down without a
        /// jump, slow the game's clock.
        rate: f32,
        /// Length of a run, in widths of a stroke, 0 to 8.
        amount: f32,
        /// Direction in the scene's space to whose side strokes run, of any length. Strokes across it stand
        /// still.
        toward: Vec3,
    },
}

impl StyleMotion {
    /// Strokes that are redrawn so many times a second, up to half of their width beside their place. Films are
    /// painted 8 or 12 times a second.
    pub fn boil(rate: f32) -> Self {
        Self::Boil { rate, amount: 0.5 }
    }

    /// Strokes that run twice their width, so many times a second, to the side of x.
    pub fn flow(rate: f32) -> Self {
        Self::Flow { rate, amount: 2.0, toward: Vec3::X }
    }

    /// The same motion over this distance, in widths of a stroke.
    pub fn with_amount(mut self, distance: f32) -> Self {
        if let Self::Boil { amount, .. } | Self::Flow { amount, .. } = &mut self {
            *amount = distance;
        }
        self
    }

    /// The same flow to the side of `direction`, in the scene's space.
    pub fn with_toward(mut self, direction: Vec3) -> Self {
        if let Self::Flow { toward, .. } = &mut self {
            *toward = direction;
        }
        self
    }

    /// The motion within sane ranges. What is no number stands still.
    pub(crate) fn usual(self) -> StrokeMotion {
        let (times, widths) = (|rate: f32| rate.min(60.0), |amount: f32| amount.min(8.0));
        match self {
            Self::Still => StrokeMotion::Still,
            Self::Boil { rate, amount } if !rate.is_nan() && !amount.is_nan() => {
                StrokeMotion::Boil { rate: times(rate), amount: widths(amount) }
            }
            Self::Flow { rate, amount, toward } if !rate.is_nan() && !amount.is_nan() && !toward.is_nan() => {
                StrokeMotion::Flow { rate: times(rate), amount: widths(amount), toward }
            }
            Self::Boil { .. } | Self::Flow { .. } => StrokeMotion::Still,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_stands_still() {
        let motions = [StyleMotion::boil(8.0), StyleMotion::flow(0.5)];
        assert!(motions.iter().all(|motion| !motion.usual().is_still()));
        for bad in [f32::NAN, -1.0, 0.0, f32::NEG_INFINITY] {
            for motion in [StyleMotion::boil(bad), StyleMotion::flow(bad)] {
                assert!(motion.usual().is_still(), "{motion:?}");
            }
            for motion in motions {
                assert!(motion.with_amount(bad).usual().is_still(), "{motion:?}");
            }
        }
        let fastest = StrokeMotion::Boil { rate: 60.0, amount: 8.0 };
        for rate in [f32::INFINITY, 1e9] {
            assert_eq!(StyleMotion::boil(rate).with_amount(100.0).usual(), fastest);
            let flow = StyleMotion::flow(rate).with_amount(f32::INFINITY).usual();
            assert_eq!(flow, StrokeMotion::Flow { rate: 60.0, amount: 8.0, toward: Vec3::X });
        }
        assert!(StyleMotion::flow(1.0).with_toward(Vec3::NAN).usual().is_still());
    }
}
