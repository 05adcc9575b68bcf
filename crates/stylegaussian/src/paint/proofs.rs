//! Proofs: small pictures of the scene from usual distances, by which paint is measured before it is shown.

use glam::Vec3;
use rayon::prelude::*;

use super::bands::{Mask, N_BANDS};
use crate::{
    camera::Camera,
    decoder::product::{Matrix, product},
    palette::LUMINANCE,
    scene::Scene,
    splat::{BlendWeights, blend_weights},
};

/// Least alpha of pixels that count: the background shines through the others.
const COVERED: f32 = 0.9;

/// Least blend weight that is kept. Most of a pixel's many weights are smaller, and sum to little.
const LEAST_WEIGHT: f32 = 0.004;

/// Pixels whose products are summed in f32. Twelve rows of them take 48 KiB.
const BLOCK: usize = 1024;

/// Parts that are drawn at once: as many as a vector of the processor holds.
const AT_ONCE: usize = 4;

/// Pictures of the scene that can be drawn in any colors at once.
pub(super) struct Proofs(Vec<Proof>);

struct Proof {
    /// Blend weights of the pixels that count, summing to 1 in each: one row for each.
    weights: BlendWeights,
    mask: Mask,
}

impl Proofs {
    /// Pictures of `scene` from `cameras`. Those that show nothing are left out.
    pub fn new(scene: &Scene, cameras: &[Camera]) -> Self {
        let proofs = cameras.iter().map(|camera| Proof::new(blend_weights(scene, camera)));
        Self(proofs.filter(|proof| proof.mask.n_covered() > 0).collect())
    }

    /// The pixels of all proofs if Gaussians have these `colors` `[N]`.
    pub fn pixels(&self, colors: &[Vec3]) -> Vec<Vec3> {
        let flat: Vec<f32> = colors.iter().flat_map(|color| color.to_array()).collect();
        let drawn = self.0.iter().map(|proof| proof.weights.apply(&flat, 3));
        drawn.flat_map(|pixels| pixels.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>()).collect()
    }

    /// Products of the luminance of K `parts` of colors, each `[N]`, in each band `[K, K]`: how much of the band's energy
    /// each pair of parts gives.
    pub fn products(&self, parts: &[Vec<Vec3>]) -> [Vec<f64>; N_BANDS] {
        let n = parts.len();
        let mut products: [Vec<f64>; N_BANDS] = std::array::from_fn(|_| vec![0.0; n * n]);
        // Side by side for each Gaussian, with their number.
        let luminance = parts.par_chunks(AT_ONCE).map(|parts| {
            let row = |i: usize| parts.iter().map(move |part| part[i].dot(LUMINANCE));
            ((0..parts[0].len()).flat_map(row).collect(), parts.len())
        });
        let luminance: Vec<(Vec<f32>, usize)> = luminance.collect();
        for proof in &self.0 {
            let bands = luminance.par_iter().flat_map(|(luminance, n_parts)| {
                let drawn = proof.weights.apply(luminance, *n_parts);
                let of_part = |part: usize| -> Vec<f32> {
                    drawn.iter().skip(part).step_by(*n_parts).copied().collect()
                };
                (0..*n_parts).map(|part| proof.mask.bands(&of_part(part))).collect::<Vec<_>>()
            });
            let bands: Vec<[Vec<f32>; N_BANDS]> = bands.collect();
            products.par_iter_mut().enumerate().for_each(|(band, products)| {
                let of_band: Vec<&[f32]> = bands.iter().map(|of_part| of_part[band].as_slice()).collect();
                add_products(products, &of_band);
            });
        }
        products
    }
}

/// Adds the scalar products of `rows` with one another `[K, K]`.
fn add_products(sums: &mut [f64], rows: &[&[f32]]) {
    let n = rows.len();
    let n_pixels = rows.first().map_or(0, |row| row.len());
    let mut block = vec![0.0; n * BLOCK];
    let mut of_block = vec![0.0; n * n];
    // Blocks in f32 are summed in f64.
    for start in (0..n_pixels).step_by(BLOCK) {
        let width = BLOCK.min(n_pixels - start);
        for (to, row) in block.chunks_exact_mut(width).zip(rows) {
            to.copy_from_slice(&row[start..start + width]);
        }
        let block = Matrix::dense(&block, n, width);
        product(&mut of_block, false, block, block.transposed());
        sums.iter_mut().zip(&of_block).for_each(|(sum, product)| *sum += f64::from(*product));
    }
}

impl Proof {
    fn new(weights: BlendWeights) -> Self {
        let size = [weights.size.x as usize, weights.size.y as usize];
        let (counts, weights) = solid(&weights);
        Self { mask: Mask::new(&counts, size), weights }
    }
}

/// Which pixels of a view count `[H * W]`, and the blend weights of those that do: one row for each, summing to 1.
pub(super) fn solid(weights: &BlendWeights) -> (Vec<bool>, BlendWeights) {
    let row = |pixel: usize| weights.starts[pixel] as usize..weights.starts[pixel + 1] as usize;
    let n_pixels = weights.starts.len() - 1;
    let is_covered = |pixel: usize| weights.weights[row(pixel)].iter().sum::<f32>() > COVERED;
    let counts: Vec<bool> = (0..n_pixels).map(is_covered).collect();
    let mut kept = BlendWeights { starts: vec![0], indices: Vec::new(), weights: Vec::new(), ..*weights };
    for pixel in (0..n_pixels).filter(|&pixel| counts[pixel]) {
        let entries = || row(pixel).map(|i| (weights.indices[i], weights.weights[i]));
        let most = entries().map(|(_, weight)| weight).fold(0.0, f32::max);
        // Of many thin Gaussians none may have the least weight: half of the largest weight is kept in any case.
        let kept_here = || entries().filter(|(_, weight)| *weight >= LEAST_WEIGHT.min(0.5 * most));
        let total: f32 = kept_here().map(|(_, weight)| weight).sum();
        kept.indices.extend(kept_here().map(|(gaussian, _)| gaussian));
        kept.weights.extend(kept_here().map(|(_, weight)| weight / total));
        kept.starts.push(kept.indices.len() as u32);
    }
    (counts, kept)
}
