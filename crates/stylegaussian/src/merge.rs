//! Levels of detail: fewer Gaussians that look like all of them from farther away.
//!
//! Gaussians that are near one another and alike become one. Seen along a unit vector d, a Gaussian with
//! opacity o, covariance S and deviations a, b, c has the optical depth 2 pi Li2(o) sqrt(d . cof(S) d), summed
//! over the picture, where Li2 is the dilogarithm. The mean of d . cof(S) d over all d is a third of the trace
//! of cof(S), so up to a factor that all have in common, the depth is
//!
//! ```text
//! t = Li2(o) A          A^2 = (a^2 b^2 + b^2 c^2 + c^2 a^2) / 3
//! ```
//!
//! Let w be the light that a Gaussian takes away from views around the scene, where others may hide it. A group
//! is replaced by the Gaussian with the mean and the covariance of the mixture, weighted by w. It has the depth
//! of all, if that needs no opacity above 1:
//!
//! ```text
//! W = sum w_i          m = sum w_i m_i / W          S = sum w_i (S_i + (m_i - m) (m_i - m)^T) / W
//! Li2(o) = min(Li2(1), sum t_i / A)
//! ```
//!
//! So what is within a thing, and often dark, gives its outside no color. Spherical harmonics, features, extra
//! inputs and masks are means by the same weights.
//!
//! Groups grow by pairs, in rounds. A pair costs what its means, covariances and colors differ by:
//!
//! ```text
//! w_1 w_2 / (w_1 + w_2) (|m_1 - m_2|^2 + |S_1 - S_2| + 2 tr(S) |c_1 - c_2|^2)
//! ```
//!
//! The first term is the growth of the squared distances to the mean (Ward, "Hierarchical grouping to optimize
//! an objective function", 1963). The others are in the same unit: the norm of a matrix of squared lengths, and
//! the squared size of the pair, for colors of 0..1. In a round, each group looks for its cheapest partner
//! among the next ones on a Morton curve, and pairs that choose each other are merged. The curve of each round
//! is shifted, so that no border of its cells stays one.

use glam::{DMat3, DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::{
    Features, Mask, Scene,
    mask::CHANNELS,
    morton,
    scene::Sh,
    sh,
    symmetric::eigen,
    work::{Canceled, Work},
};

mod opacity;
mod sight;
#[cfg(test)]
mod tests;

/// Share of the time in which views are looked at.
const VIEWS: f32 = 0.5;

/// Groups on either side along the curve in which a partner is looked for. With cells of 2 x 2 x 2, those are
/// the neighbors in the same cell.
const WINDOW: usize = 8;

/// Cells of the curve along the longest side of the scene. The shift takes as many again, and codes have 21
/// bits.
const CELLS: f64 = (1_u32 << 20) as f64;

/// Shifts along x, y and z from one round to the next, in sides of the scene: powers of 1 / g with g^4 = g + 1,
/// whose multiples fill a cube evenly (Roberts, "The unreasonable effectiveness of quasirandom sequences",
/// 2018).
const SHIFT: DVec3 = DVec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5);

/// The weight of a Gaussian that takes no light away: so small that it counts among its like alone, and so
/// large that sums and products with others' shares do not vanish.
const NO_LIGHT: f64 = 1e-200;

/// One of so many groups finds a partner in each round at least, so that all rounds together take linear time.
const LEAST_PAIRED: usize = 8;

/// A group of Gaussians.
#[derive(Clone, Copy, Debug)]
struct Group {
    mean: DVec3,
    covariance: DMat3,
    /// Sum of w, [`NO_LIGHT`] at least for each Gaussian.
    weight: f64,
    /// Sum of t.
    depth: f64,
    color: Vec3,
    /// The largest of its Gaussians.
    opacity: f32,
    /// Whether it is one Gaussian, which stays as it is.
    is_single: bool,
}

