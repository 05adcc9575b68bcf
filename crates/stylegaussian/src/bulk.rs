//! The bulk of a scene: a box that a few Gaussians far away do not change.

use glam::Vec3;

use crate::Scene;

/// Size of the sample of Gaussians that is measured: it has 200 of the last hundredth along an axis, and is
/// sorted in a few milliseconds.
const N_SAMPLE: usize = 20_000;

impl Scene {
    /// The smallest and the largest corner of the box around the bulk of the means, or `None` if the scene is
    /// empty. Along each axis, a share `outside` (below 0.5) of the means lies before the box, and as large a
    /// share behind it: captures have a few Gaussians far away, such as floaters and skies.
    ///
    /// Of a scene of more than 20,000 Gaussians, a regular sample is measured. [`bounds`](Self::bounds) has the
    /// box around all means.
    pub fn bulk(&self, outside: f64) -> Option<[Vec3; 2]> {
        let stride = self.len().div_ceil(N_SAMPLE).max(1);
        let sample: Vec<Vec3> = self.means.iter().step_by(stride).copied().collect();
        bulk_of(&sample, &vec![1.0; sample.len()], outside)
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(means: impl Iterator<Item = Vec3>) -> Scene {
        Scene { means: means.collect(), ..Scene::default() }
    }

    #[test]
    fn a_share_on_either_side_does_not_count() {
        // x = 0, 1, ..., 99; y falls while x grows; z is the same for all.
        let hundred = scene((0..100).map(|i| Vec3::new(i as f32, -2.0 * i as f32, 7.0)));
        let expected = [Vec3::new(3.0, -192.0, 7.0), Vec3::new(96.0, -6.0, 7.0)];
        assert_eq!(hundred.bulk(0.03), Some(expected));
        let all = [Vec3::new(0.0, -198.0, 7.0), Vec3::new(99.0, 0.0, 7.0)];
        assert_eq!(hundred.bulk(0.0), Some(all));
        assert_eq!(hundred.bulk(0.009), Some(all), "less than one Gaussian");
    }

    #[test]
    fn strays_change_nothing() {
        let strays = [Vec3::splat(1e6), Vec3::new(-1e9, 5.0, f32::MAX)];
        let scene = scene((0..198).map(|i| Vec3::splat(i as f32)).chain(strays));
        // Two of 200 lie on either side: along x a stray and a Gaussian, along z both strays behind.
        let [min, max] = scene.bulk(0.01).unwrap();
        assert_eq!((min.x, max.x), (1.0, 196.0));
        assert_eq!((min.z, max.z), (2.0, 197.0));
    }

    #[test]
    fn a_large_scene_is_measured_by_a_sample() {
        // x = 0, 1, ..., 49,999, in the order of a step of 7,919, which is prime.
        let n = 50_000_u32;
        let large = scene((0..n).map(|i| Vec3::splat((i * 7919 % n) as f32)));
        let [min, max] = large.bulk(0.02).unwrap();
        assert!((min.x - 1000.0).abs() < 50.0 && (max.x - 48_999.0).abs() < 50.0, "{min} {max}");
    }

    #[test]
    fn few_gaussians_are_their_own_bulk() {
        assert_eq!(Scene::default().bulk(0.03), None);
        assert_eq!(scene([Vec3::X].into_iter()).bulk(0.03), Some([Vec3::X; 2]));
        assert_eq!(scene([Vec3::X, Vec3::ZERO].into_iter()).bulk(0.03), Some([Vec3::ZERO, Vec3::X]));
    }

    #[test]
    fn mass_decides_and_not_the_number() {
        let means = [0.0, 1.0, 2.0, 3.0].map(Vec3::splat);
        let of = |masses: [f32; 4]| bulk_of(&means, &masses, 0.25).map(|[min, max]| [min.x, max.x]);
        // A quarter of the mass is 2.
        assert_eq!(of([3.0, 1.0, 1.0, 3.0]), Some([0.0, 3.0]));
        assert_eq!(of([1.0, 1.0, 5.0, 1.0]), Some([2.0, 2.0]));
        assert_eq!(of([0.0; 4]), Some([0.0, 3.0]), "without mass, the whole box");
    }
}
