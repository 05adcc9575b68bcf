//! A camera that orbits a point. The page's script reads mouse, touch and keys, and says by how much.

use std::f32::consts::FRAC_PI_2;

use bevy::prelude::*;
use bevy_stylegaussian::GaussianSplats;

use crate::bridge::{self, Request};

/// Vertical angle of view in radians.
pub const FIELD_OF_VIEW: f32 = 0.7;

/// Position of the camera: at `distance` from `target`, in the direction given by `yaw` and `pitch` (radians).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    target: Vec3,
    distance: f32,
    yaw: f32,
    pitch: f32,
}

impl Default for Orbit {
    fn default() -> Self {
        Self { target: Vec3::ZERO, distance: 10.0, yaw: 0.0, pitch: 0.35 }
    }
}

impl Orbit {
    /// Shows a ball whole, slightly from above, in a picture of this width over height.
    pub fn frame(center: Vec3, radius: f32, aspect: f32) -> Self {
        // At radius / sin(half the angle), a ball fills the narrower side exactly. Captures are seldom round,
        // so a little nearer.
        let half_angle = ((0.5 * FIELD_OF_VIEW).tan() * aspect.min(1.0)).atan();
        Self { target: center, distance: 0.85 * radius / half_angle.sin(), ..default() }
    }

    fn rotation(&self) -> Quat {
        Quat::from_rotation_y(self.yaw) * Quat::from_rotation_x(-self.pitch)
    }

    /// The camera's place in the world.
    pub fn transform(&self) -> Transform {
        let rotation = self.rotation();
        Transform::from_translation(self.target + rotation * Vec3::Z * self.distance).with_rotation(rotation)
    }

    /// The point that the camera turns around, in world space.
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

    /// Turns around the target by angles in radians.
    pub fn turn(&mut self, yaw: f32, pitch: f32) {
        self.yaw += yaw;
        // Not quite the poles, where left and right would swap.
        self.pitch = (self.pitch + pitch).clamp(0.01 - FRAC_PI_2, FRAC_PI_2 - 0.01);
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

/// Turns, moves and zooms as asked.
pub fn turn(mut requests: MessageReader<Request>, mut orbit: Single<&mut Orbit>) {
    for request in requests.read() {
        match *request {
            Request::Turn { yaw, pitch } => orbit.turn(yaw, pitch),
            Request::Fly(shares) => orbit.fly(shares),
            Request::Zoom(factor) => orbit.zoom(factor),
            _ => {}
        }
    }
}

/// Places the camera.
pub fn place(camera: Single<(&Orbit, &mut Transform)>) {
    let (orbit, mut transform) = camera.into_inner();
    // A transform that is written in each frame would count as changed and be propagated each time.
    transform.set_if_neq(orbit.transform());
}

/// Tells the page's script where the camera is.
pub fn note(
    camera: Single<&Orbit>,
    scene: Single<&Transform, With<GaussianSplats>>,
    window: Single<&Window>,
) {
    let scene_from_camera = scene.compute_affine().inverse() * camera.transform().compute_affine();
    bridge::note_camera(FIELD_OF_VIEW, window.physical_size(), scene_from_camera.into());
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
    fn the_poles_are_never_crossed() {
        let mut orbit = Orbit::default();
        orbit.turn(0.0, 100.0);
        assert!(orbit.transform().up().y > 0.0);
        orbit.turn(1.0, -200.0);
        assert!(orbit.transform().up().y > 0.0);
    }
}
