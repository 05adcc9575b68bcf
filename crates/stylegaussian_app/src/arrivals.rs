//! Arrivals: the ways in which a style takes the place of another.

use std::time::Duration;

use bevy::prelude::*;
use bevy_stylegaussian::StyleTransition;

use crate::{camera::Orbit, opening::Subject};

/// The longest time of a transition in seconds. More is a mistake of whoever asks for it.
const LONGEST: f32 = 3600.0;

/// The way in which a style takes the place of another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Arrival {
    /// Everywhere at once.
    #[default]
    Fade,
    /// As a sphere that grows from the point that the camera turns around.
    Sphere,
    /// From left to right.
    Front,
    /// In spots that grow together.
    Spots,
}

impl Arrival {
    /// The arrival of a name: `fade`, `sphere`, `front` or `noise`.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "fade" => Some(Self::Fade),
            "sphere" => Some(Self::Sphere),
            "front" => Some(Self::Front),
            "noise" => Some(Self::Spots),
            _ => None,
        }
    }
}

/// The way in which styles arrive, and its time.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct Arrivals {
    /// The way.
    pub way: Arrival,
    /// The time from one style to the next. NaN and less than nothing are no time at all.
    pub seconds: f32,
}

impl Default for Arrivals {
    fn default() -> Self {
        Self { way: Arrival::Fade, seconds: 0.5 }
    }
}

impl Arrivals {
    /// The transition as this camera sees it. Edges and spots have their sizes in the picture.
    pub fn transition(&self, orbit: &Orbit) -> StyleTransition {
        let seconds = if self.seconds > 0.0 { self.seconds.min(LONGEST) } else { 0.0 };
        let duration = Duration::from_secs_f32(seconds);
        let size = orbit.distance();
        match self.way {
            Arrival::Fade => StyleTransition::fade(duration),
            Arrival::Sphere => StyleTransition::sphere(orbit.target(), duration).with_softness(0.1 * size),
            Arrival::Front => StyleTransition::front(orbit.right(), duration).with_softness(0.1 * size),
            Arrival::Spots => StyleTransition::dissolve(0.05 * size, duration),
        }
    }
}

/// Has the next style arrive in the way that is set, as the camera sees it then.
pub fn set_transition(
    arrivals: Res<Arrivals>,
    orbit: Single<&Orbit>,
    mut transition: Single<&mut StyleTransition, With<Subject>>,
) {
    transition.set_if_neq(arrivals.transition(&orbit));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn transition(name: &str, seconds: f32) -> Option<StyleTransition> {
        let way = Arrival::from_name(name)?;
        Some(Arrivals { way, seconds }.transition(&Orbit::default()))
    }

    #[test]
    fn transitions_go_by_name_and_take_any_time() {
        for name in ["fade", "sphere", "front", "noise"] {
            let duration = transition(name, 1.5).unwrap().duration;
            assert_eq!(duration, Duration::from_millis(1500), "{name}");
        }
        assert_eq!(transition("spiral", 1.0), None);
        for seconds in [f32::NAN, -1.0, f32::NEG_INFINITY] {
            assert_eq!(transition("fade", seconds).unwrap().duration, Duration::ZERO);
        }
        assert_eq!(transition("fade", f32::INFINITY).unwrap().duration.as_secs(), 3600);
    }

    #[test]
    fn a_transition_is_as_the_camera_sees_it() {
        let mut orbit = Orbit::frame(Vec3::Y, 1.0, 1.0);
        let sphere = Arrivals { way: Arrival::Sphere, seconds: 1.0 };
        let second = Duration::from_secs(1);
        let expected = StyleTransition::sphere(Vec3::Y, second).with_softness(0.1 * orbit.distance());
        assert_eq!(sphere.transition(&orbit), expected);
        orbit.zoom(0.5);
        assert_ne!(sphere.transition(&orbit), expected);
    }
}
