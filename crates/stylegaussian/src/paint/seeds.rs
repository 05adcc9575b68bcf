//! Seeds: points on the scene's surfaces, a brush stroke apart, and who is near whom.

use std::{collections::HashMap, num::NonZero};

use glam::{IVec3, Mat3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::frames::{Frames, dominant, outer};

/// Seeds that a Gaussian reads from.
pub(super) const N_READ: usize = 3;

/// Seeds around a seed, whose places it may continue: those that touch it on a surface, and two more.
pub(super) const N_AROUND: usize = 8;

/// How far beyond the nearest seed others reach, in spacings. It sets the width of the seams between strokes.
const SEAM: f32 = 0.6;

/// One seed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seed {
    /// Position, in scene units.
    pub at: Vec3,
    /// Unit normal of the surface.
    pub normal: Vec3,
    /// Unit direction of strokes in the tangent plane.
    pub along: Vec3,
    /// Unit direction in the tangent plane that is nearest to up; `along` on level ground.
    pub up: Vec3,
    /// How clear `along` is, 0..1.
    pub clarity: f32,
}

/// Seeds, and the Gaussians between them.
pub(super) struct Seeds {
    /// The seeds `[M]`.
    pub seeds: Vec<Seed>,
    /// Seeds around each seed `[M]`, nearest first. Fewer than [`N_AROUND`] if there are no more.
    pub around: Vec<Vec<u32>>,
    /// Seeds that each Gaussian reads from, with weights that sum to 1 `[N]`. The first is the nearest.
    pub read: Vec<[(u32, f32); N_READ]>,
}

impl Seeds {
    /// Seeds at least `spacing` apart, where much is visible first, so that what is seen gets the best ones.
    pub fn new(means: &[Vec3], visibility: &[f32], frames: &Frames, up: Vec3, spacing: f32) -> Self {
        let points: Vec<Vec3> =
            spread(means, visibility, spacing).into_iter().map(|i| means[i as usize]).collect();
        let rows: Vec<[f64; 3]> = points.iter().map(|point| point.to_array().map(f64::from)).collect();
        let Some(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&rows).ok().filter(|_| !rows.is_empty())
        else {
            return Self { seeds: Vec::new(), around: Vec::new(), read: Vec::new() };
        };
        let nearest = |point: &Vec3, n: usize| -> Vec<(f32, u32)> {
            let n = NonZero::new(n.min(rows.len())).unwrap_or(NonZero::<usize>::MIN);
            let query = point.to_array().map(f64::from);
            let mut found: Vec<(f32, u32)> = tree
                .query(&query)
                .nearest_n::<SquaredEuclidean<f64>>(n)
                .execute()
                .into_iter()
                .map(|item| (item.distance.sqrt() as f32, item.item))
                .collect();
            found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            found
        };
        let around = |i: usize| {
            let others = nearest(&points[i], N_AROUND + 1).into_iter().map(|(_, j)| j);
            others.filter(|&j| j as usize != i).take(N_AROUND).collect()
        };
        let read: Vec<_> = means.par_iter().map(|mean| shares(&nearest(mean, N_READ + 1), spacing)).collect();
        let seeds = oriented(&points, &read, visibility, frames, up);
        Self { seeds, around: (0..points.len()).into_par_iter().map(around).collect(), read }
    }

    /// Means of per-Gaussian `values` `[N, C]` over the Gaussians that are nearest to each seed `[M, C]`, weighted.
    pub fn pooled(&self, values: &[f32], c: usize, weights: &[f32]) -> Vec<f32> {
        let mut sums = vec![0.0_f64; self.seeds.len() * c];
        let mut totals = vec![0.0_f64; self.seeds.len()];
        for ((row, read), weight) in values.chunks_exact(c.max(1)).zip(&self.read).zip(weights) {
            let (seed, weight) = (read[0].0 as usize, f64::from(weight + UNSEEN));
            totals[seed] += weight;
            let sums = &mut sums[seed * c..(seed + 1) * c];
            sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * f64::from(*value));
        }
        sums.iter().enumerate().map(|(i, sum)| (sum / totals[i / c]) as f32).collect()
    }
}

