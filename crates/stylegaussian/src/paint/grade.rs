//! The colors under strokes.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    balance::Balance,
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

/// Colors with the painting's palette and tones: under strokes those of the painting without its strokes,
/// elsewhere those of the whole painting.
pub(super) fn graded(
    choice: &Choice,
    colors: &[Vec3],
    protection: &[f32],
    balance: &Balance,
    pull: f32,
) -> Vec<[f32; 3]> {
    let surface = choice.surface;
    let shown = surface.proofs.pixels(colors);
    let from = moments(&shown, &surface.visibility, colors);
    let grades =
        [&choice.tints.low, &choice.tints.whole].map(|(to, tones)| Grade::new(&from, &shown, to, tones));
    let range = (Vec3::splat(-OVERSHOOT), Vec3::splat(1.0 + OVERSHOOT));
    let grade = |i: usize, k: usize| grades[k].color(colors[i]);
    let shifts = choice.shifts(|i| grade(i, 0));
    let color = |i: usize| {
        let painting = choice.of_gaussian(i);
        let tints = choice.tints_of(painting);
        let fine = 1.0 - PROTECTED * protection[i];
        let wide = balance.wide * (1.0 - protection[i]);
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
struct Grade<'a> {
    recoloring: Recoloring,
    from: Tones,
    to: &'a Tones,
}

impl<'a> Grade<'a> {
    fn new(from: &ColorMoments, shown: &[Vec3], to: &ColorMoments, tones: &'a Tones) -> Self {
        let recoloring = Recoloring::new(from, to);
        let luminance = |color: &Vec3| Vec3::from(recoloring.color(color.to_array())).dot(LUMINANCE);
        let from = Tones::new(shown.par_iter().map(luminance).collect());
        Self { recoloring, from, to: tones }
    }

    fn color(&self, color: Vec3) -> Vec3 {
        let color = Vec3::from(self.recoloring.color(color.to_array()));
        let luminance = color.dot(LUMINANCE);
        color + TONE * (Curve::new(&self.from, self.to).at(luminance) - luminance)
    }
}
