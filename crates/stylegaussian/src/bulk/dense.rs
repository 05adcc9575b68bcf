//! The dense part of a scene: the thing, without its surroundings.
//!
//! Sparse Gaussians are far from their neighbors. Leaving out all those beyond some distance leaves a share n
//! of the Gaussians in a box of some radius r. Surroundings are few but far, so without them r falls much and n
//! little. The part with the largest n / r^0.4 is the thing, or all of the scene if that is best.

use glam::Vec3;

use super::{before_backdrop, radius};
use crate::{Neighbors, Scene, random::hash};

/// Size of the sample whose distances are compared.
const N_SAMPLE: usize = 8000;
/// Fewer Gaussians have no surroundings.
const FEWEST: usize = 64;
/// The neighbor to which the distance of a Gaussian is taken: far enough to tell a pair from a surface.
const NEIGHBOR: usize = 8;
/// Factor between two distances that are tried.
const STEP: f32 = std::f32::consts::SQRT_2;
/// The share of the dense part on either side of its box, along each axis.
const OUTSIDE: f64 = 0.03;
/// Least share of the scene that is a thing.
const LEAST_SHARE: f64 = 0.1;
/// Exponent of r. At 10 times the radius a background of three fifths is left out, and at 100 times one of five
/// sixths. A floor of three times the radius that has two fifths of the Gaussians belongs to the thing.
const EXPONENT: f64 = 0.4;
/// Factor of r beyond which it matters no more. Less than an eighth of the scene is never a thing then, however
/// small it is: it may be a few Gaussians in one point.
const FARTHEST: f64 = 180.0;
/// Room around the box, in its radii, in which the thin ends of the thing lie.
const ROOM: f32 = 0.3;

/// The smallest and the largest corner of the box that holds the dense part of a scene, or `None` if it is too
/// small to have one, or all in one point. It does not depend on the order of the Gaussians.
pub(crate) fn region(scene: &Scene) -> Option<[Vec3; 2]> {
    let before = before_backdrop(scene);
    let is_near = |mean: Vec3| before.is_none_or(|(middle, limit)| mean.distance(middle) < limit);
    let sample = sample(&scene.means, |mean| mean.is_finite() && is_near(mean), N_SAMPLE);
    if sample.len() < FEWEST {
        return None;
    }
    let [low, high] = densest(&sample)?;
    let room = Vec3::splat(ROOM * radius([low, high]));
    Some([low - room, high + room])
}

/// The box of the dense part.
fn densest(means: &[Vec3]) -> Option<[Vec3; 2]> {
    let sparsity = sparsity(means);
    let mut distances = sparsity.clone();
    distances.sort_by(f32::total_cmp);
    let sorted = [0, 1, 2].map(|axis| {
        let mut along: Vec<(f32, usize)> = means.iter().map(|mean| mean[axis]).zip(0..).collect();
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        along
    });
    // The box of the n points that are so near to their neighbors.
    let corners = |limit: f32, n: usize| {
        let n_outside = (OUTSIDE * n as f64) as usize;
        let is_dense = |&&(_, i): &&(f32, usize)| sparsity[i] <= limit;
        let value = |found: Option<&(f32, usize)>| found.map_or(0.0, |&(value, _)| value);
        let low = sorted.each_ref().map(|along| value(along.iter().filter(is_dense).nth(n_outside)));
        let high = sorted.each_ref().map(|along| value(along.iter().rev().filter(is_dense).nth(n_outside)));
        [Vec3::from(low), Vec3::from(high)]
    };
    let whole = f64::from(radius(corners(f32::INFINITY, means.len())));
    let mut best: Option<(f64, [Vec3; 2])> = None;
    let mut n = (LEAST_SHARE * means.len() as f64) as usize;
    while n < means.len() {
        // From the next distance on, so that a gap of many powers of ten takes one step.
        let limit = STEP * distances[n];
        n = distances.partition_point(|&distance| distance <= limit);
        let found = corners(limit, n);
        let size = f64::from(radius(found));
        if size > 0.0 {
            let score = n as f64 / size.max(whole / FARTHEST).powf(EXPONENT);
            // Of equal scores, the larger part.
            if best.is_none_or(|(most, _)| score >= most) {
                best = Some((score, found));
            }
        }
    }
    best.map(|(_, found)| found)
}

/// The distance of each point from one of its neighbors.
fn sparsity(means: &[Vec3]) -> Vec<f32> {
    let order: Vec<u32> = (0..means.len() as u32).collect();
    let neighbors = Neighbors::find(means, &order, NEIGHBOR + 1);
    let farthest = |(mean, row): (&Vec3, &[u32])| {
        // In f64, where no square overflows.
        let distance =
            row.last().map_or(0.0, |&other| means[other as usize].as_dvec3().distance(mean.as_dvec3()));
        distance.min(f64::from(f32::MAX)) as f32
    };
    means.iter().zip(neighbors.indices.chunks_exact(NEIGHBOR + 1)).map(farthest).collect()
}

/// At most `n` of the `wanted` points. They depend on the points alone and not on their order: those with the
/// least hashes.
pub(crate) fn sample(points: &[Vec3], wanted: impl Fn(Vec3) -> bool, n: usize) -> Vec<Vec3> {
    let up_to = |most: u64| {
        let wanted = points.iter().copied().filter(|&point| wanted(point));
        wanted.map(|point| (key(point), point)).filter(|&(key, _)| key <= most).collect::<Vec<_>>()
    };
    // Twice as many as are needed, to save the memory of all others.
    let share = (2 * n) as f64 / points.len().max(1) as f64;
    let mut keyed = up_to((share * u64::MAX as f64) as u64);
    if keyed.len() < n {
        keyed = up_to(u64::MAX);
    }
    if keyed.len() > n {
        // Equal hashes are equal points.
        keyed.select_nth_unstable_by_key(n, |&(key, _)| key);
        keyed.truncate(n);
    }
    keyed.into_iter().map(|(_, point)| point).collect()
}

/// A hash of a point. Zero has two signs, which are one point.
fn key(point: Vec3) -> u64 {
    let bits = (point + Vec3::ZERO).to_array().map(|coordinate| u64::from(coordinate.to_bits()));
    bits.into_iter().fold(0, |key, bits| hash(key ^ (bits + 1)))
}
