//! Directions of strokes that an artist gives.

use glam::Vec3;

use crate::strokes::{along_curve, step};

/// The way in which strokes run on a scene, in its space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Direction<'a> {
    /// Along a vector of any length above 0.
    Along(Vec3),
    /// Along a line through these points, of which at least two differ: each spot's strokes run as the line
    /// does where it is nearest. If the last point is the first, the line is closed.
    Curve(&'a [Vec3]),
}

/// A direction is none.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DirectionError {
    /// A vector has no direction.
    #[error("the strokes' direction is {found}, expected finite numbers that are not all 0")]
    Vector {
        /// The vector.
        found: Vec3,
    },
    /// A point is nowhere.
    #[error("point {number} of the strokes' curve is {found}, expected finite numbers")]
    Point {
        /// Its number, from 1.
        number: usize,
        /// The point.
        found: Vec3,
    },
    /// There are too few points.
    #[error("the strokes' curve has {found} points that differ, expected at least 2")]
    Curve {
        /// Their number.
        found: usize,
    },
}

impl Direction<'_> {
    /// Checks that there is a direction everywhere.
    ///
    /// # Errors
    /// If there is none.
    pub fn check(&self) -> Result<(), DirectionError> {
        match *self {
            Self::Along(found) => match found.try_normalize() {
                Some(_) => Ok(()),
                None => Err(DirectionError::Vector { found }),
            },
            Self::Curve(points) => {
                if let Some(i) = points.iter().position(|point| !point.is_finite()) {
                    return Err(DirectionError::Point { number: i + 1, found: points[i] });
                }
                match points.windows(2).any(|pair| step(pair[0], pair[1]) != Vec3::ZERO) {
                    true => Ok(()),
                    false => Err(DirectionError::Curve { found: points.len().min(1) }),
                }
            }
        }
    }

    /// The unit direction at a point; 0 if there is none.
    pub(super) fn at(&self, point: Vec3) -> Vec3 {
        match self {
            Self::Along(direction) => direction.normalize_or_zero(),
            Self::Curve(points) => along_curve(points, point),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_turns_evenly_from_point_to_point() {
        let corner = [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(2.0, 2.0, 0.0)];
        let at = |x: f32, y: f32| Direction::Curve(&corner).at(Vec3::new(x, y, 0.7));
        // Beyond its ends, it goes straight on.
        assert!(at(-5.0, 1.0).distance(Vec3::X) < 1e-6 && at(3.0, 9.0).distance(Vec3::Y) < 1e-6);
        // At the corner it is midway, and half of the way there a quarter of the turn is done.
        let diagonal = Vec3::new(1.0, 1.0, 0.0).normalize();
        assert!(at(2.5, -0.5).distance(diagonal) < 1e-6);
        assert!(at(1.0, -1.0).distance((Vec3::X + diagonal).normalize()) < 1e-6);
        assert!(at(3.0, 1.0).distance((Vec3::Y + diagonal).normalize()) < 1e-6);
        // A point that is there twice changes nothing.
        let twice = [corner[0], corner[1], corner[1], corner[2]];
        let apart = Direction::Curve(&twice).at(Vec3::new(0.5, 0.1, 0.0)).dot(Vec3::X);
        assert!(apart > 0.99, "{apart}");
        // A closed line has no end: around a square, each corner is midway.
        let square = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y, Vec3::ZERO];
        let corner = Direction::Curve(&square).at(Vec3::new(-1.0, -1.0, 0.0));
        assert!(corner.distance(Vec3::new(1.0, -1.0, 0.0).normalize()) < 1e-6, "{corner}");
    }

    #[test]
    fn what_has_no_direction_is_an_error() {
        let point = Vec3::new(1.0, 2.0, 3.0);
        assert_eq!(Direction::Curve(&[point, Vec3::ZERO]).check(), Ok(()));
        assert_eq!(Direction::Along(point).check(), Ok(()));
        for bad in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
            assert!(matches!(Direction::Along(bad).check(), Err(DirectionError::Vector { .. })), "{bad}");
        }
        assert_eq!(Direction::Curve(&[]).check(), Err(DirectionError::Curve { found: 0 }));
        assert_eq!(Direction::Curve(&[point, point]).check(), Err(DirectionError::Curve { found: 1 }));
        let found = Direction::Curve(&[point, Vec3::NAN]).check();
        assert!(matches!(found, Err(DirectionError::Point { number: 2, .. })), "{found:?}");
    }
}
