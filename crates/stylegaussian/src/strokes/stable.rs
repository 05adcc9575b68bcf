//! Strokes that keep their size on screen.
//!
//! Three octaves of the painting, each half as large as the one before, are crossfaded, as in dynamic solid
//! textures (Bénard, Bousseau and Thollot 2009). While the camera comes nearer by an octave, the largest goes
//! and a finer one comes, so that the mean size on screen stays; then the octaves are renamed, and nothing
//! jumps.

use glam::Vec3;

/// Octaves that are crossfaded.
pub const STABLE_OCTAVES: u32 = 3;

/// The middle octave at most, from near: a texel of it is a thousandth of one of the painting, at the limit of
/// single precision.
pub const NEAREST: f32 = 10.0;
/// The middle octave at least, from far: a stroke of it is as large as the painting.
pub const FARTHEST: f32 = -5.0;

/// Shares of the three octaves at a part of the way to the next octave, 0..1: a quadratic B-spline, whose mean
/// octave moves evenly. They are divided by the root of their squares' sum, since the octaves are all but
/// uncorrelated: contrast stays.
pub fn stable_shares(part: f32) -> Vec3 {
    let rest = 1.0 - part;
    Vec3::new(0.5 * rest * rest, 0.5 + part * rest, 0.5 * part * part).normalize()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{Quat, UVec2, Vec2};

    use super::*;
    use crate::{
        Camera, Scene,
        random::Random,
        splat::{Colors, render_strokes},
        strokes::{FINE_SIDE, PlainSeed, StrokeKnobs, StrokeTexture, StrokeWord, Strokes, WIDE_SIDE},
    };

    /// Noise in dabs of eight texels, in fine detail alone.
    fn dabs() -> StrokeTexture {
        let (mut random, n) = (Random::new(3), FINE_SIDE / 8);
        let values: Vec<f32> = (0..n * n).map(|_| 0.6 * (random.uniform() - 0.5)).collect();
        let at = |x: usize, y: usize| values[(y % n) * n + x % n];
        let fine = |i: usize| {
            let (x, y) = (i % FINE_SIDE, i / FINE_SIDE);
            let [u, v] = [x, y].map(|x| (x % 8) as f32 / 8.0);
            let row = |y: usize| at(x / 8, y) * (1.0 - u) + at(x / 8 + 1, y) * u;
            Vec3::splat(row(y / 8) * (1.0 - v) + row(y / 8 + 1) * v)
        };
        StrokeTexture::new(
            (0..FINE_SIDE * FINE_SIDE).map(fine).collect(),
            vec![Vec3::ZERO; WIDE_SIDE * WIDE_SIDE],
        )
    }

    /// A wall without end: one Gaussian. From a distance of 12, a pixel is a texel.
    struct Wall(Scene, Strokes);

    impl Wall {
        fn new() -> Self {
            let mut scene = Scene {
                means: vec![Vec3::ZERO],
                rotations: vec![Quat::IDENTITY],
                scales: vec![Vec3::new(400.0, 400.0, 1.0)],
                opacities: vec![0.9],
                order: vec![0],
                n_source: 1,
                ..Scene::default()
            };
            scene.set_colors(&[[0.5; 3]]);
            let seed = PlainSeed {
                at: Vec3::ZERO,
                right: Vec3::X,
                down: Vec3::Y,
                pitch: Vec2::splat(Self::camera(1.0).focal.x / 12.0),
                place: Vec2::new(300.0, 200.0),
                fine: 1.0,
                wide: 0.0,
                texture: 0,
            };
            let words = vec![StrokeWord { seed: 0, protection: 0.0, share: 1.0 }.packed()];
            Self(scene, Strokes { seeds: vec![seed.packed()], words, textures: vec![Arc::new(dabs())] })
        }

        fn camera(distance: f32) -> Camera {
            let eye = Vec3::new(0.0, 0.0, -distance);
            Camera::look_at(eye, Vec3::ZERO, Vec3::NEG_Y, 0.4, UVec2::splat(96))
        }

        /// The picture from a distance.
        fn from(&self, distance: f32, knobs: &StrokeKnobs) -> Vec<f32> {
            let camera = Self::camera(distance);
            let view = render_strokes(&self.0, Colors::Captured, (&self.1, knobs), &camera, None);
            view.color.iter().map(|color| color[0]).collect()
        }
    }

    fn rms(numbers: impl Iterator<Item = f32>) -> f32 {
        let (sum, n) = numbers.fold((0.0, 0), |(sum, n), x| (sum + x * x, n + 1));
        (sum / n as f32).sqrt()
    }

    /// The mean size of what is seen in a picture, up to a factor (Rice's formula), and its contrast.
    fn size_and_contrast(picture: &[f32]) -> (f32, f32) {
        let mean = picture.iter().sum::<f32>() / picture.len() as f32;
        let contrast = rms(picture.iter().map(|x| x - mean));
        (
            contrast / rms(picture.chunks(96).flat_map(|row| row.windows(2)).map(|pair| pair[1] - pair[0])),
            contrast,
        )
    }

    #[test]
    fn strokes_keep_their_size_over_a_dolly_of_32() {
        let wall = Wall::new();
        let range = |knobs: &StrokeKnobs| {
            let steps = (0..=20).map(|i| 1.5 * (0.25 * i as f32).exp2());
            let found: Vec<_> =
                steps.map(|distance| size_and_contrast(&wall.from(distance, knobs))).collect();
            let ratio = |of: fn(&(f32, f32)) -> f32| {
                let values = found.iter().map(of);
                values.clone().fold(0.0, f32::max) / values.fold(f32::INFINITY, f32::min)
            };
            (ratio(|found| found.0), ratio(|found| found.1))
        };
        let (size, contrast) = range(&StrokeKnobs { screen_stable: true, ..StrokeKnobs::DEFAULT });
        println!("size within {size:.2}, contrast within {contrast:.2}");
        assert!(size < 1.5 && contrast < 1.5, "{size} {contrast}");
        let (size, _) = range(&StrokeKnobs { near: 0.0, ..StrokeKnobs::DEFAULT });
        assert!(size > 4.0, "{size}: the test would not see it");
    }

    #[test]
    fn strokes_have_the_size_that_is_asked_for() {
        let wall = Wall::new();
        let size = |screen_stable: bool, stroke_scale: f32, distance: f32| {
            let knobs = StrokeKnobs { screen_stable, stroke_scale, ..StrokeKnobs::DEFAULT };
            size_and_contrast(&wall.from(distance, &knobs)).0
        };
        // From the usual distance they are as large as others.
        let usual = size(false, 1.0, 12.0);
        for (stroke_scale, distance) in [(1.0, 12.0), (1.0, 5.0), (2.0, 12.0), (2.0, 30.0), (0.7, 8.0)] {
            let found = size(true, stroke_scale, distance) / usual / stroke_scale;
            assert!((0.6..1.4).contains(&found), "{stroke_scale} from {distance}: {found}");
        }
    }

    /// Where octaves are renamed, a step of the camera changes no more than elsewhere.
    #[test]
    fn octaves_are_renamed_without_a_jump() {
        let wall = Wall::new();
        let knobs = StrokeKnobs { screen_stable: true, ..StrokeKnobs::DEFAULT };
        // From half of the usual distance on, an octave in steps of a fortieth.
        let pictures: Vec<_> = (0..=40).map(|i| wall.from(6.0 * (i as f32 / 40.0).exp2(), &knobs)).collect();
        let changes: Vec<f32> =
            pictures.windows(2).map(|pair| rms(pair[0].iter().zip(&pair[1]).map(|(a, b)| a - b))).collect();
        let mut sorted = changes.clone();
        sorted.sort_by(f32::total_cmp);
        let (median, most) = (sorted[20], sorted[39]);
        assert!(most < 2.0 * median, "{most} where {median} is usual: {changes:?}");
        // Any two octaves but neighbors would differ by far more.
        let apart = rms(pictures[0].iter().zip(&pictures[40]).map(|(a, b)| a - b));
        assert!(apart > 3.0 * median, "{apart} {median}");
    }

    #[test]
    fn shares_keep_contrast_and_the_mean_octave() {
        for i in 0..=10 {
            let part = i as f32 / 10.0;
            let shares = stable_shares(part);
            assert!((shares.length() - 1.0).abs() < 1e-6);
            let mean = shares.dot(Vec3::new(0.0, 1.0, 2.0)) / shares.element_sum();
            assert!((mean - (0.5 + part)).abs() < 1e-5, "{part}: {mean}");
        }
    }
}
