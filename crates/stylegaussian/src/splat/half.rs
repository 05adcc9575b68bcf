//! Pictures that are drawn at half their width and height, and brought to the whole by the depth of meshes.
//!
//! A *low* pixel stands for two by two pixels. Its splats are widened as much as a pixel of its size asks for,
//! and keep the sum over the picture that they have in the whole one: what is thin becomes fainter, as the mean
//! of two by two pixels does.
//!
//! A low pixel is tested against one depth: by turns, as on a chessboard, against the farthest of its pixels
//! and against the nearest. So the four low pixels around any pixel have seen both sides of an edge that runs
//! through them. The pixel takes them by their distance, and by whether they were tested against the surface
//! that it shows itself (Kopf et al., "Joint Bilateral Upsampling", 2007).

use glam::{IVec2, UVec2};

use super::{Colors, RenderedImage, draw};
use crate::{camera::Camera, scene::Scene};

/// Depths from here on are no surface: nothing is before the near plane.
const NO_SURFACE: f32 = 1.0;
/// The least difference of depths that counts, so that nothing is divided by 0 where both are infinitely far.
const LEAST_TOLERANCE: f32 = 1e-30;

/// The size of the low picture, in pixels.
pub fn half_size(size: UVec2) -> UVec2 {
    size.map(|side| side.div_ceil(2))
}

/// Draws `scene` at half the width and height of `camera`'s picture, rounded up.
///
/// # Panics
/// If `colors` holds another number of colors than the scene has Gaussians.
pub fn render_half(scene: &Scene, colors: Colors, camera: &Camera) -> RenderedImage {
    let half = Camera {
        focal: camera.focal / 2.0,
        center: camera.center / 2.0,
        size: half_size(camera.size),
        ..camera.clone()
    };
    draw(scene, colors, None, (&half, true), None)
}

/// The depths `[h, w]` that low pixels are tested against, reverse z. `farther` and `nearer` are those of the
/// pixels' meshes `[H, W]` on either side of edges; both are the same without several samples per pixel, and
/// `nearer` is 1 where there is only one side. `size` is (W, H).
///
/// # Panics
/// If there are fewer depths than pixels.
pub fn half_depths(farther: &[f32], nearer: &[f32], size: UVec2) -> Vec<f32> {
    let (low, last) = (half_size(size), size.as_ivec2() - 1);
    let depth = |x: u32, y: u32| {
        let (mut nearest, mut farthest) = (0.0_f32, NO_SURFACE);
        for i in 0..4 {
            let pixel = (2 * UVec2::new(x, y).as_ivec2() + IVec2::new(i & 1, i >> 1)).min(last);
            let at = (pixel.y * size.x as i32 + pixel.x) as usize;
            farthest = farthest.min(farther[at]);
            nearest = nearest.max(if nearer[at] >= NO_SURFACE { farther[at] } else { nearer[at] });
        }
        if (x + y) % 2 == 1 { nearest } else { farthest }
    };
    (0..low.y).flat_map(|y| (0..low.x).map(move |x| (x, y))).map(|(x, y)| depth(x, y)).collect()
}

/// The whole picture `[H, W]` of the low one, premultiplied. `low` are its texels and the [depths](half_depths)
/// that they were tested against `[h, w]`, `depths` those of the pixels themselves. Depths that differ by much
/// more than x d + y, with x and y those of `limit`, at depth d are those of two surfaces. Pixels of depth 1
/// and nearer are empty.
///
/// # Panics
/// If there are fewer texels or depths than pixels.
pub fn upsampled(low: (&[[f32; 4]], &[f32]), depths: &[f32], size: UVec2, limit: [f32; 2]) -> Vec<[f32; 4]> {
    let last = half_size(size).as_ivec2() - 1;
    let texel = |pixel: IVec2| {
        let depth = depths[(pixel.y * size.x as i32 + pixel.x) as usize];
        if depth >= NO_SURFACE {
            return [0.0; 4];
        }
        // The other column and row of low pixels are those before even pixels, and behind odd ones.
        let own = pixel / 2;
        let other = (own + 2 * (pixel & 1) - 1).clamp(IVec2::ZERO, last);
        let (mut sum, mut weights) = ([0.0; 4], 0.0);
        for (at, share) in [
            (own, 9.0 / 16.0),
            (IVec2::new(other.x, own.y), 3.0 / 16.0),
            (IVec2::new(own.x, other.y), 3.0 / 16.0),
            (other, 1.0 / 16.0),
        ] {
            let at = (at.y * (last.x + 1) + at.x) as usize;
            let weight = share * agreement(depth, low.1[at], limit);
            sum.iter_mut().zip(low.0[at]).for_each(|(sum, value)| *sum += weight * value);
            weights += weight;
        }
        sum.map(|value| value / weights)
    };
    let rows = 0..size.y as i32;
    rows.flat_map(|y| (0..size.x as i32).map(move |x| IVec2::new(x, y))).map(texel).collect()
}

