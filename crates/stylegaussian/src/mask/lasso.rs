//! The lasso: selects Gaussians within a line drawn over a view.

use std::ops::RangeInclusive;

use glam::{Vec2, Vec3};

use crate::camera::Camera;

/// A polygon in the picture of a camera, and everything behind it.
#[derive(Clone, Debug)]
pub struct Lasso {
    camera: Camera,
    polygon: Vec<Vec2>,
    depths: RangeInclusive<f32>,
    /// Corners of the box around the polygon, in pixels.
    low: Vec2,
    high: Vec2,
}

impl Lasso {
    /// The lasso along `polygon`, in pixels of `camera` from the picture's top left corner; the last point is
    /// joined to the first. If the line crosses itself, areas that it goes around twice are outside (the
    /// even-odd rule). The camera's world is the scene's space. Points that are not finite are dropped; fewer
    /// than three enclose nothing.
    pub fn new(camera: Camera, polygon: &[Vec2]) -> Self {
        let polygon: Vec<Vec2> = polygon.iter().copied().filter(|point| point.is_finite()).collect();
        let low = polygon.iter().copied().reduce(Vec2::min).unwrap_or_default();
        let high = polygon.iter().copied().reduce(Vec2::max).unwrap_or_default();
        Self { camera, polygon, depths: 0.0..=f32::INFINITY, low, high }
    }

    /// Limits to two distances from the camera along its axis (view-space z), in scene units. Nothing behind
    /// the camera is ever within.
    pub fn with_depths(self, depths: RangeInclusive<f32>) -> Self {
        Self { depths, ..self }
    }

    /// Whether a point of the scene is within.
    pub fn contains(&self, point: Vec3) -> bool {
        let view: Vec3 = self.camera.view_from_world.transform_point3(point);
        let is_ahead = view.z > 0.0 && self.depths.contains(&view.z);
        is_ahead && self.encloses(self.camera.focal * view.truncate() / view.z + self.camera.center)
    }

    /// Whether a ray to the right of `pixel` crosses the polygon an odd number of times.
    fn encloses(&self, pixel: Vec2) -> bool {
        // Most of a scene is outside of the box.
        let is_near = pixel.cmpge(self.low).all() && pixel.cmple(self.high).all();
        if !is_near {
            return false;
        }
        let starts = self.polygon.iter().cycle().skip(1);
        let crosses = |(a, b): &(&Vec2, &Vec2)| {
            // Half-open, so that a corner counts for one of its two edges.
            (a.y > pixel.y) != (b.y > pixel.y) && pixel.x < a.x + (pixel.y - a.y) / (b.y - a.y) * (b.x - a.x)
        };
        self.polygon.iter().zip(starts).filter(crosses).count() % 2 == 1
    }
}
