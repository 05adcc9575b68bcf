//! Curves that strokes run along.

use glam::Vec3;

/// Points of a [`StrokeCurve`] at most.
pub const MAX_CURVE_POINTS: usize = 8;

/// A line through two to eight points, of which neighbors differ, along which strokes run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeCurve {
    /// The points; those after the last one are 0.
    points: [Vec3; MAX_CURVE_POINTS],
    n: usize,
}

impl StrokeCurve {
    /// The line through these points. If there are more than eight, some of them, evenly chosen, the first and
    /// the last among them. `None` if one is not finite, or if there are fewer than two that differ.
    pub fn new(points: &[Vec3]) -> Option<Self> {
        let mut different: Vec<Vec3> = points.to_vec();
        different.dedup();
        let n = different.len().min(MAX_CURVE_POINTS);
        if n < 2 || !different.iter().all(|point| point.is_finite()) {
            return None;
        }
        let mut curve = Self { points: [Vec3::ZERO; MAX_CURVE_POINTS], n };
        for (i, point) in curve.points[..n].iter_mut().enumerate() {
            *point = different[i * (different.len() - 1) / (n - 1)];
        }
        Some(curve)
    }

    /// The points.
    pub fn points(&self) -> &[Vec3] {
        &self.points[..self.n]
    }

    /// The direction at each point: midway between those before and behind it, 0 if they are opposite.
    pub fn directions(&self) -> impl Iterator<Item = Vec3> + '_ {
        (0..self.n).map(|i| of_point(self.points(), i))
    }

    /// The unit direction where the line is nearest to `at`.
    pub fn at(&self, at: Vec3) -> Vec3 {
        along_curve(self.points(), at)
    }
}

/// The unit vector from a point to the next; 0 if they are the same.
pub(crate) fn step(from: Vec3, to: Vec3) -> Vec3 {
    (to - from).normalize_or_zero()
}

/// The direction of segment `i` of a line, which may be one behind its end.
fn segment(points: &[Vec3], i: usize) -> Vec3 {
    match points.get(i..i + 2) {
        Some(pair) => step(pair[0], pair[1]),
        None => Vec3::ZERO,
    }
}

/// The direction of a line at point `i`.
fn of_point(points: &[Vec3], i: usize) -> Vec3 {
    let n_segments = points.len().saturating_sub(1);
    let is_closed = n_segments > 1 && points.first() == points.last();
    let before = match i {
        0 if is_closed => segment(points, n_segments - 1),
        0 => Vec3::ZERO,
        _ => segment(points, i - 1),
    };
    let after = segment(points, if i == n_segments && is_closed { 0 } else { i });
    (before + after).normalize_or_zero()
}

/// The direction of a line where it is nearest to `at`. Between two of its points, it turns evenly from that at
/// the one to that at the other, so that strokes on either side of a corner do not break.
pub(crate) fn along_curve(points: &[Vec3], at: Vec3) -> Vec3 {
    let mut nearest = (f32::INFINITY, 0, 0.0);
    for (i, pair) in points.windows(2).enumerate() {
        let whole = pair[1] - pair[0];
        let part =
            ((at - pair[0]).dot(whole) / whole.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        let apart = (at - pair[0] - part * whole).length_squared();
        if apart < nearest.0 && step(pair[0], pair[1]) != Vec3::ZERO {
            nearest = (apart, i, part);
        }
    }
    let (_, i, part) = nearest;
    let (from, to) = (of_point(points, i), of_point(points, i + 1));
    from.lerp(to, part).try_normalize().unwrap_or_else(|| segment(points, i))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_has_points_that_differ_and_not_too_many() {
        assert_eq!(StrokeCurve::new(&[]), None);
        assert_eq!(StrokeCurve::new(&[Vec3::X, Vec3::X]), None);
        assert_eq!(StrokeCurve::new(&[Vec3::X, Vec3::NAN]), None);
        let twice = StrokeCurve::new(&[Vec3::ZERO, Vec3::X, Vec3::X, Vec3::ONE]).unwrap();
        assert_eq!(twice.points(), [Vec3::ZERO, Vec3::X, Vec3::ONE]);
        assert_eq!(twice.directions().count(), 3);
        let many: Vec<Vec3> = (0..40).map(|i| i as f32 * Vec3::X).collect();
        let few = StrokeCurve::new(&many).unwrap();
        assert_eq!((few.points().len(), few.points()[0], few.points()[7]), (8, Vec3::ZERO, 39.0 * Vec3::X));
        assert!(few.at(Vec3::new(5.0, 1.0, 1.0)).distance(Vec3::X) < 1e-6);
    }
}