/// The agreement of two depths, 1 if they are equal. Of two surfaces it is so small that only a pixel without
/// any other takes them, but never 0.
fn agreement(a: f32, b: f32, limit: [f32; 2]) -> f32 {
    let tolerance = (limit[0] * a.max(b) + limit[1]).max(LEAST_TOLERANCE);
    let off = (a - b) / tolerance;
    // No exponential: that would be 0 for all four low pixels of some pixels.
    1.0 / (1.0 + off * off).powi(2)
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;
    use crate::{random::Random, splat::render};

    const LIMIT: [f32; 2] = [0.02, 0.0];

    /// Depths by turns, also of the last row and column of odd sizes, which stand alone.
    #[test]
    fn low_pixels_have_seen_both_sides() {
        let farther = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];
        let size = UVec2::splat(3);
        assert_eq!(half_depths(&farther, &farther, size), [0.1, 0.6, 0.8, 0.9]);
        // The nearer side of an edge, and none elsewhere.
        let mut nearer = [1.0; 9];
        nearer[5] = 0.95;
        assert_eq!(half_depths(&farther, &nearer, size), [0.1, 0.95, 0.8, 0.9]);
    }

    /// Without edges, the picture is the bilinear one. A mesh's edge is as sharp as its depth.
    #[test]
    fn pixels_take_the_low_pixels_of_their_surface() {
        let size = UVec2::new(4, 2);
        let low = [[0.0; 4], [1.0; 4]];
        let smooth = upsampled((&low, &[0.1; 2]), &[0.1; 8], size, LIMIT);
        for (found, expected) in smooth.iter().zip([0.0, 0.25, 0.75, 1.0, 0.0, 0.25, 0.75, 1.0]) {
            assert!((found[0] - expected).abs() < 1e-6, "{found:?}, expected {expected}");
        }
        // The mesh ends within a low pixel.
        let depths = [0.5, 0.5, 0.5, 0.1, 0.5, 0.5, 0.5, 0.1];
        let sharp = upsampled((&low, &[0.5, 0.1]), &depths, size, LIMIT);
        for (found, depth) in sharp.iter().zip(depths) {
            let expected = if depth == 0.5 { 0.0 } else { 1.0 };
            assert!((found[0] - expected).abs() < 1e-3, "{found:?} at {depth}");
        }
        // Nowhere is a division by 0: all is infinitely far, or nothing agrees.
        let far = upsampled((&low, &[0.0; 2]), &[0.0; 8], size, LIMIT);
        assert_eq!(far, smooth);
        let lost = upsampled((&low, &[1e-9; 2]), &[0.9; 8], size, [1e-7, 0.0]);
        assert!(lost.iter().flatten().all(|value| (0.0..=1.0).contains(value)), "{lost:?}");
        // Nothing is before the near plane.
        assert_eq!(upsampled((&low, &[0.1; 2]), &[1.0; 8], size, LIMIT), [[0.0; 4]; 8]);
    }

    fn texels(picture: &RenderedImage) -> Vec<[f32; 4]> {
        let texels = picture.color.iter().zip(&picture.alpha);
        texels.map(|(&[r, g, b], &alpha)| [r, g, b, alpha]).collect()
    }

    /// Splats keep their sums. So thin ones do not become a fat crowd, as in a picture of half the size.
    #[test]
    fn thin_splats_keep_their_light() {
        let mut random = Random::new(5);
        let mut between = |low: f32, high: f32| low + (high - low) * random.uniform();
        let mut scene = Scene::default();
        let mut colors = Vec::new();
        for i in 0..600 {
            scene.means.push(Vec3::new(between(-1.5, 1.5), between(-1.0, 1.0), between(2.0, 4.0)));
            scene.scales.push(Vec3::splat(between(0.002, 0.03)));
            scene.rotations.push(Quat::IDENTITY);
            scene.opacities.push(between(0.2, 0.9));
            scene.order.push(i);
            colors.push([between(0.0, 1.0), between(0.0, 1.0), between(0.0, 1.0)]);
        }
        scene.n_source = 600;
        let camera = Camera::look_at(Vec3::NEG_Z, Vec3::ZERO, Vec3::NEG_Y, 0.8, UVec2::new(95, 64));
        let colors = Colors::Rgb(&colors);
        let whole = texels(&render(&scene, colors, &camera));
        let depths = vec![0.0; whole.len()];
        let likeness = |low: &RenderedImage| {
            let low_depths = vec![0.0; low.alpha.len()];
            let found = upsampled((&texels(low), &low_depths), &depths, camera.size, LIMIT);
            let pairs = found.as_flattened().iter().zip(whole.as_flattened());
            let error: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
            -10.0 * (error / (4 * whole.len()) as f64).log10()
        };
        let found = likeness(&render_half(&scene, colors, &camera));
        let half = Camera {
            focal: camera.focal / 2.0,
            center: camera.center / 2.0,
            size: half_size(camera.size),
            ..camera.clone()
        };
        let small = likeness(&render(&scene, colors, &half));
        println!("{found:.1} dB, a picture of half the size {small:.1} dB");
        assert!(found > small + 3.0, "{found:.1} dB, a picture of half the size {small:.1} dB");
    }
}
