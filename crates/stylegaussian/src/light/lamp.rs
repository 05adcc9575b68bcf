//! Shadows of spot lights and point lights on splats.
//!
//! A capture is not lit by the game's lights, so a shadow takes from it by an amount that the game sets, and as
//! far as the lamp reaches: within its range and its cone, with the soft ends that its light on meshes has. The
//! fall of light with the square of the distance is left out: the capture is as bright everywhere.

use glam::{Affine3A, Vec3};

/// Lamps whose shadows a view's splats receive at most; further ones are left out.
pub const MAX_LAMPS: usize = 8;

/// A spot light or a point light with shadow maps, of points in some space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowLamp {
    /// The lamp's space from the space of points; rigid. A spot light shines along -z. Point lights have the
    /// axes of their maps.
    pub light_from_point: Affine3A,
    /// Distance at which its light ends.
    pub range: f32,
    /// Near plane of its maps, from which on depth is this over the distance along the map's axis.
    pub near: f32,
    /// Step toward the lamp before the comparison.
    pub depth_bias: f32,
    /// The same for each unit of the distance along the map's axis.
    pub normal_bias: f32,
    /// The cone of a spot light; `None` for a point light.
    pub cone: Option<Cone>,
    /// The number of its map, or of its cube of maps.
    pub map: u32,
}

/// The cone of a spot light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Angle from the axis up to which its light is whole, in radians.
    pub inner: f32,
    /// Angle from the axis at which its light ends, in radians, less than a quarter of a turn.
    pub outer: f32,
}

impl Cone {
    /// Scale and offset that make the root of the light's share, where it is in 0..1, of the cosine of an angle
    /// from the axis.
    pub fn scale_and_offset(&self) -> [f32; 2] {
        // Not below what Bevy's lights have.
        let scale = 1.0 / (self.inner.cos() - self.outer.cos()).max(1e-4);
        [scale, -scale * self.outer.cos()]
    }
}

impl ShadowLamp {
    /// The share of the lamp's reach that a point is within, 0..1, and the depth that is compared with its
    /// maps: the point is in the light if that is not less. `None` beyond its reach.
    pub fn reach(&self, point: Vec3) -> Option<(f32, f32)> {
        let at = self.light_from_point.transform_point3(point);
        let distance = at.length();
        let window = (1.0 - (distance / self.range).powi(4)).clamp(0.0, 1.0);
        let (along, cone) = match self.cone {
            None => (at.abs().max_element(), 1.0),
            Some(cone) => {
                let [scale, offset] = cone.scale_and_offset();
                (-at.z, (-at.z / distance * scale + offset).clamp(0.0, 1.0))
            }
        };
        let share = (window * cone).powi(2);
        // Splats have no normal, so both biases lead to the lamp. The step does not leave the pixel of the map.
        let step = (self.depth_bias + self.normal_bias * along) / distance;
        let along = along * (1.0 - step);
        // Before the near plane nothing is in shadow.
        (share > 0.0 && along > self.near).then(|| (share, self.near / along))
    }
}
