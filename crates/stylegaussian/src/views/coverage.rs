//! The Gaussians that candidate cameras see, and the choice among the cameras.

use crate::{
    splat::blend_weights,
    work::{Canceled, Work},
};
use glam::UVec2;
use rayon::prelude::*;

use super::{candidates::Candidate, survey::Survey};

/// Size of test views, in pixels.
const TEST_SIZE: UVec2 = UVec2::splat(64);

/// Pixels of a test view from which on a Gaussian counts as seen.
const SEEN: f32 = 0.02;

/// Pixels of a test view from which on it matters less to see a Gaussian again, or larger.
const WELL_SEEN: f32 = 0.2;

/// Largest share of a picture that things in the way may block.
const MOST_BLOCKED: f32 = 0.15;

/// Least share of a picture that must show the scene.
const LEAST_COVERED: f32 = 0.1;

/// One in this many chosen views is an overview, even if closer looks would add more, because style lives in
/// large shapes too.
const OVERVIEW_EVERY: usize = 2;

/// Candidates and the Gaussians that each of them sees.
pub(super) struct TestViews {
    views: Vec<TestView>,
    /// n, the number of Gaussians of the simplified scene.
    n_gaussians: usize,
}

struct TestView {
    candidate: Candidate,
    /// The Gaussians of the simplified scene that fill any of the test view, and how many pixels.
    pixels: Vec<(u32, f32)>,
    /// The share of the picture that shows what is framed of the scene, 0..1.
    covered: f32,
    /// Whether the picture shows enough of the scene and nothing is in the way.
    usable: bool,
}

impl TestView {
    fn take(survey: &Survey, candidate: Candidate) -> Self {
        let camera = candidate.camera(TEST_SIZE);
        let weights = blend_weights(&survey.stand_in, &camera);
        let n_pixels = TEST_SIZE.element_product() as usize;
        // The sum of w z over a pixel is its depth times its alpha.
        let z = |&mean| camera.view_from_world.transform_point3(mean).z;
        let depths = weights.apply(&survey.stand_in.means.iter().map(z).collect::<Vec<f32>>(), 1);
        let alphas = weights.alpha();
        // Compared without a division by alpha, which may be 0. Pixels of less than 0.3 block little.
        let in_the_way = |(z, a): &(&f32, &f32)| **a > 0.3 && **z < candidate.clearance * **a;
        let blocked = depths.iter().zip(&alphas).filter(in_the_way).count() as f32 / n_pixels as f32;
        // The transpose applied to ones sums each Gaussian's weights over the picture.
        let pixels = weights.apply_transposed(&vec![1.0; n_pixels], 1);
        // Surroundings do not make a place of a thing.
        let framed = pixels.iter().zip(&survey.masses).filter(|(_, mass)| **mass > 0.0);
        let covered = framed.map(|(pixels, _)| pixels).sum::<f32>() / n_pixels as f32;
        let pixels = (0..).zip(pixels).filter(|(_, pixels)| *pixels > 0.0).collect();
        Self { candidate, pixels, covered, usable: blocked < MOST_BLOCKED && covered > LEAST_COVERED }
    }

    /// The increase of sum_i log(1 + pixels of i / [`WELL_SEEN`]) by this view, if `total` has been seen
    /// before.
    fn gain(&self, total: &[f32]) -> f64 {
        // log(1 + (t + p) / w) - log(1 + t / w) = log(1 + p / (w + t)). `ln_1p` keeps the digits of small p.
        let log = |(i, pixels): &(u32, f32)| f64::from((pixels / (WELL_SEEN + total[*i as usize])).ln_1p());
        self.pixels.iter().map(log).sum()
    }
}

impl TestViews {
    /// Renders a test view from each of `candidates`.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn take(survey: &Survey, candidates: Vec<Candidate>, work: &Work) -> Result<Self, Canceled> {
        let take = |candidate| work.check().map(|()| TestView::take(survey, candidate));
        let views = candidates.into_par_iter().map(take).collect::<Result<_, _>>()?;
        Ok(Self { views, n_gaussians: survey.stand_in.len() })
    }

    /// These views together with `others`.
    pub fn and(mut self, others: Self) -> Self {
        self.views.extend(others.views);
        self
    }

    /// The candidates with usable pictures.
    pub fn usable(&self) -> Vec<Candidate> {
        self.views.iter().filter(|view| view.usable).map(|view| view.candidate).collect()
    }

    /// The mean share of the usable pictures that shows the scene, 0..1, or 0 if none is usable.
    pub fn covered(&self) -> f32 {
        let usable: Vec<f32> =
            self.views.iter().filter(|view| view.usable).map(|view| view.covered).collect();
        usable.iter().sum::<f32>() / usable.len().max(1) as f32
    }

    /// The share of the scene's Gaussians that any usable picture shows, 0..1.
    pub fn share_seen(&self) -> f32 {
        let mut seen = vec![false; self.n_gaussians];
        let usable = self.views.iter().filter(|view| view.usable);
        for (i, _) in usable.flat_map(|view| &view.pixels).filter(|(_, pixels)| *pixels > SEEN) {
            seen[*i as usize] = true;
        }
        seen.iter().filter(|seen| **seen).count() as f32 / self.n_gaussians.max(1) as f32
    }

    /// Chooses `n` candidates, at each step the one that adds most to the views before it. Overviews alternate
    /// with the best of all candidates. If all usable ones are taken, they are taken again.
    pub fn choose(self, n: usize) -> Vec<Candidate> {
        let any_usable = self.views.iter().any(|view| view.usable);
        // If nothing is usable, a poor picture is better than none.
        let pool: Vec<&TestView> = self.views.iter().filter(|view| view.usable || !any_usable).collect();
        if pool.is_empty() {
            return Vec::new();
        }
        let mut total = vec![0.0f32; self.n_gaussians];
        let (mut left, mut chosen) = (Vec::new(), Vec::new());
        while chosen.len() < n {
            if left.is_empty() {
                left.clone_from(&pool);
            }
            let turn =
                chosen.len() % OVERVIEW_EVERY == 0 && left.iter().any(|view| view.candidate.is_overview);
            // A gain is never negative, so -1 puts closer looks behind every overview.
            let gain =
                |view: &&TestView| if turn && !view.candidate.is_overview { -1.0 } else { view.gain(&total) };
            let gains: Vec<f64> = left.par_iter().map(gain).collect();
            // The first of equal gains, whichever thread computed them.
            let best = (0..left.len()).fold(0, |best, i| if gains[i] > gains[best] { i } else { best });
            let best = left.remove(best);
            for (i, pixels) in &best.pixels {
                total[*i as usize] += pixels;
            }
            chosen.push(best.candidate);
        }
        chosen
    }
}
