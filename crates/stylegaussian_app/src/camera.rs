//! A camera that orbits a point, looks around and flies. What it is steered by is the app's.

use std::f32::consts::FRAC_PI_2;

use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};

/// Vertical angle of view in radians, about that of a 60 mm lens.
pub const FIELD_OF_VIEW: f32 = 0.7;

/// The least width over height of a picture that a scene is framed for. A hidden window has none.
const NARROWEST: f32 = 0.1;

/// The nearest near plane that a world needs, in world units; less in a scene of less than a unit.
const NEAR: f32 = 0.02;

/// Position of the camera: at `distance` from `target`, in the direction given by `yaw` and `pitch` (radians).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    target: Vec3,
    distance: f32,
    yaw: f32,
    pitch: f32,
    /// The near plane.
    near: f32,
    /// Whether turning turns the eye and not the scene.
    is_within: bool,
}

impl Default for Orbit {
    fn default() -> Self {
        Self { target: Vec3::ZERO, distance: 10.0, yaw: 0.0, pitch: 0.35, near: NEAR, is_within: false }
    }
}

impl Orbit {
    /// Shows a ball whole, slightly from above, in a picture of this width over height.
    pub fn frame(center: Vec3, radius: f32, aspect: f32) -> Self {
        // At radius / sin(half the angle), a ball fills the narrower side exactly. Captures are seldom round,
        // so a little nearer.
        let half_angle = ((0.5 * FIELD_OF_VIEW).tan() * aspect.clamp(NARROWEST, 1.0)).atan();
        let distance = 0.85 * radius / half_angle.sin();
        Self { target: center, distance, near: NEAR * radius.min(1.0), ..default() }
    }

    /// Looks from within a place: from `eye` toward the side of `ahead`, level. `room` is the distance of what
    /// is near, in world units. From then on, turning looks around.
    pub fn within(eye: Vec3, ahead: Vec3, room: f32) -> Self {
        let back = eye - ahead;
        // The arc tangent of nothing is 0.
        let orbit = Self {
            distance: room,
            yaw: back.x.atan2(back.z),
            pitch: 0.0,
            near: NEAR * room.min(1.0),
            is_within: true,
            ..default()
        };
        Self { target: eye - orbit.rotation() * Vec3::Z * room, ..orbit }
    }

    fn rotation(&self) -> Quat {
        Quat::from_rotation_y(self.yaw) * Quat::from_rotation_x(-self.pitch)
    }

    /// The camera's place in the world.
    pub fn transform(&self) -> Transform {
        let rotation = self.rotation();
        Transform::from_translation(self.target + rotation * Vec3::Z * self.distance).with_rotation(rotation)
    }

    /// The point in the middle of the view, which the camera turns around, in world space.
    pub fn target(&self) -> Vec3 {
        self.target
    }

    /// The distance from there, in world units.
    pub fn distance(&self) -> f32 {
        self.distance
    }

    /// The camera's direction to the right, in world space.
    pub fn right(&self) -> Dir3 {
        Dir3::new(self.rotation() * Vec3::X).unwrap_or(Dir3::X)
    }

    /// Turns around the target by angles in radians; from within a place, [looks](Self::look) around.
    pub fn turn(&mut self, yaw: f32, pitch: f32) {
        if self.is_within {
            self.look(yaw, pitch);
        } else {
            self.turn_around(yaw, pitch);
        }
    }

    /// Turns around the target.
    fn turn_around(&mut self, yaw: f32, pitch: f32) {
        self.yaw += yaw;
        // Not quite the poles, where left and right would swap.
        self.pitch = (self.pitch + pitch).clamp(0.01 - FRAC_PI_2, FRAC_PI_2 - 0.01);
    }

    /// Looks around by angles in radians: the eye stays in its place, and the target moves around it.
    pub fn look(&mut self, yaw: f32, pitch: f32) {
        let eye = self.transform().translation;
        self.turn_around(yaw, pitch);
        self.target = eye - self.rotation() * Vec3::Z * self.distance;
    }

    /// Moves along the camera's own axes (right, up, back), in shares of the distance.
    pub fn fly(&mut self, shares: Vec3) {
        self.target += self.rotation() * shares * self.distance;
    }

    /// Multiplies the distance.
    pub fn zoom(&mut self, factor: f32) {
        self.distance *= factor;
    }
}

/// A camera for splats that orbits the origin.
pub fn splat_camera() -> impl Bundle {
    (
        Camera3d::default(),
        Projection::from(PerspectiveProjection { fov: FIELD_OF_VIEW, near: NEAR, ..default() }),
        // Splats have soft edges and nothing else is drawn, so multisampling would only take more time.
        Msaa::Off,
        Tonemapping::None,
        Orbit::default(),
    )
}

