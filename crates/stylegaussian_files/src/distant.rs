//! Scenes far from the origin of their coordinates: surveys in meters of a national grid, Earth-centered nodes
//! of a glTF.
//!
//! Means are f32, whose steps grow with the distance: at five million they are half a unit wide. A reader that
//! is given finer numbers keeps such a scene near its own origin, and the way there in [`Scene::offset`].

use glam::DVec3;
use stylegaussian::scene::Scene;

/// A Gaussian as [`offset`] looks at it: its position in the source, and its largest standard deviation.
pub(super) type Sample = (DVec3, f64);

/// Gaussians that [`offset`] looks at. The median of this many lies between the percentiles 48 and 52 of all
/// (three standard errors are 0.012).
const N_SAMPLES: usize = 1 << 14;

/// The part of a scene's extent that rounding may move a Gaussian by.
const FINEST_OF_EXTENT: f64 = 1e-4;

/// The part of a Gaussian's standard deviation that a step of its position may take. Rounding to such steps
/// moves it by a sixteenth at most, which changes its value anywhere by less than 4 % of its peak: the steepest
/// slope of exp(-t^2 / 2) is 0.61.
const FINEST_OF_SIZE: f64 = 0.125;

/// Extents that may lie between a scene and an offset that the file names.
const NEAR: f64 = 8.0;

/// The distance from one sample to the next of a scene of `n` Gaussians.
pub(super) fn stride(n: usize) -> usize {
    n.div_ceil(N_SAMPLES).max(1)
}

/// The offset of a scene, 0 unless all of this holds of most samples:
///
/// - the steps of f32 there are wider than a ten-thousandth of the scene's extent, or than an eighth of the
///   median Gaussian;
/// - the scene lies farther from the origin than it is large, so that an offset makes them finer.
///
/// It is the one that the file names, if the scene is near that, or else rounded to a power of ten above the
/// extent. Strays neither cause it nor prevent it: the extent leaves out a tenth of the Gaussians on each side.
pub(super) fn offset(samples: &[Sample], named: Option<DVec3>) -> DVec3 {
    let mut sizes: Vec<f64> = samples.iter().map(|&(_, size)| size).filter(|size| size.is_finite()).collect();
    let axes = [0, 1, 2].map(|axis| {
        let finite = samples.iter().filter(|(position, _)| position.is_finite());
        let mut along: Vec<f64> = finite.map(|(position, _)| position[axis]).collect();
        along.sort_unstable_by(f64::total_cmp);
        along
    });
    if axes[0].is_empty() || sizes.is_empty() {
        return DVec3::ZERO;
    }
    let middle = sizes.len() / 2;
    let size = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    let (n, left_out) = (axes[0].len(), axes[0].len() / 10);
    let center = DVec3::from_array([0, 1, 2].map(|axis| axes[axis][n / 2]));
    let extents = [0, 1, 2].map(|axis| axes[axis][n - 1 - left_out] - axes[axis][left_out]);
    let extent = extents.into_iter().fold(size, f64::max);
    let farthest = center.abs().max_element();
    let step = step_of_f32(farthest);
    let is_far = step > FINEST_OF_EXTENT * extent || step > FINEST_OF_SIZE * size;
    // Beyond the range of f32 there are no scenes, and the Gaussians are dropped.
    if !is_far || farthest <= extent || !step.is_finite() {
        return DVec3::ZERO;
    }
    let is_near = |named: &DVec3| (center - named).abs().cmple(DVec3::splat(NEAR * extent)).all();
    named.filter(is_near).unwrap_or_else(|| {
        // 0 has no logarithm: Gaussians without a size, all in one place.
        let digits = extent.max(f64::MIN_POSITIVE).log10().ceil().clamp(-15.0, 15.0) as i32;
        // Powers below 1 are not exact, but their inverses are, so that the offset has few digits.
        let unit = 10_f64.powi(digits.abs());
        match digits {
            0.. => (center / unit).round() * unit,
            _ => (center * unit).round() / unit,
        }
    })
}

/// The distance from a number to the next of f32, infinite beyond its range.
fn step_of_f32(number: f64) -> f64 {
    let number = number.abs() as f32;
    f64::from(number.next_up()) - f64::from(number)
}

/// A warning if a format without a place for it leaves out the scene's offset.
pub(super) fn left_out(scene: &Scene) -> Option<String> {
    let DVec3 { x, y, z } = scene.offset;
    let warning =
        || format!("positions count from the scene's origin: the format cannot hold its offset {x} {y} {z}");
    (scene.offset != DVec3::ZERO).then(warning)
}

#[cfg(test)]
mod tests;