/// Added to visibilities, in pixels, so that seeds of which nothing is seen have a mean as well.
const UNSEEN: f32 = 1e-3;

/// Gaussians at least `spacing` apart, chosen by falling visibility.
fn spread(means: &[Vec3], visibility: &[f32], spacing: f32) -> Vec<u32> {
    let mut order: Vec<u32> = (0..means.len() as u32).collect();
    order.par_sort_unstable_by(|&a, &b| {
        visibility[b as usize].total_cmp(&visibility[a as usize]).then(a.cmp(&b))
    });
    let mut cells: HashMap<IVec3, Vec<u32>> = HashMap::new();
    let cell_of = |point: Vec3| (point / spacing).floor().as_ivec3();
    let mut chosen = Vec::new();
    for i in order {
        let (point, cell) = (means[i as usize], cell_of(means[i as usize]));
        let is_free = neighborhood(cell).all(|near| {
            let there = cells.get(&near);
            there.is_none_or(|there| {
                there.iter().all(|&j| means[j as usize].distance_squared(point) >= spacing * spacing)
            })
        });
        if is_free {
            cells.entry(cell).or_default().push(i);
            chosen.push(i);
        }
    }
    chosen
}

/// A cell and the 26 around it. Coordinates far outside saturate, where cells are shared and only get slower.
fn neighborhood(cell: IVec3) -> impl Iterator<Item = IVec3> {
    (0..27).map(move |i| cell.saturating_add(IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1)))
}

/// Seeds by falling weight, from the nearest ones with their distances (one more than are read, which gets none).
fn shares(nearest: &[(f32, u32)], spacing: f32) -> [(u32, f32); N_READ] {
    let (first, seed) = nearest[0];
    let mut shares = [(seed, 0.0); N_READ];
    let reach = first + SEAM * spacing;
    for (share, &(distance, seed)) in shares.iter_mut().zip(nearest) {
        // A high power: seams are narrow, since a mean of two strokes is no stroke.
        *share = (seed, (1.0 - distance / reach).max(0.0).powi(8));
    }
    let total: f32 = shares.iter().map(|(_, weight)| weight).sum();
    // The nearest seed's weight is above 0 unless distances overflow.
    if total > 0.0 {
        shares.iter_mut().for_each(|(_, weight)| *weight /= total);
    } else {
        shares[0].1 = 1.0;
    }
    shares
}

/// Seeds at `points` with the mean normal and direction of the Gaussians nearest to them.
fn oriented(
    points: &[Vec3],
    read: &[[(u32, f32); N_READ]],
    visibility: &[f32],
    frames: &Frames,
    up: Vec3,
) -> Vec<Seed> {
    let mut normals = vec![Mat3::ZERO; points.len()];
    let mut directions = vec![Mat3::ZERO; points.len()];
    let mut totals = vec![0.0; points.len()];
    for (i, read) in read.iter().enumerate() {
        let (seed, weight) = (read[0].0 as usize, visibility[i] + UNSEEN);
        totals[seed] += weight;
        // Products, because neither has a sign.
        normals[seed] += outer(frames.normals[i], frames.normals[i]) * weight;
        directions[seed] += outer(frames.directions[i], frames.directions[i]) * (weight * frames.clarity[i]);
    }
    let seed = |i: usize| {
        let normal = dominant(normals[i]);
        let in_plane = |v: Vec3| v.reject_from_normalized(normal);
        let mean = dominant(directions[i]);
        let clarity = mean.dot(directions[i] * mean) / totals[i].max(f32::MIN_POSITIVE);
        let along = in_plane(mean).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
        // Within 17 degrees of level there is no up: noise would turn it anywhere.
        let up = Some(in_plane(up)).filter(|up| up.length() > 0.3).map_or(along, Vec3::normalize);
        Seed { at: points[i], normal, along, up, clarity }
    };
    (0..points.len()).map(seed).collect()
}
