//! How a region covers balls: most Gaussians lie far from the edges of regions, and need no look at them one by
//! one.

use glam::{Mat3A, Vec3};

use super::{Region, Shape};

/// How a region covers a part of space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// The weight is 0 in all of the part.
    Outside,
    /// The weight may be anything.
    Edge,
    /// The weight is 1 in all of the part.
    Inside,
}

/// A region, prepared for questions about many balls.
#[derive(Clone, Copy, Debug)]
pub struct RegionCover<'a> {
    region: &'a Region,
    /// The largest factor by which the region's map stretches a distance.
    stretch: f32,
}

impl<'a> RegionCover<'a> {
    /// Prepares a region.
    pub fn new(region: &'a Region) -> Self {
        Self { region, stretch: stretch(region.shape_from_scene.matrix3) }
    }

    /// How the region covers a ball of the scene.
    pub fn of(&self, center: Vec3, radius: f32) -> Cover {
        let Region { shape, shape_from_scene, softness } = self.region;
        if *shape == Shape::Everything {
            return Cover::Inside;
        }
        let (at, radius) = (shape_from_scene.transform_point3(center), self.stretch * radius);
        let (nearest, farthest) = shape.distances(at, radius);
        let half = 0.5 * softness;
        // Comparisons with NaN are false, and unknown blocks are edges.
        if nearest >= half {
            Cover::Outside
        } else if farthest <= -half {
            Cover::Inside
        } else {
            Cover::Edge
        }
    }
}

/// The largest stretch of a map, or more.
fn stretch(map: Mat3A) -> f32 {
    let [x, y, z] = [map.x_axis, map.y_axis, map.z_axis];
    let squares = [x.length_squared(), y.length_squared(), z.length_squared()];
    let largest = squares.into_iter().fold(0.0, f32::max);
    let skew = x.dot(y).abs().max(x.dot(z).abs()).max(y.dot(z).abs());
    // With columns at right angles, the longest one is the stretch. Otherwise it is at most the root of all
    // squares' sum. A hundredth covers rounding.
    let is_straight = skew <= 1e-3 * largest;
    1.01 * if is_straight { largest } else { squares.iter().sum::<f32>() }.sqrt()
}

impl Shape {
    /// Bounds of [`distance`](Self::distance) over a ball: at least the first and at most the second.
    fn distances(&self, center: Vec3, radius: f32) -> (f32, f32) {
        match *self {
            // With L = |p / r|, the first-order distance L (L - 1) / |p / r^2| is at least r_min (L - 1)
            // without and at most that within, because |p / r^2| <= L / r_min. L differs by at most radius /
            // r_min.
            Self::Ellipsoid { radii } if radii != Vec3::splat(radii.x) => {
                let least = radii.min_element();
                let (middle, spread) = ((center / radii).length(), radius / least);
                let [nearest, farthest] = [middle - spread - 1.0, middle + spread - 1.0].map(|l| l * least);
                // On the other side of the surface, the bound is none.
                (
                    if nearest > 0.0 { nearest } else { f32::NEG_INFINITY },
                    if farthest < 0.0 { farthest } else { f32::INFINITY },
                )
            }
            // Its distance is size times noise, whose slope is at most 1.5 along each axis.
            Self::Noise { .. } => {
                let (at, slope) = (self.distance(center), 1.5 * 3.0_f32.sqrt() * radius);
                (at - slope, at + slope)
            }
            // Distances differ by no more than their points do.
            _ => (self.distance(center) - radius, self.distance(center) + radius),
        }
    }
}
