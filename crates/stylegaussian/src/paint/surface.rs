//! All that paint needs of a scene and that no style changes.

use glam::Vec3;

use rayon::prelude::*;

use super::{
    frames::Frames,
    proofs::Proofs,
    seeds::{N_READ, Seeds},
    sheets::Sheets,
    sight::{Sight, usual_views, weighted_median},
    smooth::smooth,
};
use crate::{camera::Camera, neighbors::Neighbors, palette::LUMINANCE, recolor::ColorMoments, scene::Scene};

/// Distance of seeds, in pixels of the painting: about the length of a stroke in a painting of 512 pixels.
const SPACING: f32 = 28.0;

/// Standard deviations of the scene's smoothed colors, in pixels of the painting. The last ones are its large shapes.
const SMOOTH: [f32; 5] = [2.0, 4.0, 8.0, 16.0, 32.0];

/// Deviation of the luminance of detail, over that of the scene, at which half of the brush's protection applies. Chosen by
/// eye; the median of what is seen has 0.76 on the bonsai and 0.82 on the demo scene.
const FINE: f32 = 1.0;

/// The same over the median detail of what is seen, if that is more: on ground that is rough all over only what stands out
/// from it is fine. The median is then protected by at most 0.41, as on the demo scene (which this leaves as it is).
const USUAL: f32 = 1.1;

/// Neighbors that normals and directions are averaged over.
const N_NEIGHBORS: usize = 8;

/// The surfaces of a scene: their directions, seeds and colors. Computed once per scene, for every style.
pub struct Surface {
    pub(super) seeds: Seeds,
    /// Size of a pixel of the painting, in scene units.
    pub(super) pixel: f32,
    /// Pixels of usual views that each Gaussian fills `[N]`.
    pub(super) visibility: Vec<f32>,
    /// Standard deviation of each Gaussian along its two longer axes (their geometric mean), in pixels of the painting
    /// `[N]`.
    pub(super) footprints: Vec<f32>,
    /// Base colors, and the same ever smoother `[N]` each: the last without detail smaller than a stroke.
    pub(super) levels: Vec<Vec<Vec3>>,
    /// How much each Gaussian belongs to things that are smaller than a stroke `[N]`, 0..1.
    pub(super) fine: Vec<f32>,
    /// Pictures by which paint is measured.
    pub(super) proofs: Proofs,
    /// Pictures by which it is painted over.
    pub(super) sheets: Sheets,
    /// Mean base color around each seed `[M]`.
    pub(super) seed_colors: Vec<Vec3>,
    /// Mean latent features around each seed `[M, L]`; empty if the scene has none.
    pub(super) seed_features: Vec<f32>,
    /// Moments of the base colors, as pictures show them.
    pub(super) moments: ColorMoments,
}

impl Surface {
    /// The surfaces of `scene`. `stroke_scale` enlarges strokes: at 1 they have the size that they have in the painting
    /// if the scene is seen at 512 pixels from the usual distance. Must be above 0 and finite, or counts as 1.
    ///
    /// Takes a few seconds for 70,000 Gaussians on two cores.
    pub fn new(scene: &Scene, stroke_scale: f32) -> Self {
        Self::seen_from(scene, &usual_views(scene), stroke_scale)
    }

