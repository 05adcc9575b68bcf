//! The colors under strokes.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    choice::Choice,
    detail::LOCAL,
    surface::moments,
    tone::{Curve, Tones},
};
use crate::{
    palette::LUMINANCE,
    recolor::{ColorMoments, Recoloring},
    strokes::PROTECTED,
};

/// Strength of the tone curve: at 1, the shares of dark and bright are the painting's.
const TONE: f32 = 0.9;

/// Largest excess of colors over a display's range. Overlapping Gaussians blur one another, so single ones
/// exceed it.
const OVERSHOOT: f32 = 0.3;

/// Share of the way to the painting's full contrast where no strokes add to it.
const BARE: f32 = 0.5;

/// Share of the scene's own grain that is left under strokes. It should not make up for missing paint.
const OWN_GRAIN: f32 = 0.15;

/// The scene in the paintings' colors, before the gains of its strokes are known.
pub(super) struct Underpainting {
    pub recoloring: Recoloring,
    /// Colors with the scene's own detail `[N]`.
    own: Vec<Vec3>,
    /// Colors without it `[N]`.
    low: Vec<Vec3>,
}

impl Underpainting {
    pub fn new(choice: &Choice) -> Self {
        let surface = choice.surface;
        let recoloring = Recoloring::new(&surface.moments, &choice.tints.low.0);
        let recolored = |color: &Vec3| Vec3::from(recoloring.color(color.to_array()));
        let own = surface.base.par_iter().map(recolored).collect();
        let low = surface.low.par_iter().map(recolored).collect();
        Self { own, low, recoloring }
    }

    /// Luminance of what the scene keeps: its shapes, and all detail that stands out `[N]`. `own_detail` is the
    /// share of its own detail that each Gaussian keeps `[N]`.
    pub fn kept(&self, own_detail: &[f32]) -> Vec<f32> {
        let kept = |((own, low), p): ((&Vec3, &Vec3), &f32)| low.lerp(*own, *p).dot(LUMINANCE);
        self.own.par_iter().zip(&self.low).zip(own_detail).map(kept).collect()
    }

    /// Colors before they are graded `[N]`. `own_detail` is as above.
    pub fn mixed(&self, own_detail: &[f32]) -> Vec<Vec3> {
        let detail = |i: usize| own_detail[i] + (1.0 - own_detail[i]) * OWN_GRAIN;
        let mixed = |i: usize| self.low[i].lerp(self.own[i], detail(i));
        (0..self.own.len()).into_par_iter().map(mixed).collect()
    }

    /// The colors under strokes with this gain of wide detail: see [`graded`].
    pub fn colors(
        &self,
        choice: &Choice,
        own_detail: &[f32],
        protection: &[f32],
        wide: f32,
        (pull, given): (f32, Option<&Grades>),
    ) -> Vec<[f32; 3]> {
        let colors = self.mixed(own_detail);
        let own;
        let grades = match given {
            Some(given) => given,
            None => {
                own = Grades::new(choice, &choice.surface.proofs.pixels(&colors), &colors);
                &own
            }
        };
        graded(choice, &colors, protection, wide, (pull, grades))
    }
}

/// Changes of colors, to those of the paintings without strokes and to those of the whole paintings.
pub(super) struct Grades([Grade; 2]);

impl Grades {
    /// Those by which pictures get palette and tones of a choice. `shown` are their pixels if Gaussians have
    /// these `colors` `[N]`, and none if there are no pictures.
    pub fn new(choice: &Choice, shown: &[Vec3], colors: &[Vec3]) -> Self {
        let from = moments(shown, &choice.surface.visibility, colors);
        let tints = &choice.tints;
        Self([&tints.low, &tints.whole].map(|(to, tones)| Grade::new(&from, shown, to, tones)))
    }
}

/// Colors with the painting's palette and tones: under strokes those of the painting without its strokes,
/// elsewhere those of the whole painting. `pull` is the share of the way toward its hues.
fn graded(
    choice: &Choice,
    colors: &[Vec3],
    protection: &[f32],
    wide: f32,
    (pull, grades): (f32, &Grades),
) -> Vec<[f32; 3]> {
    let range = (Vec3::splat(-OVERSHOOT), Vec3::splat(1.0 + OVERSHOOT));
    let grade = |i: usize, k: usize| grades.0[k].color(colors[i]);
    let shifts = choice.shifts(|i| grade(i, 0));
    let color = |i: usize| {
        let painting = choice.of_gaussian(i);
        let tints = choice.tints_of(painting);
        let fine = 1.0 - PROTECTED * protection[i];
        let wide = wide * (1.0 - protection[i]);
        let shift = shifts.get(painting).copied().unwrap_or(Vec3::ZERO);
        let [under, bare] = [0, 1].map(|k: usize| (grade(i, k) + shift).clamp(range.0, range.1));
        // Energies add up: without strokes all contrast is the scene's.
        let color = under.lerp(bare, BARE * (1.0 - fine * fine).max(0.0));
        let color = tints.palette.toward(color, pull).clamp(range.0, range.1);
        // Wide detail brings the painting's large shapes back.
        color.lerp(tints.mean, (LOCAL * wide).min(1.0)).to_array()
    };
    (0..colors.len()).into_par_iter().map(color).collect()
}

/// A change of moments, then of tones.
struct Grade {
    recoloring: Recoloring,
    from: Tones,
    to: Tones,
}

impl Grade {
    fn new(from: &ColorMoments, shown: &[Vec3], to: &ColorMoments, tones: &Tones) -> Self {
        let recoloring = Recoloring::new(from, to);
        let luminance = |color: &Vec3| Vec3::from(recoloring.color(color.to_array())).dot(LUMINANCE);
        let from = Tones::new(shown.par_iter().map(luminance).collect());
        Self { recoloring, from, to: tones.clone() }
    }

    fn color(&self, color: Vec3) -> Vec3 {
        let color = Vec3::from(self.recoloring.color(color.to_array()));
        let luminance = color.dot(LUMINANCE);
        color + TONE * (Curve::new(&self.from, &self.to).at(luminance) - luminance)
    }
}
