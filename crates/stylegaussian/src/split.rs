//! Splitting Gaussians that are larger than a brush stroke. Each has one color, so no stroke on it can be
//! finer.
//!
//! A Gaussian becomes two *parts* side by side along the axis that looks longest, and those are split again
//! while they are too large. Parts keep the index of their source Gaussian in [`Scene::order`].
//!
//! The picture must stay, so the moments that are kept are those of the drawn alpha. In units of the Gaussian's
//! own standard deviations, its parts at -d and d with deviation p along the split axis and q across have
//! footprints a = o' exp(-(x + d)^2 / 2p^2 - y^2 / 2q^2) and b, its mirror image. Blended they give a + b - ab,
//! where ab is a Gaussian as well: o'^2 e exp(-x^2 / p^2 - y^2 / q^2) with e = exp(-d^2 / p^2). Let u = o' e /
//! 4, the share of the overlap. Then a + b - ab has the mass, the mean and both variances of o exp(-x^2 / 2 -
//! y^2 / 2) if
//!
//! ```text
//! mass             2 p q o' (1 - u) = o
//! variance along   p^2 (1 - u/2) + d^2 = 1 - u
//! variance across  q^2 (1 - u/2) = 1 - u
//! ```
//!
//! For faint Gaussians u is 0, and this is the split that keeps the moments of the density: p^2 = 1 - d^2, q =
//! 1.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::{UVec2, Vec3};
use rayon::prelude::*;

use crate::{
    camera::Camera,
    scene::Scene,
    splat::{Colors, Projection, blend_weights, blend_weights_if_wanted, render},
    views::choose_views,
    work::{Canceled, Work},
};

mod paint;

pub use paint::split_paint;

/// How a Gaussian is split.
#[derive(Clone, Copy)]
struct Manner {
    /// d, the distance of a part from the middle, in standard deviations of the Gaussian that is split. Parts
    /// farther apart are smaller, and leave a dent between them: at 0.5 the drawn alpha of an opaque Gaussian
    /// changes by 9% of its norm, at 0.6 by 12%, at 0.7 by 18%.
    distance: f64,
    /// Splits that lead from a Gaussian to its smallest parts, at most.
    rounds: u8,
}

/// The manner of [`split`]: 16 parts at most.
const KEEPING: Manner = Manner { distance: 0.5, rounds: 4 };

/// Number and size in pixels of the views in which footprints are measured.
const N_VIEWS: usize = 24;
const VIEW_SIZE: UVec2 = UVec2::splat(512);

/// One in this many views is compared before and after.
const COMPARE_EVERY: usize = 3;

/// Gain over the wanted fidelity in the views that are compared, in dB. Other views are up to 1 dB worse.
const MARGIN: f64 = 1.0;

/// Tries to keep the fidelity, each with fewer splits.
const MAX_TRIES: usize = 6;

/// Which Gaussians [`split`] splits, and how often.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitOptions {
    /// The largest number of Gaussians afterward, in those before; 1 or less splits none.
    pub factor: f64,
    /// The standard deviation, in pixels of a view of 512 pixels, above which a Gaussian is split.
    pub largest: f32,
    /// The least PSNR of the new picture against the old one, in dB: so few are split that it is kept.
    pub fidelity: f64,
}

impl Default for SplitOptions {
    /// Twice the Gaussians at most. 2 pixels are 8 from edge to edge, the width of a stroke in a painting of
    /// that size.
    fn default() -> Self {
        Self { factor: 2.0, largest: 2.0, fidelity: 40.0 }
    }
}

/// Splits the Gaussians of `scene` that look larger than a stroke, those that fill most of the views first, and
/// returns the number of Gaussians added.
///
/// Fewer are split, or none, if the picture would change more than [`SplitOptions::fidelity`] allows. Parts
/// inherit colors, features and extra inputs. The scene ends in Morton order. If anything was split, it has no
/// neighbor lists, as the old ones would be wrong. Views are those that [`choose_views`] chooses.
pub fn split(scene: &mut Scene, options: SplitOptions) -> usize {
    let before = scene.len();
    // Saturating: a factor may be infinite. Indices have 32 bits.
    let most = ((before as f64 * options.factor) as usize).min(u32::MAX as usize);
    if most <= before {
        return 0;
    }
    let views = choose_views(scene, N_VIEWS, VIEW_SIZE);
    // Nobody cancels it.
    let Ok(mut whole) = whole(scene, &views, &Work::default()) else { return 0 };
    let compared: Vec<&Camera> = views.iter().step_by(COMPARE_EVERY).collect();
    // The mean square error of colors in 0..1 at the wanted PSNR.
    let allowed = 10f64.powf(-(options.fidelity + MARGIN) / 10.0);
    for _ in 0..MAX_TRIES {
        let is_large = |part: &Part| part.footprint.max_element() > options.largest;
        let parts =
            parts(scene, &whole, most, KEEPING, |part| if is_large(part) { part.visible } else { 0.0 });
        let n_added = parts.len() - before;
        if n_added == 0 {
            break;
        }
        let mut split = assembled(scene, &parts);
        let changes: Vec<Vec<f32>> =
            compared.iter().map(|camera| squared_changes(scene, &split, camera)).collect();
        let change = changes.iter().map(|change| mean(change)).sum::<f64>() / changes.len() as f64;
        if change <= allowed {
            split.sort_by_morton();
            *scene = split;
            return n_added;
        }
        let blamed = blamed(scene, &compared, &changes);
        keep_whole(&mut whole, &parts, &blamed, 1.0 - allowed / change);
    }
    0
}

