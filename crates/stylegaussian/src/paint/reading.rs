//! Colors of Gaussians from what they read in the painting.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    bands::{N_BANDS, spectrum},
    canvas::{Canvas, N_DETAILS, Reading},
    gains::{LEAST_SHARE, PRICE, Range, gains},
    painting::Paint,
    patches::Patches,
    places::{Placement, place},
    surface::{Surface, moments},
    tone::{Curve, Tones},
};
use crate::{
    palette::LUMINANCE,
    recolor::{ColorMoments, Recoloring},
    scene::Scene,
};

/// How paint is laid on.
///
/// Factors of detail are where a search starts that gives the scene's pictures as much detail of each size as the
/// painting has: a smooth painting takes detail away, a rough one adds it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brush {
    /// The usual factor of the painting's detail: 0 for none. Above 1, because Gaussians that overlap blur what they
    /// carry.
    pub paint: f32,
    /// The usual factor of the scene's own detail: 0 for none, 1 for all of it. Things smaller than a stroke keep more.
    pub scene: f32,
    /// The usual factor of the painting's large shapes, which are added to the scene's own, recolored: 0 for none.
    pub local_color: f32,
    /// The share of the scene that things finer than a stroke keep, 0..1. Less of it gives more texture, more of it a
    /// clearer scene.
    pub protection: f32,
    /// How far the shares of dark and bright become the painting's, 0..1.
    pub tone: f32,
    /// How far pictures of the painted scene are painted over, patch by patch, with the painting's own, 0..1. 0 saves the
    /// time for it.
    pub patches: f32,
}

impl Brush {
    /// Chosen by eye and by measure (docs/notes/paint_experiments.md).
    pub const DEFAULT: Self =
        Self { paint: 1.2, scene: 0.5, local_color: 0.7, protection: 0.5, tone: 0.7, patches: 1.0 };
}

impl Default for Brush {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Largest factors of the scene's own detail and of the painting's. More of the former brings out single Gaussians.
const MOST_SCENE: f64 = 1.0;
const MOST_PAINT: f64 = 8.0;

/// Price of the scene's own detail, above that of the painting's. If both lead to the same spectrum, the painting's is taken: at
/// equal prices a small change of this code turned a woodcut's lines into a cloth's weave.
const SCENE_PRICE: f64 = 1.3 * PRICE;

/// Price of a factor that is to stay: fifty times that of one that is sought.
const HELD: f64 = 50.0 * PRICE;

/// Parts of large shapes: the painting's and the scene's.
const N_SHAPES: usize = 2;

/// Largest factors of the painting's large shapes and of the scene's.
const MOST_LOCAL: f64 = 1.5;
const MOST_SHAPES: f64 = 4.0;

/// The usual factor of the scene's own detail under patches, beside [`Brush::scene`]. They follow the scene by
/// themselves, and more of it would show as a second texture.
const UNDER_PATCHES: f32 = 0.4;

/// Rounds in which palette and tone are corrected: each disturbs the other a little.
const ROUNDS: usize = 2;

/// Power by which the aim of a band rises with what is missing of it, and the largest rise. If aimed more often, things as small
/// as a boat fade.
const HIGHER: f64 = 0.7;
const MOST_HIGHER: f64 = 3.0;

/// Share of the way that the hue of a color which the painting does not have moves to the painting's nearest color.
const TO_PALETTE: f32 = 0.8;

/// Colors leave the range of a display by at most this. Gaussians that overlap blur what they carry: on three scenes random
/// colors are drawn with 0.35 to 0.53 of their deviation. So single ones must go beyond the range for pictures to have
/// the painting's contrast.
const OVERSHOOT: f32 = 1.0;

/// Colors `[N]` of `scene`, which `surface` was made from, painted with a mix of paints. Weights are normalized to sum 1.
/// `content` c keeps that share of the base colors, 0..1. Colors are display-referred and may leave 0..1 by up to 1.
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
        return surface.base().iter().map(|color| color.to_array()).collect();
    }
    let mut colors: Vec<Vec3> = surface.base().iter().map(|color| *color * (1.0 - styled) as f32).collect();
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
    let recolored = |color: &Vec3| Vec3::from(recoloring.color(color.to_array()));
    let seed_colors: Vec<Vec3> = surface.seed_colors.iter().map(recolored).collect();
    let placements = place(scene, surface, &seed_colors, paint, &canvas);
    let levels: Vec<Vec<Vec3>> =
        surface.levels.iter().map(|level| level.par_iter().map(recolored).collect()).collect();
    let spectrum = spectrum(&canvas.luminance(), [paint.width, paint.height]);
    // Factors are sought, and palette and tones corrected, for whatever Gaussians have read: once or twice, the second time for
    // an aim that makes up for what correcting takes away.
    let added_up = |readings: &[Reading], brush: Brush, twice: bool| {
        let (parts, ranges) = parts(readings, &levels, &surface.fine, brush);
        let products = surface.proofs.products(&parts);
        let with = |gains: &[f64]| {
            let sum = |i: usize| parts.iter().zip(gains).map(|(part, gain)| part[i] * *gain as f32).sum();
            let colors = (0..surface.len()).into_par_iter().map(sum).collect();
            (0..ROUNDS)
                .fold(colors, |colors: Vec<Vec3>, _| corrected(surface, &colors, (&palette, &canvas), brush))
        };
        let first = gains(&products, &spectrum, &ranges);
        let colors = with(&first);
        if !twice {
            return colors;
        }
        let energies = surface.proofs.products(std::slice::from_ref(&colors)).map(|product| product[0]);
        let aim = corrected_aim(&spectrum, &energies);
        with(&gains(&products, &aim, &detail_from(&first, &ranges)))
    };
    let mut readings: Vec<Reading> =
        (0..surface.len()).into_par_iter().map(|i| read(scene, surface, &canvas, &placements, i)).collect();
    let Some(patches) = (brush.patches > 0.0).then(|| Patches::new(paint)).flatten() else {
        return added_up(&readings, brush, true);
    };
    let colors = added_up(&readings, brush, false);
    surface.sheets.read(&colors, &patches, brush.patches, &mut readings);
    let under = 1.0 + brush.patches.min(1.0) * (UNDER_PATCHES - 1.0);
    added_up(&readings, Brush { scene: under * brush.scene, ..brush }, true)
}