/// Merges the Gaussians of `scene` until `n` are left, at least one, as [the module](self) says. Fewer stay as
/// they are.
///
/// The result is its own source: `order` counts from 0. It has no neighbor lists. It is the same for any number
/// of threads.
///
/// # Errors
/// If `work` is canceled.
///
/// # Panics
/// If the arrays of `scene` do not fit one another.
pub fn merge(scene: &Scene, n: usize, work: &Work) -> Result<Scene, Canceled> {
    if scene.len() <= n.max(1) {
        return merge_by(scene, &vec![NO_LIGHT; scene.len()], n, work);
    }
    let lights: Vec<f64> = (0..scene.len()).into_par_iter().map(|i| light(scene, i)).collect();
    let seen = sight::seen(scene, &lights, &work.part(0.0, VIEWS))?;
    let weights: Vec<f64> = seen.into_iter().map(|light| light.max(NO_LIGHT)).collect();
    merge_by(scene, &weights, n, &work.part(VIEWS, 1.0))
}

/// As [`merge`], by these `weights` `[N]`.
fn merge_by(scene: &Scene, weights: &[f64], n: usize, work: &Work) -> Result<Scene, Canceled> {
    let colors = scene.base_colors();
    let single = |i: usize| Group {
        mean: scene.means[i].as_dvec3(),
        covariance: covariance(scene, i),
        weight: weights[i],
        depth: depth(scene, i),
        color: Vec3::from(colors[i]),
        opacity: scene.opacities[i],
        is_single: true,
    };
    let mut groups: Vec<Group> = (0..scene.len()).into_par_iter().map(single).collect();
    let mut group_from_gaussian: Vec<u32> = (0..scene.len() as u32).collect();
    let (n, before) = (n.max(1), groups.len());
    for i in 0.. {
        let merged = before - groups.len();
        work.at(merged as f32 / before.saturating_sub(n).max(1) as f32)?;
        if groups.len() <= n {
            break;
        }
        let (next, next_from_group) = round(&groups, n, i);
        groups = next;
        group_from_gaussian.par_iter_mut().for_each(|group| *group = next_from_group[*group as usize]);
    }
    let members = Members::new(&group_from_gaussian, groups.len());
    Ok(assembled(scene, &groups, &members, weights))
}

/// The light that Gaussian `i` takes away alone, in the mean over all directions: its alpha, summed over the
/// picture, over 2 pi.
fn light(scene: &Scene, i: usize) -> f64 {
    f64::from(scene.opacities[i]) * area(scene.scales[i].as_dvec3() * scene.scales[i].as_dvec3())
}

/// t of Gaussian `i`.
fn depth(scene: &Scene, i: usize) -> f64 {
    let area = area(scene.scales[i].as_dvec3() * scene.scales[i].as_dvec3());
    opacity::depth(f64::from(scene.opacities[i])) * area
}

/// A, from the variances along the axes.
fn area(variances: DVec3) -> f64 {
    let DVec3 { x, y, z } = variances;
    ((x * y + y * z + z * x) / 3.0).max(0.0).sqrt()
}

fn covariance(scene: &Scene, i: usize) -> DMat3 {
    let axes = DMat3::from_quat(scene.rotations[i].as_dquat());
    let half = axes * DMat3::from_diagonal(scene.scales[i].as_dvec3());
    half * half.transpose()
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// One round: the new groups, not fewer than `n`, along the curve, and the new group of each old one.
fn round(groups: &[Group], n: usize, number: usize) -> (Vec<Group>, Vec<u32>) {
    let order = curve(groups, number);
    let sorted: Vec<Group> = order.par_iter().map(|&i| groups[i as usize]).collect();
    let mut pairs = pairs(&sorted);
    let excess = groups.len() - n;
    if pairs.len() > excess {
        let by_cost = |a: &Pair, b: &Pair| a.cost.total_cmp(&b.cost).then(a.first.cmp(&b.first));
        pairs.select_nth_unstable_by(excess, by_cost);
        pairs.truncate(excess);
    }
    let mut partner = vec![None; sorted.len()];
    for pair in &pairs {
        (partner[pair.first], partner[pair.second]) = (Some(pair.second), Some(pair.first));
    }
    let mut next = Vec::with_capacity(groups.len() - pairs.len());
    let mut next_from_group = vec![0; groups.len()];
    for (i, group) in sorted.iter().enumerate() {
        let of_first = match partner[i] {
            Some(first) if first < i => next_from_group[order[first] as usize],
            Some(second) => {
                next.push(group.with(&sorted[second]));
                next.len() as u32 - 1
            }
            None => {
                next.push(*group);
                next.len() as u32 - 1
            }
        };
        next_from_group[order[i] as usize] = of_first;
    }
    (next, next_from_group)
}

/// The groups along the Morton curve of this round.
fn curve(groups: &[Group], round: usize) -> Vec<u32> {
    let none = DVec3::splat(f64::INFINITY);
    let (low, high) =
        groups.iter().fold((none, -none), |(low, high), group| (low.min(group.mean), high.max(group.mean)));
    let extent = (high - low).max_element();
    // All in one place if there is no extent.
    let cells_per_unit = if extent > 0.0 { CELLS / extent } else { 0.0 };
    let shift = CELLS * (round as f64 * SHIFT).fract();
    let mut keys: Vec<(u64, u32)> = groups
        .par_iter()
        .zip(0..groups.len() as u32)
        .map(|(group, i)| {
            // The casts saturate, so a mean that is not finite has a cell as well.
            let cell = (group.mean - low) * cells_per_unit + shift;
            (morton::code(cell.x as u32, cell.y as u32, cell.z as u32), i)
        })
        .collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|(_, i)| i).collect()
}

