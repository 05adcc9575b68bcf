//! Size, middle and direction of a scene, measured so that stray Gaussians do not matter.

use crate::{Scene, bulk::bulk_of, morton, splat::MIN_ALPHA};
use glam::Vec3;

use super::{backdrop::without_backdrop, up::up};

/// Number of Gaussians of the simplified scene: enough to distinguish surfaces from gaps at the size of test
/// views.
pub(super) const N_STAND_IN: usize = 30_000;

/// The share of the mass on either side of the box, along each axis.
const OUTSIDE_BOX: f64 = 0.02;

/// The share of the mass within the radius.
const WITHIN_RADIUS: f32 = 0.97;

/// Size, middle and direction of a scene, and a simplified scene that renders quickly.
pub(super) struct Survey {
    /// A regular selection of the scene's Gaussians, enlarged to fill the gaps.
    pub stand_in: Scene,
    /// Mass of each Gaussian `[n]`, for quantiles: opacity times visible area, with a limit on the area of huge
    /// Gaussians.
    pub masses: Vec<f32>,
    /// The middle of the box that holds nearly all mass.
    pub center: Vec3,
    /// Half the box's size, along the world's axes, in scene units.
    pub half_size: Vec3,
    /// Radius of the ball about the middle that holds nearly all mass, in scene units; above 0.
    pub radius: f32,
    /// The up direction, a unit vector.
    pub up: Vec3,
}

impl Survey {
    /// Surveys a scene by at most `n_stand_in` of its Gaussians, or returns `None` if nothing of it is visible.
    pub fn new(scene: &Scene, n_stand_in: usize) -> Option<Self> {
        let stand_in = stand_in(scene, n_stand_in);
        let masses = masses(&stand_in);
        let is_drawn = |opacity: &f32| *opacity >= MIN_ALPHA;
        if !scene.opacities.iter().any(is_drawn) || masses.iter().all(|&mass| mass <= 0.0) {
            return None;
        }
        let [low, high] = bulk_of(&stand_in.means, &masses, OUTSIDE_BOX)?;
        let (center, half_size) = ((low + high) / 2.0, (high - low) / 2.0);
        let distances = stand_in
            .means
            .iter()
            .zip(&stand_in.scales)
            .map(|(mean, scales)| (mean - center).length() + scales.max_element());
        let [radius] = quantiles(distances, &masses, [WITHIN_RADIUS]);
        let up = up(&stand_in, &masses, half_size);
        // Above 0 even if Gaussians of no size lie in one point.
        Some(Self { radius: radius.max(1e-6), stand_in, masses, center, half_size, up })
    }
}

/// A scene of at most `n` Gaussians that looks similar from afar, without its backdrop: every so many along the
/// Morton curve, so that it is the same in whatever order a file lists them. The remaining Gaussians are
/// enlarged, so that the total area stays the same.
fn stand_in(scene: &Scene, n: usize) -> Scene {
    let near = without_backdrop(scene).unwrap_or_else(|| (0..scene.len() as u32).collect());
    let means: Vec<Vec3> = near.iter().map(|&i| scene.means[i as usize]).collect();
    let stride = near.len().div_ceil(n).max(1);
    let every = morton::order(&means).into_iter().step_by(stride);
    let indices: Vec<u32> = every.map(|i| near[i as usize]).collect();
    // Areas grow with the square of scales, and each Gaussian that is left stands for `stride`.
    let enlarged = (stride as f32).sqrt();
    Scene {
        means: indices.iter().map(|&i| scene.means[i as usize]).collect(),
        rotations: indices.iter().map(|&i| scene.rotations[i as usize]).collect(),
        scales: indices.iter().map(|&i| scene.scales[i as usize] * enlarged).collect(),
        opacities: indices.iter().map(|&i| scene.opacities[i as usize]).collect(),
        // No colors: only blend weights are computed of this scene, and they do not depend on color.
        n_source: indices.len(),
        up: scene.up,
        filter: scene.filter,
        order: indices,
        ..Default::default()
    }
}

fn masses(scene: &Scene) -> Vec<f32> {
    let areas: Vec<f32> = scene
        .scales
        .iter()
        .map(|scales| {
            let [a, b, c] = scales.to_array();
            (a * b).max(b * c).max(c * a)
        })
        .collect();
    // Backdrops are a few huge Gaussians. They must not outweigh the things before them.
    let [bound] = quantiles(areas.iter().copied(), &vec![1.0; areas.len()], [0.9]);
    areas.iter().zip(&scene.opacities).map(|(area, opacity)| opacity * area.min(bound)).collect()
}

/// The values below which the given shares of the mass lie, or 0 if there is no mass.
pub(super) fn quantiles<const N: usize>(
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
