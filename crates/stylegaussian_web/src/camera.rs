//! The camera, as the page's script hears of it.

use bevy::prelude::*;
use stylegaussian_app::{FIELD_OF_VIEW, Orbit, Subject};

use crate::bridge;

/// Tells the page's script where the camera is.
pub fn note(camera: Single<&Orbit>, scene: Single<&Transform, With<Subject>>, window: Single<&Window>) {
    let scene_from_camera = scene.compute_affine().inverse() * camera.transform().compute_affine();
    bridge::note_camera(FIELD_OF_VIEW, window.physical_size(), scene_from_camera.into());
}
