//! Signed distances (in pixels, negative inside) and curves.

use glam::Vec2;

/// Position (0..1) on the segment from `a` to `b` of the point nearest to `p`.
pub fn along_segment(p: Vec2, a: Vec2, b: Vec2) -> f32 {
    let ab = b - a;
    ((p - a).dot(ab) / ab.length_squared().max(1e-6)).clamp(0.0, 1.0)
}

/// Distance to a segment.
pub fn segment(p: Vec2, a: Vec2, b: Vec2) -> f32 {
    p.distance(a.lerp(b, along_segment(p, a, b)))
}

/// Distance to an open path.
pub fn polyline(p: Vec2, path: &[Vec2]) -> f32 {
    path.windows(2).map(|ends| segment(p, ends[0], ends[1])).fold(f32::MAX, f32::min)
}

/// Signed distance to a closed polygon. A point is inside if a ray from it crosses the edges an odd number of
/// times.
pub fn polygon(p: Vec2, corners: &[Vec2]) -> f32 {
    let (mut nearest, mut inside) = (f32::MAX, false);
    for i in 0..corners.len() {
        let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
        nearest = nearest.min(segment(p, a, b));
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x) {
            inside = !inside;
        }
    }
    if inside { -nearest } else { nearest }
}

/// A list of points with the box around them, which makes distances from far away cheap.
#[derive(Clone, Debug)]
pub struct Outline {
    points: Vec<Vec2>,
    low: Vec2,
    high: Vec2,
}

impl Outline {
    /// Beyond this distance from the box, in pixels, the distance to the box replaces the exact one.
    const FAR: f32 = 30.0;

    /// Wraps a path or a polygon's corners.
    pub fn new(points: Vec<Vec2>) -> Self {
        let low = points.iter().fold(Vec2::MAX, |a, &b| a.min(b));
        let high = points.iter().fold(Vec2::MIN, |a, &b| a.max(b));
        Self { points, low, high }
    }

    /// The points themselves.
    pub fn points(&self) -> &[Vec2] {
        &self.points
    }

    /// The distance to the box, if it is above [`FAR`](Self::FAR).
    fn beyond(&self, p: Vec2) -> Option<f32> {
        let gap = (self.low - p).max(p - self.high).max_element();
        (gap > Self::FAR).then_some(gap)
    }

    /// Signed distance to the closed shape: exact near it, a lower bound far outside.
    pub fn closed(&self, p: Vec2) -> f32 {
        self.beyond(p).unwrap_or_else(|| polygon(p, &self.points))
    }

    /// Distance to the open path: exact near it, a lower bound far from it.
    pub fn open(&self, p: Vec2) -> f32 {
        self.beyond(p).unwrap_or_else(|| polyline(p, &self.points))
    }
}

/// Approximate signed distance to an ellipse with half-axes `radii`. Its x axis points along the unit vector
/// `axis`.
pub fn ellipse(p: Vec2, center: Vec2, radii: Vec2, axis: Vec2) -> f32 {
    let q = turned(p - center, axis);
    let k = (q / radii).length();
    let slope = (q / (radii * radii)).length();
    if slope < 1e-6 { -radii.min_element() } else { k * (k - 1.0) / slope }
}

/// `v` in the frame that has the unit vector `axis` as its x axis.
pub fn turned(v: Vec2, axis: Vec2) -> Vec2 {
    Vec2::new(v.dot(axis), axis.perp_dot(v))
}

/// A smooth curve through `knots` (Catmull-Rom), `steps` points per span. The first and the last knot count
/// twice, so that the curve reaches them.
pub fn curve(knots: &[Vec2], steps: usize) -> Vec<Vec2> {
    let knot = |i: isize| knots[i.clamp(0, knots.len() as isize - 1) as usize];
    let mut points = Vec::with_capacity(knots.len() * steps);
    for span in 0..knots.len() as isize - 1 {
        let (a, b, c, d) = (knot(span - 1), knot(span), knot(span + 1), knot(span + 2));
        for step in 0..steps {
            let t = step as f32 / steps as f32;
            let (t2, t3) = (t * t, t * t * t);
            points.push(
                (b * 2.0
                    + (c - a) * t
                    + (a * 2.0 - b * 5.0 + c * 4.0 - d) * t2
                    + (b * 3.0 - a - c * 3.0 + d) * t3)
                    * 0.5,
            );
        }
    }
    points.extend(knots.last());
    points
}

/// A list of points from their coordinates.
pub fn points<const N: usize>(list: [(f32, f32); N]) -> Vec<Vec2> {
    list.into_iter().map(Vec2::from).collect()
}
