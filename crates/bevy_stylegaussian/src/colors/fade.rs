//! Fades from one set of colors to the next, and their clock.

use std::time::Duration;

use bevy::{prelude::*, render::Extract};

/// Fade duration of an entity's changes of style. Without this component, changes are immediate.
///
/// A fade begins once the new style is complete. A style that becomes ready during a fade waits for its end. Fades run on
/// `Time<Real>`, so they go on while a game is paused or slowed down.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleTransition {
    /// Time from the last frame in the old colors to the first in the new colors alone.
    pub duration: Duration,
}

impl Default for StyleTransition {
    /// Half a second.
    fn default() -> Self {
        Self { duration: Duration::from_millis(500) }
    }
}

/// Time since startup, as `Time<Real>` counts it.
#[derive(Resource, Clone, Copy, Default)]
pub(crate) struct FadeClock(pub(crate) Duration);

/// Copies the main world's time.
pub(super) fn extract_clock(mut clock: ResMut<FadeClock>, time: Extract<Res<Time<Real>>>) {
    clock.0 = time.elapsed();
}

/// A change from one set of colors to the next.
pub(super) struct Fade {
    /// Buffer of the old colors, or `None` for the captured colors.
    pub(super) from: Option<usize>,
    pub(super) began: Duration,
    /// Not zero.
    pub(super) duration: Duration,
}

impl Fade {
    /// 0 at the beginning, 1 at the end, more after it.
    pub(super) fn progress(&self, now: Duration) -> f32 {
        // The quotient of two `f32`s is finite: no fade has a duration of 0.
        now.saturating_sub(self.began).as_secs_f32() / self.duration.as_secs_f32()
    }
}
