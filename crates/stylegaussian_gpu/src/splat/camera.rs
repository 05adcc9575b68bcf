//! Cameras of the splat pass, with any projection matrix.

use glam::{Affine3A, DAffine3, DVec3, Mat4, UVec2, UVec4, Vec2, Vec3, Vec4};
use stylegaussian::splat::half_size;

/// A camera: its place, its projection, and the part of the target that its picture takes.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// World from view; a rigid transform. View space is x right, y up, z backward.
    pub world_from_view: Affine3A,
    /// Clip from view: perspective, off-axis or orthographic; reverse z (depth 1 is near), far plane at any
    /// distance.
    pub clip_from_view: Mat4,
    /// The picture's left, top, width and height, in pixels of the target.
    pub viewport: UVec4,
}

/// The near plane of [`Camera::pinhole`], in shares of the distance up to which its pinhole draws nothing. It
/// only scales depths.
const PINHOLE_NEAR: f32 = 0.05;

impl Camera {
    /// The camera of the CPU rasterizer, with its picture at the target's top left corner. Settings with its
    /// `near` draw what it draws.
    pub fn pinhole(camera: &stylegaussian::Camera) -> Self {
        let size = camera.size.as_vec2();
        let scale = 2.0 * camera.focal / size;
        // The point where the image axis meets the picture, in normalized device coordinates.
        let axis = (2.0 * camera.center / size - 1.0) * Vec2::new(1.0, -1.0);
        let clip_from_view = Mat4::from_cols(
            Vec4::new(scale.x, 0.0, 0.0, 0.0),
            Vec4::new(0.0, scale.y, 0.0, 0.0),
            Vec4::new(-axis.x, -axis.y, 0.0, -1.0),
            // clip.z is the near plane and clip.w the distance: depth near / z, 1 at the near plane and 0 at
            // infinity.
            Vec4::new(0.0, 0.0, PINHOLE_NEAR * camera.near, 0.0),
        );
        // The CPU rasterizer's view space is x right, y down, z forward.
        let flipped = Affine3A::from_scale(Vec3::new(1.0, -1.0, -1.0));
        Self {
            world_from_view: camera.view_from_world.inverse() * flipped,
            clip_from_view,
            viewport: UVec4::new(0, 0, camera.size.x, camera.size.y),
        }
    }

    /// The camera of the same picture at half its width and height, rounded up, at the target's top left
    /// corner. Each pixel stands for two by two; the last ones of an odd width or height reach beyond the
    /// picture.
    pub(super) fn halved(&self) -> Self {
        let size = UVec2::new(self.viewport.z, self.viewport.w);
        let half = half_size(size);
        // The share of the larger picture that this one takes, from the top left: ndc x becomes (x + 1) share -
        // 1, and y becomes 1 - (1 - y) share.
        let share = size.as_vec2() / (2 * half).as_vec2();
        let onto = Mat4::from_cols(
            Vec4::new(share.x, 0.0, 0.0, 0.0),
            Vec4::new(0.0, share.y, 0.0, 0.0),
            Vec4::Z,
            Vec4::new(share.x - 1.0, 1.0 - share.y, 0.0, 1.0),
        );
        Self {
            world_from_view: self.world_from_view,
            clip_from_view: onto * self.clip_from_view,
            viewport: UVec4::new(0, 0, half.x, half.y),
        }
    }

    /// Whether the picture has pixels and all numbers are finite.
    pub(super) fn is_drawable(&self) -> bool {
        let finite = self.world_from_view.is_finite() && self.clip_from_view.is_finite();
        finite && self.viewport.z > 0 && self.viewport.w > 0
    }

    /// Whether rays are parallel.
    pub(super) fn is_orthographic(&self) -> bool {
        self.clip_from_view.row(3).truncate() == Vec3::ZERO
    }

    /// The point where view -z meets the picture, in normalized device coordinates. Orthographic cameras do not
    /// use it.
    pub(super) fn axis(&self) -> Vec2 {
        let ahead = self.clip_from_view * Vec4::new(0.0, 0.0, -1.0, 0.0);
        // Orthographic projections have w = 0 ahead, a direction.
        let axis = Vec2::new(ahead.x, ahead.y) / ahead.w;
        if axis.is_finite() { axis } else { Vec2::ZERO }
    }

    /// By how much the depth of a surface changes if it goes deeper by the size of a pixel there: x d + y at
    /// depth d.
    pub(super) fn depth_across_pixel(&self) -> [f32; 2] {
        // Along a ray, depth is d = (a z + b) / (c z + e), and changes by (a e - b c) / w^2 per unit of z, with
        // w = c z + e. A pixel is `in_ndc` w units high there.
        let in_ndc = 2.0 / (self.clip_from_view.y_axis.y * self.viewport.w as f32).abs();
        let (a, c) = (self.clip_from_view.z_axis.z, self.clip_from_view.z_axis.w);
        if self.is_orthographic() {
            return [0.0, in_ndc * a.abs()];
        }
        // Perspective: e = 0, and d = a / c + b / w.
        [in_ndc * c.abs(), -in_ndc * c.abs() * a / c]
    }

