//! The camera, as the page's script steers it: that reads mouse, touch and keys, and says by how much.

use bevy::prelude::*;
use stylegaussian_app::{FIELD_OF_VIEW, Orbit, Subject};

use crate::bridge::{self, Request};

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

/// Tells the page's script where the camera is.
pub fn note(camera: Single<&Orbit>, scene: Single<&Transform, With<Subject>>, window: Single<&Window>) {
    let scene_from_camera = scene.compute_affine().inverse() * camera.transform().compute_affine();
    bridge::note_camera(FIELD_OF_VIEW, window.physical_size(), scene_from_camera.into());
}
