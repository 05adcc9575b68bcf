//! Iso depth: how far away the surface is that splats form in each pixel.
//!
//! A mean of depths by blend weights lies between a near thing and a far one if both are seen, where there is
//! nothing. Iso depth is always the depth of a splat.

use rayon::prelude::*;

use super::{
    bands::Bands,
    composite::{GROUP, GROUPS, TILE},
    project::project,
};
use crate::{camera::Camera, mask::Visibility, scene::Scene};

/// The threshold that is usual: the splat behind which less than half of the light passes.
pub const ISO_THRESHOLD: f32 = 0.5;

/// The least threshold. One opaque splat leaves 0.01, and should be enough.
const LEAST_THRESHOLD: f32 = 0.02;

/// A threshold within the range that iso depth is defined for, 0.02..1; [`ISO_THRESHOLD`] if it is NaN.
pub fn iso_threshold(wished: f32) -> f32 {
    if wished.is_nan() { ISO_THRESHOLD } else { wished.clamp(LEAST_THRESHOLD, 1.0) }
}

/// The iso depth of each pixel `[H, W]`: the view-space z of the first splat, front to back, behind which less
/// than the [`iso_threshold`] of `threshold` of the light passes, in scene units. Infinite where there is none.
///
/// # Panics
/// If the mask holds another number of entries than the scene has Gaussians.
pub fn iso_depth(
    scene: &Scene,
    camera: &Camera,
    threshold: f32,
    visibility: Option<&Visibility>,
) -> Vec<f32> {
    assert!(visibility.is_none_or(|mask| mask.weights.len() == scene.len()), "one weight per Gaussian");
    let threshold = iso_threshold(threshold);
    let splats = project(scene, camera, visibility);
    let bands = Bands::new(&splats, camera.size);
    let size = camera.size.as_usizevec2();
    let mut depths = vec![f32::INFINITY; size.x * size.y];
    depths.par_chunks_mut((size.x * TILE).max(1)).enumerate().for_each(|(band, depths)| {
        for (tile, in_tile) in bands.tiles(band, &splats) {
            let (mut light, mut found) = ([[1.0_f32; GROUP]; GROUPS], [[f32::INFINITY; GROUP]; GROUPS]);
            tile.composite(&splats, &in_tile, 0.0, |group, splat, weights, _| {
                for (i, &weight) in weights.iter().enumerate() {
                    let before = light[group][i];
                    light[group][i] -= weight;
                    if before >= threshold && light[group][i] < threshold {
                        found[group][i] = splats[splat].depth;
                    }
                }
            });
            let found = found.as_flattened();
            for row in 0..tile.height {
                let first = row * size.x + tile.x;
                depths[first..first + tile.width].copy_from_slice(&found[row * TILE..][..tile.width]);
            }
        }
    });
    depths
}