    /// View from a space that `world_from_scene` places in the world. The product is computed in f64, because
    /// far from the world's origin both factors are large and their product is not.
    pub(super) fn view_from(&self, world_from_scene: &Affine3A) -> Affine3A {
        let view_from_scene = in_f64(&self.world_from_view).inverse() * in_f64(world_from_scene);
        Affine3A::from_mat3_translation(
            view_from_scene.matrix3.as_mat3(),
            view_from_scene.translation.as_vec3(),
        )
    }

    /// Origin of the rays in a space that `world_from_scene` places in the world: (eye, 1), or (-direction, 0)
    /// if they are parallel.
    pub(super) fn eye_in(&self, world_from_scene: &Affine3A) -> Vec4 {
        let scene_from_view = in_f64(world_from_scene).inverse() * in_f64(&self.world_from_view);
        if self.is_orthographic() {
            scene_from_view.transform_vector3(DVec3::Z).as_vec3().normalize_or_zero().extend(0.0)
        } else {
            scene_from_view.translation.as_vec3().extend(1.0)
        }
    }
}

/// The same map in f64.
pub(super) fn in_f64(a: &Affine3A) -> DAffine3 {
    DAffine3::from_cols(
        a.matrix3.x_axis.as_dvec3(),
        a.matrix3.y_axis.as_dvec3(),
        a.matrix3.z_axis.as_dvec3(),
        a.translation.as_dvec3(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point projects to the same pixel through the matrix as through the pinhole.
    #[test]
    fn pinholes_keep_their_pixels() {
        let pinhole = stylegaussian::Camera {
            center: Vec2::new(30.0, 12.5),
            ..stylegaussian::Camera::look_at(
                Vec3::new(1.0, 2.0, -3.0),
                Vec3::ZERO,
                Vec3::Y,
                0.8,
                UVec2::new(64, 40),
            )
        };
        let point = Vec3::new(0.3, -0.2, 0.5);
        let seen = pinhole.view_from_world.transform_point3(point);
        let expected = pinhole.focal * seen.truncate() / seen.z + pinhole.center;

        let camera = Camera::pinhole(&pinhole);
        let view = camera.view_from(&Affine3A::IDENTITY).transform_point3(point);
        let clip = camera.clip_from_view * view.extend(1.0);
        let ndc = Vec2::new(clip.x, -clip.y) / clip.w;
        let found = (ndc + 1.0) / 2.0 * pinhole.size.as_vec2();
        assert!((found - expected).length() < 1e-4, "found {found}, expected {expected}");
        assert!((clip.w - seen.z).abs() < 1e-5);

        // A pixel higher is a surface deeper by the size of a pixel, at the same w.
        let pixel_size = seen.z / pinhole.focal.y;
        let depth = |seen: Vec3| {
            let clip = camera.clip_from_view * seen.extend(1.0);
            clip.z / clip.w
        };
        let (near, far) = (depth(view), depth(view - 0.01 * pixel_size * Vec3::Z));
        let [slope, offset] = camera.depth_across_pixel();
        let (found, expected) = (slope * near + offset, 100.0 * (near - far));
        assert!((found / expected - 1.0).abs() < 0.01, "found {found}, expected {expected}");

        // A picture of half the size has the point in the middle of the four pixels.
        let odd = Camera { viewport: UVec4::new(5, 7, 63, 41), ..camera.clone() };
        let (whole, half) = (odd.clip_from_view * view.extend(1.0), odd.halved());
        let pixel = |clip: Vec4, viewport: UVec4| {
            (Vec2::new(clip.x, -clip.y) / clip.w + 1.0) / 2.0
                * Vec2::new(viewport.z as f32, viewport.w as f32)
        };
        let found = pixel(half.clip_from_view * view.extend(1.0), half.viewport);
        assert!((2.0 * found - pixel(whole, odd.viewport)).length() < 1e-3, "{found}");
        assert_eq!(half.viewport, UVec4::new(0, 0, 32, 21));
        assert_eq!(camera.halved().clip_from_view, camera.clip_from_view);

        let principal = (camera.axis() * Vec2::new(1.0, -1.0) + 1.0) / 2.0 * pinhole.size.as_vec2();
        assert!((principal - pinhole.center).length() < 1e-4, "{principal}");
        assert!((camera.eye_in(&Affine3A::IDENTITY).truncate() - pinhole.position()).length() < 1e-5);
    }
}
