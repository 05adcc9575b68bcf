//! Shadows that splats cast: which pixels of a shadow map their cores cover, and at which depth.

use super::{
    alpha::{MAX_ALPHA, MIN_ALPHA},
    project::project,
};
use crate::{
    camera::Camera,
    mask::Visibility,
    scene::{Scene, ScreenFilter},
};

/// The threshold that is usual: a splat casts a shadow where it takes half of the light.
pub const CAST_THRESHOLD: f32 = 0.5;

/// A threshold within the range of alphas that splats have, [`MIN_ALPHA`] to [`MAX_ALPHA`];
/// [`CAST_THRESHOLD`] if it is NaN.
pub fn cast_threshold(wished: f32) -> f32 {
    if wished.is_nan() { CAST_THRESHOLD } else { wished.clamp(MIN_ALPHA, MAX_ALPHA) }
}

/// The depth that splats have in the shadow map of a light at `camera` `[H, W]`: the view-space z of the
/// nearest splat whose alpha is the [`cast_threshold`] of `threshold` or more, in scene units. Infinite where
/// there is none.
///
/// Splats that are smaller than a pixel keep their opacity, whatever the scene's filter: a shadow must not fade
/// as its map gets coarser.
///
/// # Panics
/// If the mask holds another number of entries than the scene has Gaussians.
pub fn cast(scene: &Scene, camera: &Camera, threshold: f32, visibility: Option<&Visibility>) -> Vec<f32> {
    assert!(visibility.is_none_or(|mask| mask.weights.len() == scene.len()), "one weight per Gaussian");
    let threshold = cast_threshold(threshold);
    let scene = Scene { filter: ScreenFilter::Classic, ..scene.clone() };
    let size = camera.size.as_usizevec2();
    let mut depths = vec![f32::INFINITY; size.x * size.y];
    for splat in project(&scene, camera, visibility).iter().filter(|splat| splat.opacity >= threshold) {
        // Alpha, opacity exp(-q / 2), is the threshold at this q.
        let reach = 2.0 * (splat.opacity / threshold).ln();
        let half_size = splat.half_size * (reach / splat.cutoff).max(0.0).sqrt();
        let rows = pixels_between(splat.center.y, half_size.y, size.y);
        for (x, y) in
            rows.flat_map(|y| pixels_between(splat.center.x, half_size.x, size.x).map(move |x| (x, y)))
        {
            let (dx, dy) = (x as f32 + 0.5 - splat.center.x, y as f32 + 0.5 - splat.center.y);
            let du = dx - splat.slope * dy;
            let q = splat.row_precision * du * du + splat.y_precision * dy * dy;
            // Splats come from the nearest on.
            let depth = &mut depths[y * size.x + x];
            if q <= reach && depth.is_infinite() {
                *depth = splat.depth;
            }
        }
    }
    depths
}

/// The pixels, of `n` in a row, that a range around `center` touches.
fn pixels_between(center: f32, half_size: f32, n: usize) -> std::ops::Range<usize> {
    // Casts of numbers below 0 are 0.
    let (first, end) = ((center - half_size) as usize, (center + half_size + 1.0) as usize);
    first.min(n)..end.min(n)
}
