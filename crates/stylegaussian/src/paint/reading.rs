//! Colors of Gaussians from what they read in the painting.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    canvas::Canvas,
    frames::LUMINANCE,
    painting::Paint,
    places::{Placement, place},
    seeds::N_READ,
    surface::{Surface, mix},
};
use crate::{
    recolor::{ColorMoments, Recoloring},
    scene::Scene,
};

/// How paint is laid on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brush {
    /// The painting's detail, as a factor: 0 for none. Above 1, because Gaussians that overlap blur what they carry.
    pub paint: f32,
    /// The scene's own detail, as a factor: 0 for none, 1 for all of it. Things smaller than a stroke keep more.
    pub scene: f32,
    /// Large shapes, from the scene's recolored colors (0) to the colors of the painting's places (1).
    pub local_color: f32,
    /// The share of paint that things finer than a stroke do without, 0..1. Less of it gives more texture, more of it a
    /// clearer scene. Their own detail is kept in any case.
    pub protection: f32,
}

impl Default for Brush {
    /// Chosen by eye and by measure among a dozen (docs/notes/paint_experiments.md).
    fn default() -> Self {
        Self { paint: 2.2, scene: 0.3, local_color: 0.5, protection: 0.6 }
    }
}

/// Share of a Gaussian's deviation at which it reads the painting. The whole of it would blur twice: drawing does too.
const SHARPNESS: f32 = 0.6;

/// Deviation of luminance within a stroke's length, in the recolored scene, at which half of [`Brush::protection`] applies.
/// Fences and windows have 0.2 to 0.3, grass and cloth less than 0.1.
const FINE: f32 = 0.16;

/// Colors leave the range of a display by at most this. Beyond, paint would be of no painting.
const OVERSHOOT: f32 = 0.05;

/// Colors `[N]` of `scene`, which `surface` was made from, painted with a mix of paints. Weights are normalized to sum 1.
/// `content` c keeps that share of the base colors, 0..1. Colors are display-referred and slightly out of 0..1.
///
/// The result depends neither on the number of threads nor on the run. If there is no paint with a weight above 0, the
/// colors are the base colors.
///
/// # Panics
/// If `surface` was made from a scene of another number of Gaussians.
pub fn repaint(
    scene: &Scene,
    surface: &Surface,
    paints: &[(&Paint, f64)],
    content: f64,
    brush: Brush,
) -> Vec<[f32; 3]> {
    assert_eq!(scene.len(), surface.len(), "the surface of this scene");
    let total: f64 = paints.iter().map(|(_, weight)| weight.max(0.0)).sum();
    let styled = 1.0 - content.clamp(0.0, 1.0);
    // Also if the total is NaN.
    if !(total > 0.0 && total.is_finite()) || styled == 0.0 {
        return surface.base.iter().map(|color| color.to_array()).collect();
    }
    let mut colors: Vec<Vec3> = surface.base.iter().map(|color| *color * (1.0 - styled) as f32).collect();
    for (paint, weight) in paints.iter().filter(|(_, weight)| *weight > 0.0) {
        let share = (styled * weight / total) as f32;
        let painted = painted(scene, surface, paint, brush);
        colors.par_iter_mut().zip(painted).for_each(|(sum, color)| *sum += color * share);
    }
    colors.iter().map(|color| color.to_array()).collect()
}

/// Colors `[N]` in one paint.
fn painted(scene: &Scene, surface: &Surface, paint: &Paint, brush: Brush) -> Vec<Vec3> {
    let canvas = Canvas::new(paint);
    let rgb: Vec<f32> = paint.pixels.iter().map(|byte| f32::from(*byte) / 255.0).collect();
    let palette = ColorMoments::of_rgb(&rgb);
    let recoloring = Recoloring::new(&surface.moments, &palette);
    let recolored = |color: Vec3| Vec3::from(recoloring.color(color.to_array()));
    let seed_colors: Vec<Vec3> = surface.seed_colors.iter().map(|color| recolored(*color)).collect();
    let placements = place(scene, surface, &seed_colors, paint, &canvas);

    let own = |i: usize| {
        let low = recolored(surface.low[i]);
        (low, recolored(surface.base[i]) - low)
    };
    let fineness = fineness(surface, &own);
    let color = |i: usize| {
        let (low, detail) = read(scene, surface, &canvas, &placements, i);
        let (own_low, own_detail) = own(i);
        // Things of about a stroke's size keep their own detail, and get so much less paint.
        let fine = fineness[i];
        let cover = 1.0 - brush.protection * fine;
        let own_detail = own_detail * (brush.scene + (1.0 - brush.scene) * fine);
        own_low.lerp(low, brush.local_color * cover) + own_detail + brush.paint * cover * detail
    };
    let colors: Vec<Vec3> = (0..surface.len()).into_par_iter().map(color).collect();
    // The palette once more: detail adds contrast, and the places that were taken are not the whole painting.
    let moments = ColorMoments::of_weighted(colors.iter().copied().zip(surface.visibility.iter().copied()));
    let correction = Recoloring::new(&moments, &palette);
    let range = (Vec3::splat(-OVERSHOOT), Vec3::splat(1.0 + OVERSHOOT));
    let corrected = |color: Vec3| Vec3::from(correction.color(color.to_array())).clamp(range.0, range.1);
    colors.into_par_iter().map(corrected).collect()
}

/// How much each Gaussian belongs to things that are smaller than a stroke `[N]`, 0..1: the contrast of the scene's own
/// detail, in luminance, around the seeds that it reads from.
fn fineness(surface: &Surface, own: &(impl Fn(usize) -> (Vec3, Vec3) + Sync)) -> Vec<f32> {
    let square = |i: usize| own(i).1.dot(LUMINANCE).powi(2);
    let squares: Vec<f32> = (0..surface.len()).into_par_iter().map(square).collect();
    let of_seeds = surface.seeds.pooled(&squares, 1, &surface.visibility);
    let of_gaussian = |read: &[(u32, f32); N_READ]| {
        let square: f32 = read.iter().map(|(j, weight)| weight * of_seeds[*j as usize]).sum();
        // To the fourth power: grass and cloth are painted, fences and windows are not, and little lies between.
        let (fourth, half) = (square * square, FINE.powi(4));
        fourth / (fourth + half)
    };
    surface.seeds.read.iter().map(of_gaussian).collect()
}

/// The painting's color and detail at Gaussian `i`.
fn read(
    scene: &Scene,
    surface: &Surface,
    canvas: &Canvas,
    placements: &[Placement],
    i: usize,
) -> (Vec3, Vec3) {
    let read = surface.seeds.read[i].map(|(j, weight)| {
        let offset = scene.means[i] - surface.seeds.seeds[j as usize].at;
        let at = placements[j as usize].read_at(offset, surface.pixel);
        // Seeds without a weight stand at the end of most lists.
        let read = if weight > 0.0 {
            canvas.read(at, SHARPNESS * surface.footprints[i])
        } else {
            (Vec3::ZERO, Vec3::ZERO)
        };
        (read, weight)
    });
    (
        mix(read.map(|((low, _), weight)| (low, weight))),
        mix(read.map(|((_, detail), weight)| (detail, weight))),
    )
}
