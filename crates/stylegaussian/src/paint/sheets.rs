//! Sheets: pictures of the scene in which patches of it are painted over, and which Gaussians then read like the painting.
//!
//! Each Gaussian belongs to one sheet, which shows it at least half as large as any other. So it takes its paint from one
//! picture, and not the mean of several, in which strokes would fade. It reads at one place, and does not take up the mean
//! of all pixels in which it shows: drawing blurs once more.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{
    canvas::{Copies, Reading},
    patches::Patches,
    proofs::solid,
};
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

/// Pixels by which a Gaussian's share of the paint is damped: one that fills as little takes half of it.
const DAMPING: f32 = 0.5;

/// Pictures of the scene.
pub(super) struct Sheets(Vec<Sheet>);

struct Sheet {
    size: [usize; 2],
    /// Positions in the picture of the pixels that the scene covers `[M]`.
    covered: Vec<u32>,
    /// Their blend weights, summing to 1 in each.
    weights: BlendWeights,
    /// Whether this sheet's Gaussians show in each pixel `[H * W]`.
    wanted: Vec<bool>,
    gaussians: Vec<InSheet>,
}

/// A Gaussian in the sheet that it belongs to.
struct InSheet {
    index: u32,
    /// The middle of what shows of it, in pixels from the picture's corner.
    center: Vec2,
    /// Standard deviation of what shows of it, in pixels.
    sigma: f32,
    /// How much of its paint it takes from the sheet, 0..1.
    share: f32,
}

impl Sheets {
    /// Sheets of the views of a scene with these blend `weights`.
    pub fn new(weights: impl Iterator<Item = BlendWeights>) -> Self {
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
            if shares.iter().sum::<f32>() <= LEAST_AREA * covered.len() as f32 {
                return None;
            }
            let mut wanted = vec![false; size[0] * size[1]];
            for (&i, share) in covered.iter().zip(&shares) {
                wanted[i as usize] = *share > LEAST_SHARE;
            }
            let gaussians = in_sheet(&weights, &covered, size[0], |gaussian| owners[gaussian] == Some(i));
            Some(Sheet { size, covered, weights, wanted, gaussians })
        };
        Self(views.into_iter().enumerate().filter_map(sheet).collect())
    }

    /// Lets the detail of `readings` `[N]` become, by `share` (0..1), what the sheets show of a scene of these `colors` `[N]`
    /// if they are painted over. A Gaussian that fills little of its sheet keeps some of its own, and one without a sheet all.
    ///
    /// Color stays: around a small thing a picture shows what is behind it.
    pub fn read(&self, colors: &[Vec3], patches: &Patches, share: f32, readings: &mut [Reading]) {
        let flat: Vec<f32> = colors.iter().flat_map(|color| color.to_array()).collect();
        for sheet in &self.0 {
            let painted = Copies::new(sheet.painted_over(&flat, patches), sheet.size);
            let read = |gaussian: &InSheet| painted.read(gaussian.center, gaussian.sigma);
            let read: Vec<Reading> = sheet.gaussians.par_iter().map(read).collect();
            for (gaussian, (_, details)) in sheet.gaussians.iter().zip(read) {
                let old = &mut readings[gaussian.index as usize].1;
                for (old, new) in old.iter_mut().zip(details) {
                    *old = old.lerp(new, share * gaussian.share);
                }
            }
        }
    }
}

/// The Gaussians that show in a picture with these blend weights of its `covered` pixels, if they belong to it.
fn in_sheet(
    weights: &BlendWeights,
    covered: &[u32],
    width: usize,
    belongs: impl Fn(usize) -> bool,
) -> Vec<InSheet> {
    // Sums over the pixels in which a Gaussian shows: of 1, of their positions and of these positions' squared lengths.
    let of_pixel = |&i: &u32| {
        let at = Vec2::new((i as usize % width) as f32, (i as usize / width) as f32) + 0.5;
        [1.0, at.x, at.y, at.length_squared()]
    };
    let sums = weights.apply_transposed(&covered.iter().flat_map(of_pixel).collect::<Vec<f32>>(), 4);
    let gaussian = |(index, [pixels, x, y, square]): (usize, &[f32; 4])| {
        let center = Vec2::new(*x, *y) / *pixels;
        // Along one axis: half of what both have.
        let sigma = (0.5 * (square / pixels - center.length_squared()).max(0.0)).sqrt();
        InSheet { index: index as u32, center, sigma, share: pixels / (pixels + DAMPING) }
    };
    let own = sums.as_chunks::<4>().0.iter().enumerate().filter(|(i, sums)| belongs(*i) && sums[0] > 0.0);
    own.map(gaussian).collect()
}

impl Sheet {
    /// The picture `[H * W]` of a scene of these `colors` `[N * 3]`, painted over where this sheet's Gaussians show.
    fn painted_over(&self, colors: &[f32], patches: &Patches) -> Vec<Vec3> {
        let pixels: Vec<Vec3> = self.weights.apply(colors, 3).chunks_exact(3).map(Vec3::from_slice).collect();
        patches.painted_over(&self.filled_in(&pixels), self.size, &self.wanted)
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
    fn a_gaussian_lies_in_the_middle_of_what_shows_of_it() {
        // The first of two Gaussians fills the pixels (1, 0) and (3, 0), the second half of (1, 1).
        let weights = BlendWeights {
            size: glam::UVec2::new(4, 2),
            n_gaussians: 3,
            starts: vec![0, 1, 2, 3],
            indices: vec![0, 0, 1],
            weights: vec![1.0, 1.0, 0.5],
        };
        let found = in_sheet(&weights, &[1, 3, 5], 4, |_| true);
        assert_eq!(found.iter().map(|gaussian| gaussian.index).collect::<Vec<_>>(), [0, 1]);
        assert_eq!([found[0].center, found[1].center], [Vec2::new(2.5, 0.5), Vec2::new(1.5, 1.5)]);
        // Half of the variance, which lies along x alone.
        assert!((found[0].sigma - 0.5_f32.sqrt()).abs() < 1e-5 && found[1].sigma < 1e-3);
        assert_eq!([found[0].share, found[1].share], [2.0 / (2.0 + DAMPING), 0.5 / (0.5 + DAMPING)]);
        assert!(in_sheet(&weights, &[1, 3, 5], 4, |i| i == 2).is_empty());
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
