//! Sheets: pictures of the scene in which patches of it are painted over, and from which the paint goes back to the
//! Gaussians.
//!
//! Each Gaussian belongs to one sheet, which shows it at least half as large as any other. So it takes its paint from one picture, and not the
//! mean of several, in which strokes would fade.

use glam::Vec3;
use rayon::prelude::*;

use super::{patches::Patches, proofs::solid};
use crate::splat::BlendWeights;

/// The least share of the largest size in which a sheet shows a Gaussian, for the Gaussian to belong to it. Few sheets with
/// large areas have fewer seams than many with small ones.
const LARGE: f32 = 0.5;

/// Pixels that a Gaussian must fill in one of the views to belong to a sheet.
const LEAST_PIXELS: f32 = 0.05;

/// The least share of a view that must belong to its own Gaussians for it to become a sheet.
const LEAST_AREA: f32 = 0.01;

/// The least share of a pixel at which it is painted over.
const LEAST_SHARE: f32 = 0.02;

/// Pixels by which a Gaussian's share of the paint is damped: one that fills less than this keeps part of its color.
const DAMPING: f32 = 0.5;

/// Pictures of the scene.
pub(super) struct Sheets {
    sheets: Vec<Sheet>,
    /// Pixels that each Gaussian fills, by the shares of their sheets' Gaussians, and [`DAMPING`] `[N]`.
    filled: Vec<f32>,
}

struct Sheet {
    size: [usize; 2],
    /// Positions in the picture of the pixels that the scene covers `[M]`.
    covered: Vec<u32>,
    /// Their blend weights, summing to 1 in each.
    weights: BlendWeights,
    /// The share of each that belongs to this sheet's Gaussians `[M]`.
    shares: Vec<f32>,
}

impl Sheets {
    /// Sheets of the views of a scene of `n` Gaussians with these blend `weights`.
    pub fn new(n: usize, weights: impl Iterator<Item = BlendWeights>) -> Self {
        let views: Vec<([usize; 2], Vec<u32>, BlendWeights)> = weights
            .map(|weights| {
                let size = [weights.size.x as usize, weights.size.y as usize];
                let (counts, weights) = solid(&weights);
                let covered = (0..counts.len() as u32).filter(|&i| counts[i as usize]).collect();
                (size, covered, weights)
            })
            .collect();
        let sizes: Vec<Vec<f32>> = (views.iter())
            .map(|(_, covered, weights)| weights.apply_transposed(&vec![1.0; covered.len()], 1))
            .collect();
        let owners = owners(&sizes);
        let sheet = |(i, (size, covered, weights)): (usize, ([usize; 2], Vec<u32>, BlendWeights))| {
            let own: Vec<f32> = owners.iter().map(|owner| f32::from(u8::from(*owner == Some(i)))).collect();
            let shares = weights.apply(&own, 1);
            let is_used = shares.iter().sum::<f32>() > LEAST_AREA * covered.len() as f32;
            is_used.then_some(Sheet { size, covered, weights, shares })
        };
        let sheets: Vec<Sheet> = views.into_iter().enumerate().filter_map(sheet).collect();
        let mut filled = vec![DAMPING; n];
        for Sheet { weights, shares, .. } in &sheets {
            let of_sheet = weights.apply_transposed(shares, 1);
            filled.iter_mut().zip(of_sheet).for_each(|(sum, value)| *sum += value);
        }
        Self { sheets, filled }
    }

    /// Colors `[N]` moved to the painting's, patch by patch, as far as pictures show them and `cover` `[N]` lets them,
    /// 0..1.
    pub fn painted_over(&self, colors: &[Vec3], patches: &Patches, cover: &[f32]) -> Vec<Vec3> {
        let mut flat: Vec<f32> = colors.iter().flat_map(|color| color.to_array()).collect();
        let mut moves = vec![0.0; flat.len()];
        for sheet in &self.sheets {
            let of_sheet = sheet.moves(&flat, patches);
            moves.par_iter_mut().zip(of_sheet).for_each(|(sum, value)| *sum += value);
        }
        let shares = cover.iter().zip(&self.filled).map(|(cover, filled)| cover / filled);
        for ((color, by), share) in flat.chunks_exact_mut(3).zip(moves.chunks_exact(3)).zip(shares) {
            color.iter_mut().zip(by).for_each(|(color, by)| *color += share * by);
        }
        flat.chunks_exact(3).map(Vec3::from_slice).collect()
    }
}

