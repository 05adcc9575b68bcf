//! Colors of Gaussians from what they read in the painting.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    canvas::Canvas,
    painting::Paint,
    places::{Placement, place},
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
    /// The scene's own detail, as a factor: 0 for none, 1 for all of it.
    pub scene: f32,
    /// Large shapes, from the scene's recolored colors (0) to the colors of the painting's places (1).
    pub local_color: f32,
}

impl Default for Brush {
    /// Chosen by eye and by measure among a dozen (docs/notes/paint_experiments.md).
    fn default() -> Self {
        Self { paint: 2.0, scene: 0.3, local_color: 0.5 }
    }
}

/// Share of a Gaussian's deviation at which it reads the painting. The whole of it would blur twice: drawing does too.
const SHARPNESS: f32 = 0.6;

/// Colors leave the range of a display by at most this. Beyond, paint would be of no painting.
const OVERSHOOT: f32 = 0.05;

/// Colors `[N]` of `scene`, which `surface` was made from, painted with a mix of paints. Weights are normalized to sum 1.
/// `content` c keeps that share of the base colors, 0..1. Colors are display-referred and slightly out of 0..1.
///
/// The result depends neither on the number of threads nor on the run. If there is no paint with a weight above 0, the
/// colors are the base colors.
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

    let color = |i: usize| {
        let (low, detail) = read(scene, surface, &canvas, &placements, i);
        let own_low = recolored(surface.low[i]);
        let own_detail = recolored(surface.base[i]) - own_low;
        own_low.lerp(low, brush.local_color) + brush.scene * own_detail + brush.paint * detail
    };
    let colors: Vec<Vec3> = (0..surface.len()).into_par_iter().map(color).collect();
    // The palette once more: detail adds contrast, and the places that were taken are not the whole painting.
    let moments = ColorMoments::of_weighted(colors.iter().copied().zip(surface.visibility.iter().copied()));
    let correction = Recoloring::new(&moments, &palette);
    let range = (Vec3::splat(-OVERSHOOT), Vec3::splat(1.0 + OVERSHOOT));
    let corrected = |color: Vec3| Vec3::from(correction.color(color.to_array())).clamp(range.0, range.1);
    colors.into_par_iter().map(corrected).collect()
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