/// The spectrum to aim at for the painting's `spectrum`, if aiming at the latter gave a picture these `energies`: palette and
/// tone, which are corrected last, take fine detail away.
fn corrected_aim(spectrum: &[f64; N_BANDS], energies: &[f64; N_BANDS]) -> [f64; N_BANDS] {
    let total: f64 = energies.iter().sum();
    std::array::from_fn(|band| {
        // At least what is aimed at in any case. Nothing is shown if the total is 0.
        let missed = spectrum[band].max(LEAST_SHARE) / (energies[band] / total).max(LEAST_SHARE);
        spectrum[band] * missed.powf(HIGHER).clamp(1.0 / MOST_HIGHER, MOST_HIGHER)
    })
}

/// Ranges for a second search, which starts from the factors of the `first` and leaves large shapes, the last two parts, nearly as
/// they are: what is missing is detail, and a scene whose shapes become the painting's is lost.
fn detail_from(first: &[f64], ranges: &[Range]) -> Vec<Range> {
    let n_detail = ranges.len() - N_SHAPES;
    let range = |(i, (usual, range)): (usize, (&f64, &Range))| {
        let price = if i < n_detail { range.price } else { HELD };
        Range { usual: *usual, price, ..*range }
    };
    first.iter().zip(ranges).enumerate().map(range).collect()
}

/// The parts `[K]` of a painted scene, each `[N]`, which are to be added up with factors, and the factors' ranges: bands
/// of the scene's own detail and of the painting's, and large shapes with what is protected.
fn parts(
    readings: &[Reading],
    levels: &[Vec<Vec3>],
    fine: &[f32],
    brush: Brush,
) -> (Vec<Vec<Vec3>>, Vec<Range>) {
    let (own, shapes) = (&levels[0], &levels[levels.len() - 1]);
    let n = own.len();
    let cover: Vec<f32> = fine.iter().map(|fine| 1.0 - brush.protection * fine).collect();
    let mean = |colors: &mut dyn Iterator<Item = Vec3>| colors.sum::<Vec3>() / n.max(1) as f32;
    let apart = mean(&mut readings.iter().map(|(low, _)| *low)) - mean(&mut shapes.iter().copied());

    let mut parts: Vec<Vec<Vec3>> = Vec::new();
    for (finer, coarser) in levels.iter().zip(&levels[1..]) {
        parts.push((0..n).map(|i| (finer[i] - coarser[i]) * cover[i]).collect());
    }
    for band in 0..N_DETAILS {
        parts.push(readings.iter().zip(&cover).map(|((_, detail), cover)| detail[band] * *cover).collect());
    }
    parts.push((0..n).map(|i| (readings[i].0 - shapes[i] - apart) * cover[i]).collect());
    parts.push((0..n).map(|i| shapes[i] + (own[i] - shapes[i]) * (1.0 - cover[i])).collect());
    let range = |usual: f32, most: f64| Range { usual: f64::from(usual).max(0.0), most, price: PRICE };
    let of_scene = Range { price: SCENE_PRICE, ..range(brush.scene, MOST_SCENE) };
    let ranges = std::iter::repeat_n(of_scene, levels.len() - 1)
        .chain(std::iter::repeat_n(range(brush.paint, MOST_PAINT), N_DETAILS))
        .chain([range(brush.local_color, MOST_LOCAL), range(1.0, MOST_SHAPES)]);
    (parts, ranges.collect())
}

