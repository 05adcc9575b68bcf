//! A crop of the scene: its pixels, and which of them the scene covers.

use glam::Vec2;
use rayon::prelude::*;
use stylegaussian::{
    Camera, Scene,
    splat::{BlendWeights, stroke_record},
    strokes::{LEAST_ALPHA, StrokeKnobs, StrokeRecord, Strokes},
};

use crate::network::Size;

/// Least coverage of a pixel that counts.
const COVERED: f32 = 0.9;
/// Pixels around uncovered ones that do not count either, since the loss network sees beyond them.
const MARGIN: usize = 2;

/// The picture of per-Gaussian colors `[N * 3]` over `background`: RGB `[h * w, 3]`.
pub(crate) fn over(weights: &BlendWeights, alpha: &[f32], colors: &[f32], background: [f32; 3]) -> Vec<f32> {
    let mut rgb = weights.apply(colors, 3);
    for (pixel, alpha) in rgb.chunks_exact_mut(3).zip(alpha) {
        pixel.iter_mut().zip(background).for_each(|(value, behind)| *value += (1.0 - alpha) * behind);
    }
    rgb
}

/// The detail that `strokes` add to the picture of `scene` that has these `weights`: RGB `[h * w * 3]`, or
/// nothing if there are no strokes. Colors do not change it, so one picture serves a whole step.
pub(crate) fn strokes_over(
    scene: &Scene,
    strokes: &Strokes,
    camera: &Camera,
    weights: &BlendWeights,
) -> Vec<f32> {
    if strokes.seeds.is_empty() {
        return Vec::new();
    }
    // Weights are no larger than alpha, below which nothing is drawn.
    let shows = |weight: f32| weight >= LEAST_ALPHA;
    let mut is_seen = vec![false; scene.len()];
    for (i, weight) in weights.indices.iter().zip(&weights.weights) {
        is_seen[*i as usize] |= shows(*weight);
    }
    let knobs = StrokeKnobs::DEFAULT;
    let record = |i: usize| {
        let record = || stroke_record(scene, i, strokes.words[i], &strokes.seeds, camera, &knobs);
        is_seen[i].then(record).flatten()
    };
    let records: Vec<Option<(StrokeRecord, Vec2)>> = (0..scene.len()).into_par_iter().map(record).collect();
    let width = weights.size.x as usize;
    let mut rgb = vec![[0.0; 3]; weights.starts.len() - 1];
    rgb.par_iter_mut().enumerate().for_each(|(pixel, sum)| {
        let at = Vec2::new((pixel % width) as f32, (pixel / width) as f32) + 0.5;
        for (i, weight) in weights.pixel(pixel).filter(|(_, weight)| shows(*weight)) {
            let Some((record, center)) = &records[i] else { continue };
            let texture = &strokes.textures[usize::from(record.texture)];
            let detail = record.detail(texture, at - *center, &knobs);
            sum.iter_mut().zip(detail.to_array()).for_each(|(sum, value)| *sum += weight * value);
        }
    });
    rgb.into_flattened()
}

/// The pixels that the scene covers.
pub(crate) struct Mask {
    size: Size,
    covered: Vec<bool>,
}

impl Mask {
    /// The covered pixels of a picture with coverage `alpha` `[h * w]`.
    pub fn new(size: Size, alpha: &[f32]) -> Self {
        let solid: Vec<bool> = alpha.iter().map(|alpha| *alpha > COVERED).collect();
        let across = eroded(&solid, size.width, 1, size.width);
        let covered = eroded(&across, size.height, size.width, size.width);
        Self { size, covered }
    }

    /// The cells of a picture of `size`, whose pixels are a whole number of this picture's, that are wholly
    /// covered.
    pub fn cells(&self, size: Size) -> Vec<u32> {
        let n = (self.size.width / size.width.max(1)).max(1);
        let is_covered = |cell: usize| {
            let (x, y) = (cell % size.width * n, cell / size.width * n);
            let rows = y..(y + n).min(self.size.height);
            rows.into_iter().all(|y| {
                let row = y * self.size.width;
                self.covered[row + x..row + (x + n).min(self.size.width)].iter().all(|&covered| covered)
            })
        };
        (0..size.n_pixels()).filter(|&cell| is_covered(cell)).map(|cell| cell as u32).collect()
    }
}

/// Which pixels have only solid ones within [`MARGIN`] along a line of `n` pixels, `stride` apart. Pixels
/// beyond the picture's border count as solid.
fn eroded(solid: &[bool], n: usize, stride: usize, width: usize) -> Vec<bool> {
    let place = |i: usize| if stride == 1 { i % width } else { i / width };
    (0..solid.len())
        .map(|i| {
            let at = place(i);
            let (before, after) = (MARGIN.min(at), MARGIN.min(n - 1 - at));
            (i - before * stride..=i + after * stride).step_by(stride).all(|i| solid[i])
        })
        .collect()
}
