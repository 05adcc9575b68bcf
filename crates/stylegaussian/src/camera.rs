//! The pinhole camera.

use glam::{Affine3A, DAffine3, DMat3, DVec3, UVec2, Vec2, Vec3};

/// A pinhole camera. View space is x right, y down, z forward; u = focal.x x / z + center.x, in pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// View from world, a rigid transform.
    pub view_from_world: Affine3A,
    /// Focal lengths, in pixels.
    pub focal: Vec2,
    /// Principal point, in pixels from the picture's top left corner. Pixel centers lie at integer + 0.5.
    pub center: Vec2,
    /// Width and height, in pixels.
    pub size: UVec2,
    /// Gaussians at this view-space z or nearer are not drawn, in scene units. [`Camera::NEAR`] suits most
    /// scenes, and [`near_among`](Self::near_among) finds the one for a scene and a place.
    pub near: f32,
}

/// Most Gaussians of which a camera takes the depth. A quarter of them is found to half a hundredth of all.
const N_SAMPLE: usize = 10_000;

impl Camera {
    /// The usual [`near`](Self::near): that of the 3DGS rasterizer.
    pub const NEAR: f32 = 0.2;

    /// The [`near`](Self::near) before things `distance` scene units away: [`Camera::NEAR`] from 1 unit on, and
    /// a twentieth of shorter distances. In between it falls steadily.
    ///
    /// Captures in the units of structure from motion are some units across, and cameras see them from several
    /// times 0.2. In a small world, or close up in metres, that would cut everything.
    pub fn near_before(distance: f32) -> f32 {
        (distance / 20.0).max(Self::NEAR * distance * distance).min(Self::NEAR)
    }

    /// The same view with a [`near`](Self::near) that suits what it sees of a scene's `means`: a quarter of
    /// those in the picture are nearer than the distance that decides.
    pub fn near_among(&self, means: &[Vec3]) -> Self {
        let stride = means.len().div_ceil(N_SAMPLE).max(1);
        let mut depths: Vec<f32> = (means.iter().step_by(stride))
            .filter_map(|&mean| {
                let view: Vec3 = self.view_from_world.transform_point3(mean);
                let pixel = self.focal * view.truncate() / view.z + self.center;
                let is_inside = pixel.cmpge(Vec2::ZERO).all() && pixel.cmple(self.size.as_vec2()).all();
                (view.z > 0.0 && is_inside).then_some(view.z)
            })
            .collect();
        let quarter = depths.len() / 4;
        let near = if depths.is_empty() {
            Self::NEAR
        } else {
            Self::near_before(*depths.select_nth_unstable_by(quarter, f32::total_cmp).1)
        };
        Self { near, ..self.clone() }
    }

    /// Whether a scene can be seen with it: position, focal lengths and center are so far within the range of
    /// f32 that their squares are too.
    pub fn is_usable(&self) -> bool {
        const MOST: f32 = 1e18;
        let translation = Vec3::from(self.view_from_world.translation);
        let is_within = |v: Vec2| v.is_finite() && v.abs().max_element() < MOST;
        self.view_from_world.is_finite()
            && translation.abs().max_element() < MOST
            && is_within(self.focal)
            && is_within(self.center)
            && self.focal.min_element() > 1.0 / MOST
    }

    /// The camera's position in the world.
    pub fn position(&self) -> Vec3 {
        self.view_from_world.inverse().translation.into()
    }

    /// A camera from its pose in OpenGL axes (x right, y up, z *backward*), the convention of transforms.json.
    /// The pose must be rigid; `focal`, `center` and `size` are in pixels.
    pub fn from_opengl(world_from_camera: DAffine3, focal: Vec2, center: Vec2, size: UVec2) -> Self {
        // In f64: poses of captures may lie far from the origin, where the inverse in f32 would lose digits.
        let camera_from_view = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
        let view_from_world = (world_from_camera * camera_from_view).inverse();
        let rotation = view_from_world.matrix3.as_mat3();
        let translation = view_from_world.translation.as_vec3();
        let view_from_world = Affine3A::from_mat3_translation(rotation, translation);
        Self { view_from_world, focal, center, size, near: Self::NEAR }
    }

