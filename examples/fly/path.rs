//! The way of the camera through a world: low over the terrain from one corner to another, with turns, and then
//! up, until it sees most of it.

use bevy::prelude::*;

/// Points of the way: shares of the world's sides along x and z, and heights above the terrain as a share of
/// its diagonal.
const POINTS: [[f32; 3]; 9] = [
    [0.1, 0.1, 0.0],
    [0.35, 0.15, 0.0],
    [0.5, 0.35, 0.0],
    [0.5, 0.6, 0.0],
    [0.65, 0.8, 0.0],
    [0.9, 0.85, 0.0],
    [1.05, 0.7, 0.08],
    [1.0, 0.5, 0.18],
    [0.85, 0.4, 0.25],
];

/// The point at which the rise begins.
const RISE: f32 = 5.0;

/// How much the camera looks down for a unit ahead: low over the terrain, and at the end.
const DOWN: [f32; 2] = [0.25, 0.75];

/// The share of the parts that may lie outside of the sides, on each side: a few hold a backdrop.
const OUTSIDE: f32 = 0.05;

/// Parts from whose tops the terrain's height is taken.
const NEAREST: usize = 8;

/// The field of view from bottom to top, in radians.
const FIELD: f32 = 0.9;

/// A way over a world.
pub struct Path {
    eyes: CubicCurve<Vec3>,
    /// The largest distance of two points of the world.
    diagonal: f32,
    /// The height of the camera above the tops of parts.
    clearance: f32,
}

impl Path {
    /// The way over parts with these boxes, up being y. `None` if there are none.
    pub fn over(boxes: &[[Vec3; 2]]) -> Option<Self> {
        let along = |of: &dyn Fn(&[Vec3; 2]) -> f32| {
            let mut sorted: Vec<f32> = boxes.iter().map(of).collect();
            sorted.sort_by(f32::total_cmp);
            sorted
        };
        let side = |axis: usize| {
            let sorted = along(&|[low, high]| 0.5 * (low[axis] + high[axis]));
            let outside = (OUTSIDE * sorted.len() as f32) as usize;
            Some([*sorted.get(outside)?, *sorted.get(sorted.len() - 1 - outside)?])
        };
        let ([west, east], [north, south]) = (side(0)?, side(2)?);
        let heights = along(&|[low, high]| high.y - low.y);
        let height = heights[heights.len() / 2].max(f32::MIN_POSITIVE);
        // A world of one part has no sides.
        let sides = Vec2::new(east - west, south - north).max(Vec2::splat(height));
        let (diagonal, clearance) = (sides.length(), 0.5 * height);
        let eye = |[x, z, up]: [f32; 3]| {
            let at = Vec2::new(west, north) + Vec2::new(x, z) * sides;
            Vec3::new(at.x, top(boxes, at) + clearance + up * diagonal, at.y)
        };
        let eyes = CubicCardinalSpline::new_catmull_rom(POINTS.map(eye)).to_curve().ok()?;
        Some(Self { eyes, diagonal, clearance })
    }

    /// The camera at a share of the way, 0..1.
    pub fn pose(&self, share: f32) -> Transform {
        let n_segments = (POINTS.len() - 1) as f32;
        let t = share.clamp(0.0, 1.0) * n_segments;
        let ahead = self.eyes.velocity(t).with_y(0.0).normalize_or(Vec3::X);
        let [low, high] = DOWN;
        let down = low.lerp(high, ((t - RISE) / (n_segments - RISE)).clamp(0.0, 1.0));
        Transform::from_translation(self.eyes.position(t)).looking_to(ahead - down * Vec3::Y, Vec3::Y)
    }

    /// The lens: it sees what is near, and all of the world.
    pub fn lens(&self) -> PerspectiveProjection {
        let (near, far) = (0.02 * self.clearance, 4.0 * self.diagonal);
        PerspectiveProjection { fov: FIELD, near, far, ..default() }
    }
}

/// The height of the terrain with what stands on it: the median top of the nearest parts.
fn top(boxes: &[[Vec3; 2]], at: Vec2) -> f32 {
    let distance = |[low, high]: &[Vec3; 2]| (0.5 * (low.xz() + high.xz())).distance_squared(at);
    let mut nearest: Vec<(f32, f32)> = boxes.iter().map(|part| (distance(part), part[1].y)).collect();
    nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
    nearest.truncate(NEAREST);
    nearest.sort_by(|a, b| a.1.total_cmp(&b.1));
    nearest[nearest.len() / 2].1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts of a plane that rises along x, 2 high, and one that is far away.
    fn slope() -> Vec<[Vec3; 2]> {
        let part = |i: usize| {
            let low = Vec3::new((i % 20) as f32, 0.1 * (i % 20) as f32, (i / 20) as f32);
            [low, low + Vec3::new(1.0, 2.0, 1.0)]
        };
        (0..400).map(part).chain([[Vec3::splat(-9e3), Vec3::splat(9e4)]]).collect()
    }

    #[test]
    fn the_camera_stays_over_the_terrain_and_ends_high_above() {
        let path = Path::over(&slope()).unwrap();
        let mut before = path.pose(0.0);
        for frame in 0..=600 {
            let pose = path.pose(frame as f32 / 600.0);
            let eye = pose.translation;
            let ground = 2.0 + 0.1 * (eye.x - 0.5);
            assert!(eye.is_finite() && eye.y > ground && (0.0..21.0).contains(&eye.x), "{frame}: {eye}");
            // It never jumps, and turns by less than two degrees in a frame.
            let turn = pose.rotation.angle_between(before.rotation).to_degrees();
            assert!(eye.distance(before.translation) < 0.2 && turn < 2.0, "{frame}: {eye}, {turn}");
            before = pose;
        }
        let [first, last] = [0.0, 1.0].map(|share| path.pose(share));
        assert!(first.translation.y < 3.5 && last.translation.y > 8.0, "{first:?} {last:?}");
        // It sees the middle of the world at the end.
        let middle = (Vec3::new(10.0, 2.0, 10.0) - last.translation).normalize();
        assert!(last.forward().dot(middle) > 0.75, "{}", last.forward().dot(middle));
    }

    #[test]
    fn one_part_is_enough_and_none_is_too_few() {
        let path = Path::over(&[[Vec3::ZERO, Vec3::ONE]]).unwrap();
        assert!((0..=10).all(|i| path.pose(i as f32 / 10.0).is_finite()));
        assert!(Path::over(&[]).is_none());
    }
}