/// Colors `[N]` such that pictures have the palette's mean and covariance, and nearly the painting's dark, bright and
/// hues.
fn corrected(
    surface: &Surface,
    colors: &[Vec3],
    (palette, canvas): (&ColorMoments, &Canvas),
    brush: Brush,
) -> Vec<Vec3> {
    let shown = surface.proofs.pixels(colors);
    let recoloring = Recoloring::new(&moments(&shown, &surface.visibility, colors), palette);
    let recolored = |color: &Vec3| Vec3::from(recoloring.color(color.to_array()));
    // Blend weights sum to 1, so recolored Gaussians show recolored pictures.
    let tones = Tones::new(shown.par_iter().map(|color| recolored(color).dot(LUMINANCE)).collect());
    let curve = Curve::new(&tones, &canvas.tones);
    let range = (Vec3::splat(-OVERSHOOT), Vec3::splat(1.0 + OVERSHOOT));
    let toned = |color: Vec3| {
        let luminance = color.dot(LUMINANCE);
        (color + brush.tone * (curve.at(luminance) - luminance)).clamp(range.0, range.1)
    };
    let hued = |color: Vec3| canvas.palette.toward(color, TO_PALETTE).clamp(range.0, range.1);
    colors.par_iter().map(|color| hued(toned(recolored(color)))).collect()
}

/// The painting's color and bands of its detail at Gaussian `i`.
fn read(scene: &Scene, surface: &Surface, canvas: &Canvas, placements: &[Placement], i: usize) -> Reading {
    let (mut low, mut details) = (Vec3::ZERO, [Vec3::ZERO; N_DETAILS]);
    // Seeds without a weight stand at the end of most lists.
    for (j, weight) in surface.seeds.read[i].into_iter().filter(|(_, weight)| *weight > 0.0) {
        let offset = scene.means[i] - surface.seeds.seeds[j as usize].at;
        let at = placements[j as usize].read_at(offset, surface.pixel);
        let (its_low, its_details) = canvas.read(at, surface.footprints[i]);
        low += weight * its_low;
        details.iter_mut().zip(its_details).for_each(|(sum, detail)| *sum += weight * detail);
    }
    (low, details)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_that_shows_too_little_is_aimed_at_higher() {
        let spectrum = [0.2, 0.1, 0.1, 0.1, 0.2, 0.3];
        let same = corrected_aim(&spectrum, &spectrum.map(|share| 7.0 * share));
        assert!(same.iter().zip(&spectrum).all(|(a, b)| (a - b).abs() < 1e-12), "{same:?}");
        // Half of the finest band is missing, and is in the coarsest. Of the second all is missing.
        let aim = corrected_aim(&spectrum, &[0.1, 0.0, 0.1, 0.1, 0.2, 0.5]);
        assert!((aim[0] / (0.2 * 2.0_f64.powf(HIGHER)) - 1.0).abs() < 1e-9);
        assert!((aim[1] / (0.1 * MOST_HIGHER) - 1.0).abs() < 1e-9);
        assert!(aim[2] == spectrum[2] && aim[5] < spectrum[5]);
        assert!(corrected_aim(&spectrum, &[0.0; N_BANDS]).iter().all(|share| share.is_finite()));
    }

    #[test]
    fn a_second_search_changes_detail_and_keeps_shapes() {
        // Six parts that each give energy 1 in a band of their own.
        let products = std::array::from_fn(|band| {
            (0..N_BANDS * N_BANDS).map(|i| f64::from(u8::from(i == band * (N_BANDS + 1)))).collect()
        });
        let ranges = [Range { usual: 1.0, most: 10.0, price: PRICE }; N_BANDS];
        let first = gains(&products, &[0.1, 0.1, 0.2, 0.2, 0.2, 0.2], &ranges);
        let second = gains(&products, &[0.3, 0.1, 0.2, 0.2, 0.05, 0.15], &detail_from(&first, &ranges));
        let changes: Vec<f64> = second.iter().zip(&first).map(|(second, first)| second / first).collect();
        assert!(changes[0] > 1.3, "{changes:?}");
        assert!(changes[4..].iter().all(|change| (change - 1.0).abs() < 0.3), "{changes:?}");
        let free = gains(&products, &[0.3, 0.1, 0.2, 0.2, 0.05, 0.15], &ranges);
        assert!(free[4] / first[4] < 0.65, "without a price on them shapes follow: {free:?}");
    }
}
