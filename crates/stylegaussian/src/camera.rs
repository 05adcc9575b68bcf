//! The pinhole camera.

use glam::{Affine3A, UVec2, Vec2, Vec3};

/// A pinhole camera. View space is x right, y down, z forward; u = focal.x x / z + center.x, in pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// View from world; a rigid transform.
    pub view_from_world: Affine3A,
    /// Focal lengths, in pixels.
    pub focal: Vec2,
    /// Principal point, in pixels from the picture's top left corner. Pixel centers lie at integer + 0.5.
    pub center: Vec2,
    /// Width and height, in pixels.
    pub size: UVec2,
}

impl Camera {
    /// The camera's position in the world.
    pub fn position(&self) -> Vec3 {
        self.view_from_world.inverse().translation.into()
    }

    /// The same view at another size in pixels; intrinsics scale along.
    pub fn resized(&self, size: UVec2) -> Self {
        let ratio = size.as_vec2() / self.size.as_vec2();
        Self { focal: self.focal * ratio, center: self.center * ratio, size, ..self.clone() }
    }

    /// A camera at `eye` that looks at `target`. `up` is the world's up direction; `fov_y` the full vertical angle in
    /// radians.
    pub fn look_at(eye: Vec3, target: Vec3, up: Vec3, fov_y: f32, size: UVec2) -> Self {
        let forward = (target - eye).normalize();
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        let world_from_view =
            Affine3A::from_cols(right.into(), down.into(), forward.into(), eye.into());
        let focal = size.y as f32 / (2.0 * (fov_y / 2.0).tan());
        Self {
            view_from_world: world_from_view.inverse(),
            focal: Vec2::splat(focal),
            center: size.as_vec2() / 2.0,
            size,
        }
    }
}
