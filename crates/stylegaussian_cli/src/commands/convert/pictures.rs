//! Pictures of a scene before and after.

use glam::UVec2;
use stylegaussian::{
    Scene,
    splat::{Colors, render},
    views::choose_views,
};

/// Number of views, the most useful ones first, and the size of their pictures.
const N_VIEWS: usize = 4;
const SIZE: UVec2 = UVec2::new(480, 360);

/// The peak signal-to-noise ratio of `written` in pictures of `scene` over black, in dB, or `None` if no pixel
/// differs or nothing can be seen.
pub fn psnr(scene: &Scene, written: &Scene) -> Option<f64> {
    let cameras = choose_views(scene, N_VIEWS, SIZE);
    let squares: f64 = cameras
        .iter()
        .map(|camera| {
            let [a, b] = [scene, written].map(|scene| render(scene, Colors::Captured, camera).color);
            let pairs = a.as_flattened().iter().zip(b.as_flattened());
            // As on a screen.
            let square = |(a, b): (&f32, &f32)| f64::from(a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)).powi(2);
            pairs.map(square).sum::<f64>()
        })
        .sum();
    let n = (cameras.len() * SIZE.element_product() as usize * 3) as f64;
    (squares > 0.0).then(|| 10.0 * (n / squares).log10())
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;

    /// One Gaussian that covers every picture: the pictures differ by a constant share of its alpha.
    #[test]
    fn a_gray_wall_by_hand() {
        let wall = |level: f32| {
            let mut scene = Scene {
                means: vec![Vec3::ZERO],
                rotations: vec![Quat::IDENTITY],
                scales: vec![Vec3::ONE],
                opacities: vec![1.0],
                order: vec![0],
                n_source: 1,
                ..Scene::default()
            };
            scene.set_colors(&[[level; 3]]);
            scene
        };
        assert_eq!(psnr(&wall(0.5), &wall(0.5)), None);
        assert_eq!(psnr(&Scene::default(), &Scene::default()), None);
        // Ten times the difference is 20 dB less.
        let [small, large] = [0.51, 0.6].map(|level| psnr(&wall(0.5), &wall(level)).unwrap());
        assert!((small - large - 20.0).abs() < 0.01, "{small} and {large} dB");
    }
}