/// Blame of each Gaussian for the change of the pictures `[N]`: its pixels in `views`, and their change, both
/// summed by blend weights.
fn blamed(scene: &Scene, views: &[&Camera], changes: &[Vec<f32>]) -> Vec<[f32; 2]> {
    let mut sums = vec![[0.0; 2]; scene.len()];
    for (camera, changes) in views.iter().zip(changes) {
        let pixels: Vec<f32> = changes.iter().flat_map(|change| [1.0, *change]).collect();
        let of_view = blend_weights(scene, camera).apply_transposed(&pixels, 2);
        for (sum, value) in sums.as_flattened_mut().iter_mut().zip(of_view) {
            *sum += value;
        }
    }
    sums
}

/// Excludes from splitting the Gaussians whose split would change the render most, until `share` of the change
/// that is blamed on split Gaussians is gone. Large Gaussians on an even surface change nothing, and are split.
fn keep_whole(whole: &mut [Part], parts: &[Part], blamed: &[[f32; 2]], share: f64) {
    let mut is_split = vec![false; whole.len()];
    parts.iter().filter(|part| part.rounds > 0).for_each(|part| is_split[part.gaussian as usize] = true);
    let mut order: Vec<usize> = (0..whole.len()).filter(|&i| is_split[i]).collect();
    let per_pixel = |i: usize| blamed[i][1] / blamed[i][0].max(f32::MIN_POSITIVE);
    // The sort is stable, so equal ones stay in order.
    order.sort_by(|&a, &b| per_pixel(b).total_cmp(&per_pixel(a)));
    let total: f64 = order.iter().map(|&i| f64::from(blamed[i][1])).sum();
    let mut sum = 0.0;
    for i in order {
        // Gaussians that no view shows are not split.
        whole[i].visible = 0.0;
        sum += f64::from(blamed[i][1]);
        if sum >= share * total {
            break;
        }
    }
}

/// The mean square difference of the captured colors of two scenes over mid-gray, as `camera` sees them. Colors
/// are in 0..1, so -10 log10 of it is the PSNR in dB.
pub fn picture_change(before: &Scene, after: &Scene, camera: &Camera) -> f64 {
    mean(&squared_changes(before, after, camera))
}

/// The same for each pixel.
fn squared_changes(before: &Scene, after: &Scene, camera: &Camera) -> Vec<f32> {
    let [before, after] = [before, after].map(|scene| {
        let picture = render(scene, Colors::Captured, camera);
        let over_gray =
            |(color, alpha): (&[f32; 3], &f32)| color.map(|c| (c + 0.5 * (1.0 - alpha)).clamp(0.0, 1.0));
        picture.color.iter().zip(&picture.alpha).map(over_gray).collect::<Vec<_>>()
    });
    let square = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>() / 3.0;
    before.iter().zip(&after).map(square).collect()
}

/// The mean in f64, or 0 if there are no values.
fn mean(values: &[f32]) -> f64 {
    values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len().max(1) as f64
}

/// The scene of all `parts` of `scene`, in their order.
fn assembled(scene: &Scene, parts: &[Part]) -> Scene {
    let sources: Vec<u32> = parts.iter().map(|part| part.gaussian).collect();
    let mut split = scene.subset(&sources);
    // They were renumbered to one part of each Gaussian.
    split.neighbors = None;
    for (i, part) in parts.iter().enumerate() {
        split.means[i] = part.mean;
        split.scales[i] = part.scales;
        split.opacities[i] = part.opacity;
    }
    split
}

/// A Gaussian or a part of one.
#[derive(Clone, Copy)]
struct Part {
    /// Its Gaussian in the scene.
    gaussian: u32,
    mean: Vec3,
    scales: Vec3,
    opacity: f32,
    /// Standard deviation of the footprint along each axis, in pixels, averaged over its visible pixels.
    footprint: Vec3,
    /// Blend weights summed over all views, in pixels.
    visible: f32,
    /// Number of splits that led to it.
    rounds: u8,
}