    /// The surfaces of `scene` as `cameras` show them: a few of its capture's, or chosen ones if those are not known
    /// ([`choose_views`](crate::views::choose_views)), the most useful first. The first eight count.
    pub fn seen_from(scene: &Scene, cameras: &[Camera], stroke_scale: f32) -> Self {
        let stroke_scale = if stroke_scale > 0.0 && stroke_scale.is_finite() { stroke_scale } else { 1.0 };
        let sight = Sight::of(scene, cameras, stroke_scale);
        let pixel = sight.pixel;
        let found;
        let neighbors = match &scene.neighbors {
            Some(neighbors) if neighbors.k >= N_NEIGHBORS => neighbors,
            _ => {
                found = Neighbors::find(&scene.means, &scene.order, N_NEIGHBORS);
                &found
            }
        };
        let base: Vec<Vec3> = scene.base_colors().into_iter().map(Vec3::from).collect();
        let frames = Frames::new(scene, neighbors, &base);
        let seeds = Seeds::new(&scene.means, &sight.visibility, &frames, sight.up, SPACING * pixel);
        let flat: Vec<f32> = base.iter().flat_map(|color| color.to_array()).collect();
        let seed_colors: Vec<Vec3> =
            seeds.pooled(&flat, 3, &sight.visibility).chunks_exact(3).map(Vec3::from_slice).collect();
        let seed_features = scene.features.as_ref().map_or_else(Vec::new, |features| {
            seeds.pooled(&features.values, features.n_latent, &sight.visibility)
        });
        let moments = moments(&sight.proofs.pixels(&base), &sight.visibility, &base);
        let smoothed =
            SMOOTH.par_iter().map(|size| smooth(&scene.means, &base, &sight.visibility, size * pixel));
        let smoothed: Vec<Vec<Vec3>> = smoothed.collect();
        let levels: Vec<Vec<Vec3>> = std::iter::once(base).chain(smoothed).collect();
        let fine = fineness(&seeds, &sight.visibility, &levels, moments.deviation_along(LUMINANCE));
        let footprints = scene.broad_sides().into_iter().map(|side| side / pixel).collect();
        Self {
            seeds,
            pixel,
            visibility: sight.visibility,
            footprints,
            levels,
            fine,
            proofs: sight.proofs,
            sheets: sight.sheets,
            seed_colors,
            seed_features,
            moments,
        }
    }

    /// N, the number of Gaussians.
    pub fn len(&self) -> usize {
        self.base().len()
    }

    /// How much each Gaussian belongs to things that are smaller than a stroke, such as fences and windows `[N]`, 0..1.
    pub fn fine(&self) -> &[f32] {
        &self.fine
    }

    /// Base colors `[N]`.
    pub(super) fn base(&self) -> &[Vec3] {
        &self.levels[0]
    }

    /// Whether the scene has no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.base().is_empty()
    }
}

/// How much each Gaussian belongs to things that are smaller than a stroke `[N]`, 0..1: the luminance of the detail
/// around the seeds that it reads from, beside the `contrast` of the scene and the usual detail. Detail is what the first of
/// `levels` has beyond the last.
fn fineness(seeds: &Seeds, visibility: &[f32], levels: &[Vec<Vec3>], contrast: f32) -> Vec<f32> {
    let (own, shapes) = (&levels[0], &levels[levels.len() - 1]);
    let squares: Vec<f32> =
        own.iter().zip(shapes).map(|(own, shape)| (*own - *shape).dot(LUMINANCE).powi(2)).collect();
    let of_seeds = seeds.pooled(&squares, 1, visibility);
    let of_gaussian = |read: &[(u32, f32); N_READ]| -> f32 {
        read.iter().map(|(j, weight)| weight * of_seeds[*j as usize]).sum()
    };
    let squares: Vec<f32> = seeds.read.iter().map(of_gaussian).collect();
    let mut seen: Vec<(f32, f32)> = squares.iter().copied().zip(visibility.iter().copied()).collect();
    let usual = weighted_median(&mut seen).unwrap_or(0.0).sqrt();
    let half = (FINE * contrast).max(USUAL * usual).powi(4);
    // To the fourth power: grass and cloth are painted, fences and windows are not, and little lies between.
    squares.into_iter().map(|square| square * square / (square * square + half)).collect()
}

/// Moments of what pictures of these `colors` `[N]` have `shown`, or of the Gaussians by visibility if they show nothing.
pub(super) fn moments(shown: &[Vec3], visibility: &[f32], colors: &[Vec3]) -> ColorMoments {
    match shown.is_empty() {
        true => ColorMoments::of_weighted(colors.iter().copied().zip(visibility.iter().copied())),
        false => ColorMoments::of_weighted(shown.iter().map(|color| (*color, 1.0))),
    }
}
