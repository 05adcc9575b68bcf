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
    let Some(Spread { center, extent, size, .. }) = Spread::of(samples) else { return DVec3::ZERO };
    let farthest = center.abs().max_element();
    let step = step_of_f32(farthest);
    // Beyond the range of f32 there are no scenes, and the Gaussians are dropped.
    if !is_coarse(step, extent, size) || farthest <= extent || !step.is_finite() {
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

/// The place and the sizes of most samples.
struct Spread {
    /// The median position.
    center: DVec3,
    /// The median of the largest coordinates, without their signs.
    distance: f64,
    /// The longest side of the box without a tenth of the Gaussians on each side, or the median Gaussian's size
    /// if that is more.
    extent: f64,
    /// The median of the Gaussians' largest standard deviations.
    size: f64,
}

impl Spread {
    /// The spread of the finite samples, or `None` if there are none.
    fn of(samples: &[Sample]) -> Option<Self> {
        let finite = || samples.iter().map(|(position, _)| position).filter(|position| position.is_finite());
        let sorted = |mut values: Vec<f64>| {
            values.sort_unstable_by(f64::total_cmp);
            values
        };
        let sizes = sorted(samples.iter().map(|&(_, size)| size).filter(|size| size.is_finite()).collect());
        let axes = [0, 1, 2].map(|axis| sorted(finite().map(|position| position[axis]).collect()));
        let distances = sorted(finite().map(|position| position.abs().max_element()).collect());
        let middle = |values: &[f64]| values.get(values.len() / 2).copied();
        let (size, distance) = (middle(&sizes)?, middle(&distances)?);
        let (n, left_out) = (distances.len(), distances.len() / 10);
        let center = DVec3::from_array([0, 1, 2].map(|axis| axes[axis][n / 2]));
        let extents = [0, 1, 2].map(|axis| axes[axis][n - 1 - left_out] - axes[axis][left_out]);
        let extent = extents.into_iter().fold(size, f64::max);
        Some(Self { center, distance, extent, size })
    }
}

/// Whether positions in steps of `step` are coarse for a scene of this extent, or for Gaussians of this size.
fn is_coarse(step: f64, extent: f64, size: f64) -> bool {
    step > FINEST_OF_EXTENT * extent || step > FINEST_OF_SIZE * size
}

/// Fewest Gaussians of which a median says anything.
const FEWEST: usize = 16;

/// A warning if most positions of a scene are so far from its origin that f32 has rounded them: of a file of
/// f32, or of parts that lie too far from one another for one offset.
pub(super) fn rounded(scene: &Scene) -> Option<String> {
    let n = scene.len();
    let sample = |i: usize| (scene.means[i].as_dvec3(), f64::from(scene.scales[i].max_element()));
    let samples: Vec<Sample> = (0..n).step_by(stride(n)).map(sample).collect();
    let Spread { distance, extent, size, .. } =
        Spread::of(&samples).filter(|it| n >= FEWEST && it.size > 0.0)?;
    let step = step_of_f32(distance);
    let warning = || {
        format!(
            "positions are rounded to {step:.1e}, the steps of f32 at {distance:.1e} from the origin: the \
             median Gaussian has a size of {size:.1e}, in a scene of {extent:.1e}"
        )
    };
    is_coarse(step, extent, size).then(warning)
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