/// Places the camera and its near plane, which suits the size of the scene. It belongs before transforms are
/// propagated, or the camera would lag behind by a frame.
pub fn place_camera(camera: Single<(&Orbit, &mut Transform, &mut Projection)>) {
    let (orbit, mut transform, mut projection) = camera.into_inner();
    let near = match &*projection {
        Projection::Perspective(perspective) => Some(perspective.near),
        _ => None,
    };
    // Written only if it changes, as the transform below.
    if near.is_some_and(|near| near != orbit.near)
        && let Projection::Perspective(perspective) = &mut *projection
    {
        perspective.near = orbit.near;
    }
    // A transform that is written in each frame would count as changed and be propagated each time.
    transform.set_if_neq(orbit.transform());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_framed_ball_is_seen_whole_but_for_its_rim() {
        for aspect in [0.5, 2.0] {
            let orbit = Orbit::frame(Vec3::X, 2.0, aspect);
            let eye = orbit.transform();
            let seen = eye.compute_affine().inverse().transform_point3(Vec3::X);
            assert!(seen.truncate().length() < 1e-4 && seen.z < 0.0, "{seen}");
            // The rim of a ball of 0.85 times the radius touches the narrower side.
            let slope = (0.85 * 2.0 / -seen.z).asin().tan();
            let side = (0.5 * FIELD_OF_VIEW).tan() * f32::min(aspect, 1.0);
            assert!((slope / side - 1.0).abs() < 1e-4, "{slope} {side}");
        }
    }

    #[test]
    fn the_near_plane_follows_small_scenes() {
        for (radius, near) in [(100.0, 0.02), (1.0, 0.02), (1e-3, 2e-5)] {
            let found = Orbit::frame(Vec3::ZERO, radius, 1.0).near;
            assert!((found / near - 1.0_f32).abs() < 1e-6, "{radius}: {found}");
        }
    }

    /// A level view toward the middle, in which turning keeps the eye.
    #[test]
    fn a_view_from_within_looks_around() {
        let (eye, ahead) = (Vec3::new(1.0, 1.6, -2.0), Vec3::new(4.0, 9.0, -2.0));
        let mut orbit = Orbit::within(eye, ahead, 0.5);
        assert!(orbit.transform().translation.distance(eye) < 1e-5);
        assert!(orbit.transform().forward().distance(Vec3::X) < 1e-5);
        assert!((orbit.near / (0.5 * NEAR) - 1.0).abs() < 1e-6);
        orbit.turn(0.7, -0.3);
        assert!(orbit.transform().translation.distance(eye) < 1e-5);
        assert!(orbit.transform().forward().distance(Vec3::X) > 0.5);
        // Straight above what it looks at, any direction will do.
        assert!(Orbit::within(eye, eye - Vec3::Y, 1.0).transform().is_finite());
    }

    #[test]
    fn a_window_without_a_width_leaves_the_camera_usable() {
        for aspect in [0.0, -0.5] {
            assert!(Orbit::frame(Vec3::ZERO, 1.0, aspect).transform().is_finite());
        }
    }

    #[test]
    fn the_poles_are_never_crossed() {
        let mut orbit = Orbit::default();
        orbit.turn(0.0, 100.0);
        assert!(orbit.transform().up().y > 0.0);
        orbit.turn(1.0, -200.0);
        assert!(orbit.transform().up().y > 0.0);
    }

    #[test]
    fn turning_keeps_the_target_and_looking_keeps_the_eye() {
        let before = Orbit::frame(Vec3::new(1.0, 2.0, 3.0), 1.5, 1.0);
        let (mut turned, mut looking) = (before, before);
        turned.turn(0.3, -0.2);
        looking.look(0.3, -0.2);
        assert_eq!(turned.target(), before.target());
        let eye = |orbit: &Orbit| orbit.transform().translation;
        assert!(eye(&looking).distance(eye(&before)) < 1e-5);
        assert!(looking.target().distance(before.target()) > 0.1);
        assert_eq!(turned.transform().rotation, looking.transform().rotation);
    }

    #[test]
    fn flying_goes_along_the_axes_of_the_camera_and_zooming_toward_the_target() {
        // Seen from +x at the height of the target: -z is to the right, and x is back.
        let mut orbit = Orbit { distance: 4.0, yaw: FRAC_PI_2, pitch: 0.0, ..default() };
        assert!(orbit.right().distance(Vec3::NEG_Z) < 1e-6);
        orbit.fly(Vec3::new(0.5, 0.25, -1.0));
        assert!(orbit.target().distance(Vec3::new(-4.0, 1.0, -2.0)) < 1e-5, "{}", orbit.target());
        orbit.zoom(0.5);
        assert_eq!(orbit.distance(), 2.0);
        assert!(orbit.transform().translation.distance(Vec3::new(-2.0, 1.0, -2.0)) < 1e-5);
    }
}
