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

    /// Pixels of a box on the left in all views, a tenth of a second after the last call.
    fn pixels(mut views: Views) -> Vec<f32> {
        let at = 10.0 * Vec3::new(-0.8_f32.sin(), 0.0, -0.8_f32.cos());
        let found = views.find(Duration::from_millis(100));
        found.iter().flat_map(|views| &views.views).map(|view| view.pixels([at - 0.1, at + 0.1])).collect()
    }

    #[test]
    fn what_a_camera_turns_to_is_seen_before_it_is_there() {
        let mut world = World::new();
        let camera = world.spawn(Camera3d::default()).id();
        let mut after = |angle: f32| {
            let place = Transform::from_rotation(Quat::from_rotation_y(angle));
            world.entity_mut(camera).insert(GlobalTransform::from(place));
            world.run_system_cached(pixels).unwrap()
        };
        // 45 degrees wide: to 0.39 rad on the left.
        assert_eq!(after(0.0), [0.0]);
        assert_eq!(after(0.0), [0.0], "one view of a camera that stands still");
        // It turns by 1 rad per second, and sees from 0.21 to 0.99 rad in half a second.
        let turning = after(0.1);
        assert!(turning.len() == 2 && turning[0] == 0.0 && turning[1] > 0.0, "{turning:?}");
        // There, it counts twice as much.
        let there = after(0.6);
        assert!((there[0] - 2.0 * turning[1]).abs() < 1e-3 * there[0], "{there:?}");
    }
}
