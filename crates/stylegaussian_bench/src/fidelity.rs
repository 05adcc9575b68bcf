//! How near a frame comes to the reference: the CPU's splatting in f32, sorted exactly.

use glam::{Affine3A, UVec2, Vec2, Vec3};
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, render},
};

/// Displayed red, green and blue `[H, W]` of `scene` over black, from `world_from_view`, a pose that looks along -z with y up,
/// and with the vertical field of view `fov` in radians.
pub fn reference(
    scene: &Scene,
    world_from_view: Affine3A,
    fov: f32,
    [width, height]: [u32; 2],
) -> Vec<[u8; 3]> {
    let size = UVec2::new(width, height);
    let camera = Camera {
        // Its views look along z with y down.
        view_from_world: Affine3A::from_scale(Vec3::new(1.0, -1.0, -1.0)) * world_from_view.inverse(),
        focal: Vec2::splat(0.5 * height as f32 / (0.5 * fov).tan()),
        center: 0.5 * size.as_vec2(),
        size,
    };
    let view = render(scene, Colors::Sh, &camera);
    view.color
        .iter()
        .map(|color| color.map(|channel| (255.0 * channel.clamp(0.0, 1.0)).round() as u8))
        .collect()
}

/// Peak signal-to-noise ratio of two pictures, in dB; infinite where they are equal.
pub fn psnr(a: &[[u8; 3]], b: &[[u8; 3]]) -> f64 {
    let square = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
    let sum: f64 = a.as_flattened().iter().zip(b.as_flattened()).map(square).sum();
    let mean = sum / a.as_flattened().len().max(1) as f64;
    10.0 * (255.0 * 255.0 / mean).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_by_hand() {
        // One channel of six is off by 51: the mean square is 433.5.
        let found = psnr(&[[0, 0, 51], [9, 9, 9]], &[[0, 0, 0], [9, 9, 9]]);
        assert!((found - 10.0 * (65_025.0_f64 / 433.5).log10()).abs() < 1e-9, "{found}");
        assert_eq!(psnr(&[[7, 8, 9]], &[[7, 8, 9]]), f64::INFINITY);
    }

    /// A red Gaussian to the right of a camera's axis and above it.
    #[test]
    fn the_reference_looks_where_the_frame_does() {
        let rgb = [1.0, 0.0, 0.0];
        let scene = Scene {
            means: vec![Vec3::new(0.5, 0.5, -5.0)],
            rotations: vec![glam::Quat::IDENTITY],
            scales: vec![Vec3::splat(0.1)],
            opacities: vec![0.9],
            sh: Some(stylegaussian::scene::Sh {
                degree: 0,
                coefficients: stylegaussian::sh::dc_from_color(rgb).to_vec(),
            }),
            order: vec![0],
            n_source: 1,
            ..Scene::default()
        };
        let picture = reference(&scene, Affine3A::IDENTITY, std::f32::consts::FRAC_PI_4, [64, 64]);
        let brightest = (0..64 * 64).max_by_key(|i| picture[*i][0]).unwrap();
        // 0.1 of the distance is 7.7 of 64 pixels at 45 degrees.
        assert!(
            (39..=40).contains(&(brightest % 64)) && (23..=24).contains(&(brightest / 64)),
            "{brightest}"
        );
    }
}
