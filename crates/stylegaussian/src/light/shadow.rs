//! Shadows of meshes on splats: which map a splat is compared with, and where.

use glam::{Mat4, Vec3, Vec4};

/// Shadow maps of a directional light at most, as in Bevy.
pub const MAX_CASCADES: usize = 4;

/// One of a directional light's shadow maps, and the part of the view that it is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowCascade {
    /// The map's clip space from the space of points; reverse z.
    pub clip_from_point: Mat4,
    /// Step toward the light before the comparison, in the space of points.
    pub offset: Vec3,
    /// View depth up to which the map counts.
    pub far: f32,
}

impl ShadowCascade {
    /// The cascade for a view depth among those from near to far, by its number.
    pub fn at(cascades: &[Self], depth: f32) -> Option<usize> {
        cascades.iter().take(MAX_CASCADES).position(|cascade| depth < cascade.far)
    }

    /// The place of a point in the map, 0..1 from the left, 0..1 from the top, and its depth, which is in the
    /// light if it is not less than the map's. `None` outside of the map, where there is light.
    pub fn place(&self, point: Vec3) -> Option<Vec3> {
        let clip: Vec4 = self.clip_from_point * (point + self.offset).extend(1.0);
        let ndc = clip.truncate() / clip.w;
        let is_inside = ndc.x.abs() <= 1.0 && ndc.y.abs() <= 1.0 && (0.0..=1.0).contains(&ndc.z);
        is_inside.then(|| Vec3::new(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y, ndc.z))
    }
}

/// The share of the light that reaches a splat that loses `amount` of it in shadow, if `sunlight` is the share
/// of the sun's that reaches it.
pub fn in_shadow(amount: f32, sunlight: f32) -> f32 {
    1.0 - amount * (1.0 - sunlight)
}