/// Two groups that follow each other on the curve, at some distance.
struct Pair {
    first: usize,
    second: usize,
    cost: f64,
}

/// Pairs of groups that choose each other. No group is in two of them.
fn pairs(groups: &[Group]) -> Vec<Pair> {
    let cost = |i: usize, j: usize| groups[i.min(j)].cost(&groups[i.max(j)]);
    let best: Vec<Option<(f64, usize)>> = (0..groups.len())
        .into_par_iter()
        .map(|i| {
            let around = i.saturating_sub(WINDOW)..(i + WINDOW + 1).min(groups.len());
            let costs = around.filter(|&j| j != i).map(|j| (cost(i, j), j));
            costs.min_by(|a, b| a.0.total_cmp(&b.0))
        })
        .collect();
    let chosen = |i: usize| best[i].map(|(_, j)| j);
    let mutual = |i: usize| {
        let (cost, j) = best[i]?;
        (i < j && chosen(j) == Some(i)).then_some(Pair { first: i, second: j, cost })
    };
    let mut pairs: Vec<Pair> = (0..groups.len()).filter_map(mutual).collect();
    if pairs.len() < groups.len().div_ceil(LEAST_PAIRED) {
        // Costs that fall along the curve: everyone chooses the next one, who does not choose back.
        let mut is_free = vec![true; groups.len()];
        pairs.iter().for_each(|pair| (is_free[pair.first], is_free[pair.second]) = (false, false));
        let mut i = 0;
        while i + 1 < groups.len() {
            if is_free[i] && is_free[i + 1] {
                pairs.push(Pair { first: i, second: i + 1, cost: cost(i, i + 1) });
                i += 1;
            }
            i += 1;
        }
    }
    pairs
}

impl Group {
    /// The cost of a pair, as the module has it.
    fn cost(&self, other: &Self) -> f64 {
        let share = other.weight / (self.weight + other.weight);
        let step = other.mean - self.mean;
        let change = other.covariance - self.covariance;
        let norm = (change.x_axis.length_squared() + change.y_axis.length_squared())
            + change.z_axis.length_squared();
        let trace = |m: &DMat3| m.x_axis.x + m.y_axis.y + m.z_axis.z;
        let size =
            trace(&self.covariance) + share * trace(&change) + share * (1.0 - share) * step.length_squared();
        let colors = f64::from((other.color - self.color).length_squared());
        self.weight * share * (step.length_squared() + norm.sqrt() + 2.0 * size * colors)
    }

    /// The two groups as one.
    fn with(&self, other: &Self) -> Self {
        let weight = self.weight + other.weight;
        let share = other.weight / weight;
        let step = other.mean - self.mean;
        let covariance = self.covariance + share * (other.covariance - self.covariance);
        Self {
            mean: self.mean + share * step,
            covariance: covariance + share * (1.0 - share) * outer(step),
            weight,
            depth: self.depth + other.depth,
            color: self.color.lerp(other.color, share as f32),
            opacity: self.opacity.max(other.opacity),
            is_single: false,
        }
    }
}

/// The Gaussians of each group.
struct Members {
    gaussians: Vec<u32>,
    /// The end of each group's in `gaussians`.
    ends: Vec<usize>,
}

