//! Random strokes for the tests of the splat pass.

#![allow(dead_code, reason = "each test file uses a part")]

use std::sync::Arc;

use glam::{Quat, Vec2, Vec3};
use stylegaussian::{
    Scene,
    strokes::{FINE_SIDE, MAX_GAIN, PERIOD, PlainSeed, StrokeTexture, StrokeWord, Strokes, WIDE_SIDE},
};

use crate::pictures::randoms;

/// A texture of noise.
pub fn texture(seed: u64) -> Arc<StrokeTexture> {
    let mut random = randoms(seed);
    let mut noise = |side: usize| -> Vec<Vec3> {
        (0..side * side).map(|_| 0.6 * Vec3::from_array([(); 3].map(|()| random() - 0.5))).collect()
    };
    let fine = noise(FINE_SIDE);
    Arc::new(StrokeTexture::new(fine, noise(WIDE_SIDE)))
}

/// Strokes of `scene` in `textures`, of about `pitch` texels to a scene unit, with a seed for every fourth
/// Gaussian. A sixth of the Gaussians shows none.
pub fn strokes(scene: &Scene, textures: &[Arc<StrokeTexture>], pitch: f32, seed: u64) -> Strokes {
    let mut random = randoms(seed);
    let n_seeds = scene.len().div_ceil(4);
    let seeds = (0..n_seeds).map(|i| {
        let mut three = || Vec3::from_array([(); 3].map(|()| random() - 0.5));
        let turn = Quat::from_axis_angle(three().normalize(), 6.0 * three().x);
        let at = scene.means[(4 * i).min(scene.len() - 1)] + 0.1 * three();
        let place = PERIOD * (three().truncate() + 0.5);
        let pitch = pitch * Vec2::new(0.5 + random(), 0.5 + random());
        let seed = PlainSeed {
            at,
            right: turn * Vec3::X,
            down: turn * Vec3::Y,
            pitch,
            place,
            // Some have fine detail only, some wide detail only, and some neither.
            fine: (MAX_GAIN * (random() - 0.2)).max(0.0),
            wide: (MAX_GAIN * (random() - 0.2)).max(0.0),
            texture: (random() * textures.len() as f32) as u8,
        };
        seed.packed()
    });
    let seeds = seeds.collect();
    let words = (0..scene.len()).map(|i| {
        let share = (1.2 * random() - 0.2).clamp(0.0, 1.0);
        StrokeWord { seed: i as u32 / 4, protection: random().powi(2), share }.packed()
    });
    Strokes { seeds, words: words.collect(), textures: textures.to_vec() }
}
