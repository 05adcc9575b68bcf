//! A small scene and a painting, both made up, and the shared test data.

use std::{
    env,
    path::{Path, PathBuf},
};

use glam::{Quat, UVec2, Vec3};
use stylegaussian::{Camera, Scene};

/// A folder of the shared test data, or `None`, reported loudly, if it is absent.
pub fn data(folder: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let path = env::var_os("STYLEGAUSSIAN_DATA").map_or_else(beside, PathBuf::from).join(folder);
    if !path.is_dir() {
        eprintln!("SKIPPED: {} is absent; STYLEGAUSSIAN_DATA names another place", path.display());
        return None;
    }
    Some(path)
}

/// A flat board of 16 x 16 opaque Gaussians of many colors.
pub fn board() -> Scene {
    const SIDE: usize = 16;
    let n = SIDE * SIDE;
    // Centered, so that both cameras look at the middle.
    let at = |i: usize| i as f32 - (SIDE - 1) as f32 / 2.0;
    let mut scene = Scene {
        means: (0..n).map(|i| Vec3::new(0.1 * at(i % SIDE), 0.0, 0.1 * at(i / SIDE))).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::new(0.1, 0.002, 0.1); n],
        opacities: vec![0.99; n],
        order: (0..n as u32).collect(),
        n_source: n,
        up: Some(Vec3::Y),
        ..Scene::default()
    };
    let shade = |i: usize, step: f32| 0.5 + 0.4 * (i as f32 * step).sin();
    scene.set_colors(&(0..n).map(|i| [shade(i, 0.31), shade(i, 0.17), shade(i, 0.05)]).collect::<Vec<_>>());
    scene
}

/// Two cameras that see the board from above.
pub fn cameras() -> [Camera; 2] {
    [0.0, 0.6].map(|x| Camera::look_at(Vec3::new(x, 2.0, 0.3), Vec3::ZERO, Vec3::Z, 0.9, UVec2::splat(64)))
}