impl Members {
    /// Sorts Gaussians by their groups, of which there are `n`, by counting.
    fn new(group_from_gaussian: &[u32], n: usize) -> Self {
        let mut ends = vec![0; n];
        group_from_gaussian.iter().for_each(|&group| ends[group as usize] += 1);
        let mut sum = 0;
        for end in &mut ends {
            // The beginning, until the Gaussians are placed.
            sum += std::mem::replace(end, sum);
        }
        let mut gaussians = vec![0; group_from_gaussian.len()];
        for (i, &group) in (0..).zip(group_from_gaussian) {
            gaussians[ends[group as usize]] = i;
            ends[group as usize] += 1;
        }
        Self { gaussians, ends }
    }

    fn of(&self, group: usize) -> &[u32] {
        let begin = if group == 0 { 0 } else { self.ends[group - 1] };
        &self.gaussians[begin..self.ends[group]]
    }

    /// The means of rows of `values` `[N, width]` over each group, by `weights` `[N]`.
    fn averages(&self, values: &[f32], width: usize, weights: &[f64]) -> Vec<f32> {
        let mut averages = vec![0.0; self.ends.len() * width];
        if width > 0 {
            averages.par_chunks_exact_mut(width).enumerate().for_each(|(group, row)| {
                let members = self.of(group);
                let total: f64 = members.iter().map(|&i| weights[i as usize]).sum();
                let mut sums = vec![0.0; width];
                for &i in members {
                    let share = weights[i as usize] / total;
                    let values = &values[i as usize * width..][..width];
                    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += share * f64::from(*value));
                }
                row.iter_mut().zip(sums).for_each(|(value, sum)| *value = sum as f32);
            });
        }
        averages
    }
}

/// The scene of all groups.
fn assembled(scene: &Scene, groups: &[Group], members: &Members, weights: &[f64]) -> Scene {
    let gaussian = |(group, moments): (usize, &Group)| {
        let i = members.of(group)[0] as usize;
        match moments.is_single {
            true => (scene.means[i], scene.rotations[i], scene.scales[i], scene.opacities[i]),
            false => {
                let (variances, mut axes) = eigen(moments.covariance);
                if axes.determinant() < 0.0 {
                    axes.x_axis = -axes.x_axis;
                }
                let variances = variances.max(DVec3::ZERO);
                let area = area(variances);
                // Points and lines have no depth, whatever their opacity.
                let opacity =
                    if area > 0.0 { opacity::opacity(moments.depth / area) as f32 } else { moments.opacity };
                let rotation = DQuat::from_mat3(&axes).normalize().as_quat();
                let scales = DVec3::from(variances.to_array().map(f64::sqrt)).as_vec3();
                (moments.mean.as_vec3(), rotation, scales, opacity)
            }
        }
    };
    let gaussians: Vec<_> = groups.par_iter().enumerate().map(gaussian).collect();
    let averages = |values: &[f32], width: usize| members.averages(values, width, weights);
    let n = groups.len();
    Scene {
        means: gaussians.iter().map(|g| g.0).collect(),
        rotations: gaussians.iter().map(|g| g.1).collect(),
        scales: gaussians.iter().map(|g| g.2).collect(),
        opacities: gaussians.iter().map(|g| g.3).collect(),
        sh: scene.sh.as_ref().map(|sh| Sh {
            degree: sh.degree,
            coefficients: averages(&sh.coefficients, 3 * sh::n_coefficients(sh.degree)),
        }),
        order: (0..n as u32).collect(),
        n_source: n,
        features: scene.features.as_ref().map(|features| Features {
            values: averages(&features.values, features.n_latent),
            extra: averages(&features.extra, features.n_extra),
            basis: features.basis.clone(),
            offset: features.offset.clone(),
            encoder: features.encoder.clone(),
            ..*features
        }),
        neighbors: None,
        mask: scene.mask.as_ref().map(|mask| {
            let bytes: Vec<f32> = mask.weights.as_flattened().iter().map(|&byte| f32::from(byte)).collect();
            let means = averages(&bytes, CHANNELS);
            let mut averaged = Mask::new(n);
            for (byte, mean) in averaged.weights.as_flattened_mut().iter_mut().zip(means) {
                *byte = mean.round() as u8;
            }
            averaged.names = mask.names.clone();
            averaged
        }),
        offset: scene.offset,
        decoder: scene.decoder.clone(),
        up: scene.up,
        cameras: scene.cameras.clone(),
        frame: scene.frame,
        filter: scene.filter,
        source: scene.source.clone(),
        license: scene.license.clone(),
    }
}