    /// The same view at another size in pixels. Focal lengths and center scale with it.
    pub fn resized(&self, size: UVec2) -> Self {
        // Positions count from the corner of the picture and not from the center of a pixel, so they scale
        // without an offset.
        let ratio = size.as_vec2() / self.size.as_vec2();
        Self { focal: self.focal * ratio, center: self.center * ratio, size, ..self.clone() }
    }

    /// The same view, with `side` pixels on its longer side.
    pub fn fitted(&self, side: u32) -> Self {
        let size = self.size.as_vec2() * (side as f32 / self.size.max_element().max(1) as f32);
        self.resized(size.round().as_uvec2().max(UVec2::ONE))
    }

    /// A camera at `eye` that looks at `target`. `up` is the world's up direction, and `fov_y` the full
    /// vertical angle in radians.
    pub fn look_at(eye: Vec3, target: Vec3, up: Vec3, fov_y: f32, size: UVec2) -> Self {
        let forward = (target - eye).normalize();
        let right = forward.cross(up).normalize();
        // x right, y down, z forward is right-handed: z cross x is y.
        let down = forward.cross(right);
        let world_from_view = Affine3A::from_cols(right.into(), down.into(), forward.into(), eye.into());
        let focal = size.y as f32 / (2.0 * (fov_y / 2.0).tan());
        Self {
            view_from_world: world_from_view.inverse(),
            focal: Vec2::splat(focal),
            center: size.as_vec2() / 2.0,
            size,
            near: Self::NEAR,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// OpenGL's identity pose looks along world -z with +y up: a point in front and above lands in the upper
    /// half.
    #[test]
    fn opengl_poses_look_backward_along_z() {
        let pose = DAffine3::from_translation(DVec3::new(0.0, 0.0, 5.0));
        let camera = Camera::from_opengl(pose, Vec2::splat(100.0), Vec2::splat(50.0), UVec2::splat(100));
        assert_eq!(camera.position(), Vec3::new(0.0, 0.0, 5.0));
        assert_eq!(
            camera.view_from_world.transform_point3(Vec3::new(1.0, 2.0, 1.0)),
            Vec3::new(1.0, -2.0, 4.0)
        );
    }

    #[test]
    fn look_at_puts_the_target_ahead_and_up_upward() {
        // The difference is (-3, 0, -4), of length 5.
        let (eye, target) = (Vec3::new(3.0, 1.0, 2.0), Vec3::new(0.0, 1.0, -2.0));
        let camera = Camera::look_at(eye, target, Vec3::Y, 1.0, UVec2::new(64, 32));
        let seen = camera.view_from_world.transform_point3(target);
        assert!((seen - Vec3::new(0.0, 0.0, 5.0)).length() < 1e-5, "{seen}");
        let above = camera.view_from_world.transform_point3(target + Vec3::Y);
        assert!((above - Vec3::new(0.0, -1.0, 5.0)).length() < 1e-5, "{above}");
        assert!((camera.position() - eye).length() < 1e-5);
    }

    #[test]
    fn near_follows_short_distances_alone() {
        for (distance, near) in [(1e4, 0.2), (1.0, 0.2), (0.5, 0.05), (0.25, 0.0125), (1e-4, 5e-6)] {
            let found = Camera::near_before(distance);
            assert!((found / near - 1.0).abs() < 1e-5, "{distance}: {found}");
        }
        let camera = Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, UVec2::splat(64));
        let of = |depths: &[f32]| {
            let means: Vec<Vec3> = depths.iter().map(|&z| Vec3::new(0.0, 0.0, z)).collect();
            camera.near_among(&means).near
        };
        // The quarter is the second of four. What is behind does not count.
        assert_eq!(of(&[-1e-3, -1e-2, 3.0, 0.01, 0.04, 9.0]), Camera::near_before(0.04));
        assert_eq!(of(&[0.1, 2.0, 3.0, 4.0]), 0.2);
        assert_eq!((of(&[]), of(&[-1.0])), (0.2, 0.2));
        // Beside the picture.
        assert_eq!(camera.near_among(&[Vec3::new(1.0, 0.0, 1e-3)]).near, 0.2);
    }
}
