//! The difference of a frame from the reference: the CPU's splatting in f32, sorted exactly.

use glam::{Affine3A, UVec2, Vec2, Vec3};
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, render},
};

/// Least coverage of a pixel that counts: the background then shows less than half a step of 255. On other
/// pixels the pictures differ because one blends the background in the display's space and the other in linear
/// light.
const COVERED: f32 = 0.998;

/// Displayed red, green and blue `[H, W]` of `scene`, or `None` if it does not cover the pixel.
/// `world_from_view` is a pose that looks along -z with y up, and `fov` the vertical field of view in radians.
pub fn reference(
    scene: &Scene,
    world_from_view: Affine3A,
    fov: f32,
    [width, height]: [u32; 2],
) -> Vec<Option<[u8; 3]>> {
    let size = UVec2::new(width, height);
    let camera = Camera {
        // Its views look along z with y down.
        view_from_world: Affine3A::from_scale(Vec3::new(1.0, -1.0, -1.0)) * world_from_view.inverse(),
        focal: Vec2::splat(0.5 * height as f32 / (0.5 * fov).tan()),
        center: 0.5 * size.as_vec2(),
        size,
        near: Camera::NEAR,
    };
    let view = render(scene, Colors::Captured, &camera);
    let displayed = |color: &[f32; 3]| color.map(|channel| (255.0 * channel.clamp(0.0, 1.0)).round() as u8);
    let pixels = view.color.iter().zip(&view.alpha);
    pixels.map(|(color, &alpha)| (alpha >= COVERED).then(|| displayed(color))).collect()
}

/// Peak signal-to-noise ratio of a picture, in dB, over the pixels that the reference covers. Infinite if they
/// are equal.
pub fn psnr(found: &[[u8; 3]], expected: &[Option<[u8; 3]>]) -> f64 {
    let covered = || found.iter().zip(expected).filter_map(|(found, expected)| Some((found, (*expected)?)));
    let square = |(a, b): (&u8, u8)| (f64::from(*a) - f64::from(b)).powi(2);
    let sum: f64 =
        covered().map(|(found, expected)| found.iter().zip(expected).map(square).sum::<f64>()).sum();
    // 0 if nothing differs: the logarithm is then infinite.
    let mean = sum / (3 * covered().count().max(1)) as f64;
    10.0 * (255.0 * 255.0 / mean).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_by_hand() {
        // One channel of six is off by 51: the mean square is 433.5.
        let expected = [Some([0, 0, 0]), None, Some([9, 9, 9])];
        let found = psnr(&[[0, 0, 51], [99, 99, 99], [9, 9, 9]], &expected);
        assert!((found - 10.0 * (65_025.0_f64 / 433.5).log10()).abs() < 1e-9, "{found}");
        assert_eq!(psnr(&[[7, 8, 9]], &[Some([7, 8, 9])]), f64::INFINITY);
    }

    /// Two red Gaussians in one position, to the right of a camera's axis and above it.
    #[test]
    fn the_reference_looks_where_the_frame_does() {
        let red = stylegaussian::sh::dc_from_color([1.0, 0.0, 0.0]);
        let scene = Scene {
            means: vec![Vec3::new(0.5, 0.5, -5.0); 2],
            rotations: vec![glam::Quat::IDENTITY; 2],
            scales: vec![Vec3::splat(0.1); 2],
            opacities: vec![0.99; 2],
            sh: Some(stylegaussian::scene::Sh { degree: 0, coefficients: red.repeat(2) }),
            order: vec![0, 1],
            n_source: 2,
            ..Scene::default()
        };
        let picture = reference(&scene, Affine3A::IDENTITY, std::f32::consts::FRAC_PI_4, [64, 64]);
        let covered: Vec<usize> = (0..64 * 64).filter(|i| picture[*i].is_some()).collect();
        assert!(covered.iter().all(|i| picture[*i].is_some_and(|[r, g, b]| r > 250 && g + b == 0)));
        let mean = |of: fn(usize) -> usize| {
            covered.iter().map(|i| of(*i) as f32 + 0.5).sum::<f32>() / covered.len() as f32
        };
        // A tenth of the distance is 7.7 pixels of half a picture's 32, which 22.5 degrees see.
        let (x, y) = (mean(|i| i % 64), mean(|i| i / 64));
        assert!((x - 39.7).abs() < 0.5 && (y - 24.3).abs() < 0.5, "{x}, {y}");
    }
}
