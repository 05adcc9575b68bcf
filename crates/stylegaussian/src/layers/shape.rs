//! Shapes by their signed distance.

use glam::{Vec2, Vec3};

use super::lattice::lattice_noise;

/// A shape around the origin, in world units. Axes and centers are those of Bevy's primitive shapes: what has
/// an axis has it along y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// All of space.
    Everything,
    /// All points with y below 0.
    HalfSpace,
    /// An ellipsoid; a sphere if the radii are equal.
    Ellipsoid {
        /// Radii along x, y and z.
        radii: Vec3,
    },
    /// A box.
    Cuboid {
        /// Half of its size along x, y and z.
        half_size: Vec3,
    },
    /// A cylinder.
    Cylinder {
        /// Radius.
        radius: f32,
        /// Half of its height.
        half_height: f32,
    },
    /// A cylinder with half a sphere on either end.
    Capsule {
        /// Radius.
        radius: f32,
        /// Half of the cylinder's height.
        half_length: f32,
    },
    /// A cone. The origin is in the middle of its height, its tip above it.
    Cone {
        /// Radius at the bottom.
        radius: f32,
        /// Height.
        height: f32,
    },
    /// A ring.
    Torus {
        /// Radius of the circle in the middle of the tube.
        major_radius: f32,
        /// Radius of the tube.
        minor_radius: f32,
    },
    /// The places at which noise is below a level: spots that grow together as the level rises from 0 to 1.
    Noise {
        /// Distance of spots.
        size: f32,
        /// The level.
        level: f32,
    },
}

impl Shape {
    /// The distance of a point from the surface, negative within the shape. Exact for boxes, cylinders,
    /// capsules, rings and spheres; near the surface of an ellipsoid correct to first order. For noise it is
    /// the difference from the level times the size. Shapes of no size hold no point. NaN if a size or the
    /// point is none, except of [`Everything`](Self::Everything).
    pub fn distance(&self, point: Vec3) -> f32 {
        // Not left to the arithmetic below: the larger one of a number and NaN is the number.
        if self != &Self::Everything && (point.is_nan() || self.has_nan()) {
            return f32::NAN;
        }
        // The distance from the axis, and the place along it.
        let radial = Vec2::new(point.x, point.z).length();
        match *self {
            Self::Everything => f32::NEG_INFINITY,
            Self::HalfSpace => point.y,
            Self::Ellipsoid { radii } => ellipsoid(point, radii),
            Self::Cuboid { half_size } => {
                let outside = point.abs() - half_size;
                outside.max(Vec3::ZERO).length() + outside.max_element().min(0.0)
            }
            Self::Cylinder { radius, half_height } => {
                let outside = Vec2::new(radial - radius, point.y.abs() - half_height);
                outside.max(Vec2::ZERO).length() + outside.max_element().min(0.0)
            }
            Self::Capsule { radius, half_length } => {
                // Not `clamp`, which panics if a length is negative or none.
                let along = point.y.max(-half_length).min(half_length);
                Vec2::new(radial, point.y - along).length() - radius
            }
            Self::Cone { radius, height } => cone(Vec2::new(radial, point.y), radius, height),
            Self::Torus { major_radius, minor_radius } => {
                Vec2::new(radial - major_radius, point.y).length() - minor_radius
            }
            Self::Noise { size, level } => size * (lattice_noise(point / size) - level),
        }
    }

    /// Whether one of its sizes is no number.
    fn has_nan(&self) -> bool {
        match *self {
            Self::Everything | Self::HalfSpace => false,
            Self::Ellipsoid { radii: sizes } | Self::Cuboid { half_size: sizes } => sizes.is_nan(),
            Self::Cylinder { radius: a, half_height: b }
            | Self::Capsule { radius: a, half_length: b }
            | Self::Cone { radius: a, height: b }
            | Self::Torus { major_radius: a, minor_radius: b }
            | Self::Noise { size: a, level: b } => a.is_nan() || b.is_nan(),
        }
    }

    /// The shape with its sizes multiplied. Round shapes along y keep round: x and z count by their geometric
    /// mean.
    pub fn scaled(self, scale: Vec3) -> Self {
        let scale = scale.abs();
        let around = (scale.x * scale.z).sqrt();
        match self {
            Self::Everything | Self::HalfSpace => self,
            Self::Ellipsoid { radii } => Self::Ellipsoid { radii: radii * scale },
            Self::Cuboid { half_size } => Self::Cuboid { half_size: half_size * scale },
            Self::Cylinder { radius, half_height } => {
                Self::Cylinder { radius: radius * around, half_height: half_height * scale.y }
            }
            Self::Capsule { radius, half_length } => {
                Self::Capsule { radius: radius * around, half_length: half_length * scale.y }
            }
            Self::Cone { radius, height } => Self::Cone { radius: radius * around, height: height * scale.y },
            Self::Torus { major_radius, minor_radius } => Self::Torus {
                major_radius: major_radius * around,
                minor_radius: minor_radius * (around * scale.y).sqrt(),
            },
            Self::Noise { size, level } => {
                Self::Noise { size: size * (around * around * scale.y).cbrt(), level }
            }
        }
    }
}

/// The distance from an ellipsoid, to first order: the value of |p / r| - 1 over its gradient.
fn ellipsoid(point: Vec3, radii: Vec3) -> f32 {
    let scaled = point / radii;
    let length = scaled.length();
    let gradient = (scaled / radii).length();
    // The center of a sphere has no gradient; it is its radius away from the surface.
    if length > 0.0 { length * (length - 1.0) / gradient } else { -radii.min_element() }
}

/// The distance from a cone in the plane of its axis: `point` is the distance from the axis and the height.
fn cone(point: Vec2, radius: f32, height: f32) -> f32 {
    let half = 0.5 * height;
    // Outward normal of the slanted side.
    let normal = Vec2::new(height, radius) / (height * height + radius * radius).sqrt();
    let tip = Vec2::new(0.0, half);
    // Nearest points on the side, from the tip to the rim, and on the bottom.
    let side = Vec2::new(radius, -height);
    let along = ((point - tip).dot(side) / side.length_squared()).clamp(0.0, 1.0);
    let to_side = (point - tip - along * side).length();
    let to_bottom = Vec2::new((point.x - radius).max(0.0), point.y + half).length();
    let is_inside = (point - tip).dot(normal) < 0.0 && point.y > -half;
    let nearest = to_side.min(to_bottom);
    if is_inside { -nearest } else { nearest }
}