impl Sheet {
    /// The way from the pixels in `colors` `[N * 3]` to those painted over, summed over what each Gaussian fills `[N * 3]`.
    fn moves(&self, colors: &[f32], patches: &Patches) -> Vec<f32> {
        let pixels: Vec<Vec3> = self.weights.apply(colors, 3).chunks_exact(3).map(Vec3::from_slice).collect();
        let picture = self.filled_in(&pixels);
        let mut wanted = vec![false; picture.len()];
        for (&i, share) in self.covered.iter().zip(&self.shares) {
            wanted[i as usize] = *share > LEAST_SHARE;
        }
        let painted = patches.painted_over(&picture, self.size, &wanted);
        let pairs = self.covered.iter().zip(&pixels).zip(&self.shares);
        let way = |((&i, pixel), share): ((&u32, &Vec3), &f32)| {
            ((painted[i as usize] - *pixel) * *share).to_array()
        };
        self.weights.apply_transposed(&pairs.flat_map(way).collect::<Vec<f32>>(), 3)
    }

    /// The picture `[H * W]` of covered `pixels` `[M]`, and beside the scene what is near. The border of the scene is no
    /// edge that a patch should have.
    fn filled_in(&self, pixels: &[Vec3]) -> Vec<Vec3> {
        let mut picture = vec![(Vec3::ZERO, 0.0); self.size[0] * self.size[1]];
        self.covered.iter().zip(pixels).for_each(|(&i, pixel)| picture[i as usize] = (*pixel, 1.0));
        fill(&mut picture, self.size);
        picture.into_iter().map(|(color, _)| color).collect()
    }
}

/// The sheet that each Gaussian belongs to `[N]`, by the pixels that it fills in each view. Views choose in turn, those
/// first that show most of what is left.
fn owners(sizes: &[Vec<f32>]) -> Vec<Option<usize>> {
    let n = sizes.first().map_or(0, Vec::len);
    let largest: Vec<f32> =
        (0..n).map(|i| sizes.iter().map(|of_view| of_view[i]).fold(0.0, f32::max)).collect();
    let mut owners = vec![None; n];
    let mut left: Vec<usize> = (0..sizes.len()).collect();
    let is_large = |view: usize, i: usize| largest[i] > LEAST_PIXELS && sizes[view][i] >= LARGE * largest[i];
    while !left.is_empty() {
        let free = |view: usize| {
            let of_view = sizes[view].iter().enumerate();
            let free = of_view.filter(|(i, _)| owners[*i].is_none() && is_large(view, *i));
            free.map(|(_, pixels)| f64::from(*pixels)).sum::<f64>()
        };
        // The first of those with the most.
        let areas: Vec<f64> = left.iter().map(|&view| free(view)).collect();
        let most = areas.iter().copied().fold(0.0, f64::max);
        let next = areas.iter().position(|area| *area == most).unwrap_or(0);
        let view = left.remove(next);
        for i in (0..n).filter(|&i| is_large(view, i)) {
            owners[i] = owners[i].or(Some(view));
        }
    }
    owners
}

/// Fills pixels of weight 0 with the mean of what is near: averages of 2 x 2 pixels, and of those again, until nothing is
/// empty, and back.
fn fill(picture: &mut [(Vec3, f32)], [width, height]: [usize; 2]) {
    if width * height <= 1 || picture.iter().all(|(_, weight)| *weight > 0.0) {
        return;
    }
    let small = [width.div_ceil(2), height.div_ceil(2)];
    let mut halved = vec![(Vec3::ZERO, 0.0); small[0] * small[1]];
    for (i, (color, weight)) in picture.iter().enumerate() {
        let (sum, total) = &mut halved[i / width / 2 * small[0] + i % width / 2];
        (*sum, *total) = (*sum + *color * *weight, *total + weight);
    }
    for (sum, total) in halved.iter_mut().filter(|(_, total)| *total > 0.0) {
        (*sum, *total) = (*sum / *total, 1.0);
    }
    fill(&mut halved, small);
    for (i, (color, weight)) in picture.iter_mut().enumerate().filter(|(_, (_, weight))| *weight == 0.0) {
        (*color, *weight) = halved[i / width / 2 * small[0] + i % width / 2];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussians_belong_to_few_sheets_that_show_them_large() {
        // The second view shows most. The first is left with what the second shows at less than half the size.
        let sizes = [vec![4.0, 9.0, 0.0, 0.02], vec![5.0, 4.0, 9.0, 0.01]];
        assert_eq!(owners(&sizes), [Some(1), Some(0), Some(1), None]);
        assert!(owners(&[]).is_empty());
    }

    #[test]
    fn empty_pixels_take_what_is_near() {
        let size = [5, 3];
        let mut picture = vec![(Vec3::ZERO, 0.0); 15];
        (picture[0], picture[14]) = ((Vec3::X, 1.0), (Vec3::Y, 1.0));
        fill(&mut picture, size);
        assert!(
            picture.iter().all(|(color, weight)| *weight > 0.0 && (color.x + color.y - 1.0).abs() < 1e-6)
        );
        assert_eq!((picture[0].0, picture[1].0, picture[14].0), (Vec3::X, Vec3::X, Vec3::Y));
        let mut nothing = vec![(Vec3::ZERO, 0.0); 15];
        fill(&mut nothing, size);
        assert!(nothing.iter().all(|(color, _)| *color == Vec3::ZERO));
    }
}
