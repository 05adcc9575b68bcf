//! Colors of the scene without their finer detail.

use glam::{IVec3, Vec3, Vec4};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// Standard deviation of averaging over a grid twice, in cells: each time, values are spread over a cell's
/// corners (variance 1/6 along an axis) and read back likewise.
const DEVIATION: f32 = 0.816;

/// Added to weights, so that unseen Gaussians have a color as well.
const UNSEEN: f32 = 1e-3;

/// A grid in space, by which values at `means` are averaged.
pub(super) struct Grid {
    /// The corners of the cell of each mean, and the mean's share of each `[N]`.
    corners: Vec<[(u32, f32); 8]>,
    n_corners: usize,
}

impl Grid {
    /// A grid that averages around each of `means` by about `sigma` scene units.
    pub fn new(means: &[Vec3], sigma: f32) -> Self {
        let mut known: FxHashMap<IVec3, u32> = FxHashMap::default();
        // Gaussians that follow one another often lie in one cell.
        let mut last: Option<(IVec3, [u32; 8])> = None;
        let mut corners = |mean: &Vec3| -> [(u32, f32); 8] {
            let at = *mean / (sigma / DEVIATION);
            let (cell, part) = (at.floor().as_ivec3(), at - at.floor());
            let beyond = |corner: i32| IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let found = match last {
                Some((of, found)) if of == cell => found,
                _ => std::array::from_fn(|corner| {
                    let n = known.len() as u32;
                    *known.entry(cell.saturating_add(beyond(corner as i32))).or_insert(n)
                }),
            };
            last = Some((cell, found));
            let share = |beyond: i32, part: f32| if beyond == 1 { part } else { 1.0 - part };
            std::array::from_fn(|corner| {
                let beyond = beyond(corner as i32);
                let share = share(beyond.x, part.x) * share(beyond.y, part.y) * share(beyond.z, part.z);
                (found[corner], share)
            })
        };
        Self { corners: means.iter().map(&mut corners).collect(), n_corners: known.len() }
    }

    /// `values` `[N]`, averaged around each mean, weighted.
    pub fn smooth(&self, values: &[Vec3], weights: &[f32]) -> Vec<Vec3> {
        let mut values = values.to_vec();
        for _ in 0..2 {
            let mut sums = vec![Vec4::ZERO; self.n_corners];
            for ((corners, value), weight) in self.corners.iter().zip(&values).zip(weights) {
                let weighted = value.extend(1.0) * (weight + UNSEEN);
                for (corner, share) in corners {
                    sums[*corner as usize] += weighted * *share;
                }
            }
            let mean = |(value, corners): (&mut Vec3, &[(u32, f32); 8])| {
                let sum: Vec4 = corners.iter().map(|(corner, share)| sums[*corner as usize] * *share).sum();
                // Above 0 unless positions are not finite.
                if sum.w > 0.0 {
                    *value = sum.truncate() / sum.w;
                }
            };
            values.par_iter_mut().zip(&self.corners).for_each(mean);
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fine_stripes_go_and_slow_changes_stay() {
        let means: Vec<Vec3> = (0..400).map(|i| Vec3::new(i as f32 * 0.25, 0.1, 0.3)).collect();
        let slow = |i: usize| i as f32 / 400.0;
        let values: Vec<Vec3> = (0..400).map(|i| Vec3::splat(slow(i) + (i % 2) as f32 * 0.4)).collect();
        let smoothed = Grid::new(&means, 3.0).smooth(&values, &[1.0; 400]);
        for (i, value) in smoothed.iter().enumerate().take(360).skip(40) {
            assert!((value.x - slow(i) - 0.2).abs() < 0.02, "{i}: {value}");
        }
        let weighted: Vec<f32> = (0..400).map(|i| (i % 2) as f32).collect();
        assert!((Grid::new(&means, 3.0).smooth(&values, &weighted)[200].x - slow(200) - 0.4).abs() < 0.02);
    }
}
