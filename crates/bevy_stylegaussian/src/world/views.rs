//! The cameras, as cuts see them: where they are, and where they are about to be.

use std::time::Duration;

use bevy::{
    camera::visibility::RenderLayers,
    ecs::{entity::EntityHashMap, system::SystemParam},
    math::Affine3A,
    prelude::*,
};
use stylegaussian::cut::CutView;

/// How far ahead a camera's motion is followed, in seconds: about as long as a file takes to be read and a part
/// of it to be shown.
const AHEAD: f32 = 0.5;

/// Share of a node's error that counts where a camera is expected and not there yet.
const EXPECTED: f32 = 0.5;

/// The largest angle by which a camera is expected to turn, in radians: with a usual field of view, what is
/// seen then borders on what is seen now.
const MAX_TURN: f32 = 1.0;

/// Height of the picture of a camera that has no target, as in a server.
const USUAL_HEIGHT: f32 = 1080.0;

/// A camera in the game.
type SeeingCamera =
    (Entity, &'static Camera, &'static Projection, &'static GlobalTransform, Option<&'static RenderLayers>);

/// The cameras and their motion.
#[derive(SystemParam)]
pub(super) struct Views<'w, 's> {
    cameras: Query<'w, 's, SeeingCamera, With<Camera3d>>,
    /// Where the cameras were at the last cut.
    places: Local<'s, EntityHashMap<Affine3A>>,
}

/// Views of a camera, and the layers that it sees.
pub(super) struct LayeredViews {
    pub(super) layers: RenderLayers,
    pub(super) views: Vec<CutView>,
}

impl Views<'_, '_> {
    /// The views of all active cameras, `passed` after the last call.
    pub(super) fn find(&mut self, passed: Duration) -> Vec<LayeredViews> {
        let mut places = EntityHashMap::default();
        let mut found = Vec::new();
        for (entity, camera, projection, place, layers) in &self.cameras {
            if !camera.is_active {
                continue;
            }
            let now = place.affine();
            let clip_from_view = projection.get_clip_from_view();
            let height = camera.physical_viewport_size().map_or(USUAL_HEIGHT, |size| size.y as f32);
            let mut views = vec![CutView::new(now, clip_from_view, height)];
            if let Some(before) = self.places.get(&entity).filter(|before| **before != now)
                && passed > Duration::ZERO
            {
                let next = expected(before, &now, AHEAD / passed.as_secs_f32());
                views.push(CutView::new(next, clip_from_view, height).weighted(EXPECTED));
            }
            places.insert(entity, now);
            found.push(LayeredViews { layers: layers.cloned().unwrap_or_default(), views });
        }
        *self.places = places;
        found
    }
}

/// The place after `steps` more steps like the one from `before` to `now`.
fn expected(before: &Affine3A, now: &Affine3A, steps: f32) -> Affine3A {
    let rotation = |place: &Affine3A| place.to_scale_rotation_translation().1;
    let (axis, angle) = (rotation(now) * rotation(before).inverse()).to_axis_angle();
    // The shorter way around.
    let angle = if angle > std::f32::consts::PI { angle - std::f32::consts::TAU } else { angle };
    let turn = Quat::from_axis_angle(axis, (steps * angle).clamp(-MAX_TURN, MAX_TURN));
    let at = now.translation + steps * (now.translation - before.translation);
    Affine3A::from_rotation_translation(turn * rotation(now), at.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_goes_on_as_it_went() {
        let place = |angle: f32, x: f32| {
            Affine3A::from_rotation_translation(Quat::from_rotation_y(angle), Vec3::new(x, 2.0, 0.0))
        };
        let close = |a: Affine3A, b: Affine3A| assert!(a.abs_diff_eq(b, 1e-4), "{a} {b}");
        close(expected(&place(0.1, 1.0), &place(0.2, 3.0), 2.0), place(0.4, 7.0));
        close(expected(&place(0.2, 1.0), &place(0.1, 1.0), 2.0), place(-0.1, 1.0));
        close(expected(&place(0.0, 1.0), &place(0.5, 1.0), 5.0), place(0.5 + MAX_TURN, 1.0));
        close(expected(&place(0.3, 1.0), &place(0.3, 1.0), 5.0), place(0.3, 1.0));
    }
}
