//! A lasso in the view of a Bevy camera.

use bevy::{
    math::{Affine3A, Mat3A, Vec3A},
    prelude::*,
};
use stylegaussian::{Camera as Pinhole, mask::Lasso};

/// The lasso along `polygon` over the view of a camera, around the splats of an entity with the transform
/// `splats`.
///
/// Points are in logical pixels of the render target, as [`Window::cursor_position`] gives them. Depths
/// ([`Lasso::with_depths`]) are world units along the camera's axis. `None` if the camera has no picture yet,
/// or no perspective.
pub fn lasso_in_view(
    camera: &Camera,
    camera_transform: &GlobalTransform,
    splats: &GlobalTransform,
    polygon: &[Vec2],
) -> Option<Lasso> {
    let rect = camera.logical_viewport_rect()?;
    let clip_from_view = camera.clip_from_view();
    // Perspective projections divide by -z.
    if clip_from_view.w_axis.w != 0.0 || clip_from_view.z_axis.w != -1.0 {
        return None;
    }
    // Bevy's views have y up and z backward, pinhole cameras y down and z forward.
    let pinhole_from_view = Mat3A::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
    let view_from_scene = camera_transform.affine().inverse() * splats.affine();
    let half = 0.5 * rect.size();
    let axis = clip_from_view.z_axis;
    let camera = Pinhole {
        view_from_world: Affine3A::from_mat3_translation(pinhole_from_view.into(), Vec3A::ZERO.into())
            * view_from_scene,
        focal: half * Vec2::new(clip_from_view.x_axis.x, clip_from_view.y_axis.y),
        // Off-axis projections move the axis: in normalized device coordinates, y up, it is at minus these.
        center: rect.min + half + half * Vec2::new(-axis.x, axis.y),
        size: rect.size().as_uvec2(),
        // A lasso draws nothing.
        near: Pinhole::NEAR,
    };
    Some(Lasso::new(camera, polygon))
}
