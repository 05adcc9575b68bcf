//! The bulk of a scene: a box that neither a few Gaussians far away nor its surroundings change.
//!
//! Captures show a thing and what is around it: floaters, ground, a background far away. The thing is where
//! Gaussians are dense, and `dense` is the one place that finds it: boxes, chosen cameras and viewers all ask
//! it. `backdrop` finds a sky far behind everything, which may be most of the Gaussians.

mod backdrop;
mod dense;
#[cfg(test)]
mod tests;

use glam::Vec3;

use crate::Scene;

pub use backdrop::bounds_without_backdrop;
pub(crate) use backdrop::{before_backdrop, without_backdrop};
pub(crate) use dense::{region, sample};

/// Size of the sample of Gaussians that is measured: it has 400 of the last hundredth along an axis, and is
/// sorted in a few milliseconds.
const N_SAMPLE: usize = 40_000;

/// Factor of the size from which on surroundings are left out. Below, a box or a ball is measured as if there
/// were none.
pub(crate) const LARGER: f32 = 1.3;

impl Scene {
    /// The smallest and the largest corner of the box around the bulk of the means, or `None` if the scene is
    /// empty. Along each axis, a share `outside` (below 0.5) of the means lies before the box, and as large a
    /// share behind it: captures have a few Gaussians far away, such as floaters and skies. If more of them are
    /// far around a dense part, the box is that of the dense part. If the scene says what to
    /// [`frame`](Self::frame), it is the cube in that ball.
    ///
    /// Of a scene of more than 40,000 Gaussians, a sample is measured, the same in any order.
    /// [`bounds`](Self::bounds) has the box around all means.
    pub fn bulk(&self, outside: f64) -> Option<[Vec3; 2]> {
        if let Some(frame) = self.frame {
            return Some(frame.corners());
        }
        let sample = sample(&self.means, |_| true, N_SAMPLE);
        let all = bulk_of(&sample, &vec![1.0; sample.len()], outside)?;
        let Some(region) = region(self) else { return Some(all) };
        let within: Vec<Vec3> = sample.into_iter().filter(|&mean| is_within(mean, region)).collect();
        let bulk = bulk_of(&within, &vec![1.0; within.len()], outside);
        Some(bulk.filter(|&bulk| radius(all) > LARGER * radius(bulk)).unwrap_or(all))
    }
}

/// Whether a box, given by two corners, holds a point.
pub(crate) fn is_within(point: Vec3, [low, high]: [Vec3; 2]) -> bool {
    point.cmpge(low).all() && point.cmple(high).all()
}

/// Half of a box's diagonal.
fn radius([low, high]: [Vec3; 2]) -> f32 {
    // Halved first, or the difference could overflow.
    (high / 2.0 - low / 2.0).length()
}

/// The smallest and the largest corner of a box, or `None` if there are no means. Along each axis, a share
/// `outside` of the mass lies before it, and as much behind it. `means` and `masses` are `[N]`.
pub(crate) fn bulk_of(means: &[Vec3], masses: &[f32], outside: f64) -> Option<[Vec3; 2]> {
    // In f64, because a small share is compared with a sum over all.
    let before = outside * masses.iter().map(|&mass| f64::from(mass)).sum::<f64>();
    let mut corners = [Vec3::ZERO; 2];
    for axis in 0..3 {
        let mut along: Vec<(f32, f32)> =
            means.iter().zip(masses).map(|(mean, &mass)| (mean[axis], mass)).collect();
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        corners[0][axis] = first_behind(along.iter(), before)?;
        corners[1][axis] = first_behind(along.iter().rev(), before)?;
    }
    Some(corners)
}

/// The first of the values at which more than this mass is passed, or the very first one if there is no such
/// value. `None` without values.
fn first_behind<'a>(
    mut values: impl Iterator<Item = &'a (f32, f32)> + Clone,
    mass_before: f64,
) -> Option<f32> {
    let first = values.clone().next();
    let mut left = mass_before;
    let found = values.find(|(_, mass)| {
        left -= f64::from(*mass);
        left < 0.0
    });
    found.or(first).map(|(value, _)| *value)
}

/// The values below which the given shares of the mass lie, or 0 if there is no mass.
pub(crate) fn quantiles<const N: usize>(
    values: impl Iterator<Item = f32>,
    masses: &[f32],
    shares: [f32; N],
) -> [f32; N] {
    let mut sorted: Vec<(f32, f32)> = values.zip(masses.iter().copied()).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    // In f64, because shares of a thousandth are compared with sums over 30,000.
    let total: f64 = sorted.iter().map(|(_, mass)| f64::from(*mass)).sum();
    shares.map(|share| {
        let mut below = f64::from(share) * total;
        let found = sorted.iter().find(|(_, mass)| {
            below -= f64::from(*mass);
            below <= 0.0
        });
        // Rounding can leave `below` above 0 after the last value.
        found.or(sorted.last()).map_or(0.0, |(value, _)| *value)
    })
}