impl Part {
    /// The two parts of this one.
    fn halves(&self, scene: &Scene, distance: f64) -> [Self; 2] {
        let Halves { along, across, opacity } = Halves::of(f64::from(self.opacity), distance);
        let axis = Vec3::AXES[self.footprint.max_position()];
        let shrink = Vec3::splat(across) + (along - across) * axis;
        let offset = scene.rotations[self.gaussian as usize] * (distance as f32 * self.scales * axis);
        [-offset, offset].map(|offset| Self {
            mean: self.mean + offset,
            scales: self.scales * shrink,
            opacity,
            footprint: self.footprint * shrink,
            visible: self.visible / 2.0,
            rounds: self.rounds + 1,
            ..*self
        })
    }
}

/// Solution of [the module's equations](self) for one opacity.
struct Halves {
    /// p, the deviation along the split axis in that of the whole.
    along: f32,
    /// q, the deviation across.
    across: f32,
    /// o', 0..1.
    opacity: f32,
}

impl Halves {
    /// Solves for the parts of a Gaussian of opacity o, 0..=1, at a distance of up to 0.7 from its middle.
    fn of(o: f64, distance: f64) -> Self {
        let d2 = distance * distance;
        let shape =
            |u: f64| (((1.0 - u - d2) / (1.0 - u / 2.0)).sqrt(), ((1.0 - u) / (1.0 - u / 2.0)).sqrt());
        let opacity = |u: f64, p: f64| 4.0 * u * (d2 / (p * p)).exp();
        // The mass 2 p q o' (1 - u) grows with u from 0 to 1.4 at u = 0.2, so one u gives o. 40 halvings leave
        // 2e-13.
        let (mut low, mut high) = (0.0, 0.2);
        for _ in 0..40 {
            let u = f64::midpoint(low, high);
            let (p, q) = shape(u);
            let mass = 2.0 * p * q * opacity(u, p) * (1.0 - u);
            *(if mass < o { &mut low } else { &mut high }) = u;
        }
        let (p, q) = shape(low);
        Self { along: p as f32, across: q as f32, opacity: opacity(low, p) as f32 }
    }
}

/// Splits the Gaussians of `scene` into at most `most` parts: always the one of the largest `weight`, the first
/// of equal ones, and none of weight 0.
fn parts(
    scene: &Scene,
    whole: &[Part],
    most: usize,
    manner: Manner,
    weight: impl Fn(&Part) -> f32,
) -> Vec<Part> {
    let mut parts = whole.to_vec();
    let place = |parts: &[Part], position: usize| {
        let part = &parts[position];
        let weight = weight(part);
        // Positive floats compare like their bits.
        (weight > 0.0 && part.rounds < manner.rounds).then_some((weight.to_bits(), Reverse(position)))
    };
    let mut queue: BinaryHeap<_> = (0..parts.len()).filter_map(|i| place(&parts, i)).collect();
    while parts.len() < most
        && let Some((_, Reverse(position))) = queue.pop()
    {
        let [first, second] = parts[position].halves(scene, manner.distance);
        parts[position] = first;
        parts.push(second);
        queue.extend(place(&parts, position));
        queue.extend(place(&parts, parts.len() - 1));
    }
    parts
}

/// Each Gaussian as its only part, measured in `views`.
///
/// # Errors
/// If `work` is canceled.
fn whole(scene: &Scene, views: &[Camera], work: &Work) -> Result<Vec<Part>, Canceled> {
    let mut parts: Vec<Part> = (0..scene.len())
        .map(|i| Part {
            gaussian: i as u32,
            mean: scene.means[i],
            scales: scene.scales[i],
            opacity: scene.opacities[i],
            footprint: Vec3::ZERO,
            visible: 0.0,
            rounds: 0,
        })
        .collect();
    for (i, camera) in views.iter().enumerate() {
        work.at(i as f32 / views.len() as f32)?;
        let weights = blend_weights_if_wanted(scene, camera, 0.0, work)?;
        // The transpose applied to ones sums each Gaussian's weights over the picture.
        let pixels = weights.apply_transposed(&vec![1.0; camera.size.element_product() as usize], 1);
        let projection = Projection::new(camera);
        parts.par_iter_mut().zip(&pixels).enumerate().filter(|(_, (_, pixels))| **pixels > 0.0).for_each(
            |(i, (part, pixels))| {
                part.footprint += pixels * projection.axes_in_pixels(scene, i);
                part.visible += pixels;
            },
        );
    }
    for part in parts.iter_mut().filter(|part| part.visible > 0.0) {
        part.footprint /= part.visible;
    }
    Ok(parts)
}

#[cfg(test)]
mod tests;
