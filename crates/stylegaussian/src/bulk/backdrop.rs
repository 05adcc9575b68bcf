//! Sky far behind a scene: a shell of Gaussians that some capture apps put around everything.

use glam::Vec3;

use super::{quantiles, sample};
use crate::Scene;

/// Size of the sample of Gaussians: enough to find a thousandth of them.
const N_SAMPLE: usize = 60_000;

/// Factor of the distance from the scene's middle within which there is next to nothing behind the scene.
/// Scaniverse puts its sky at 240 times the radius. Backgrounds that were captured reach out without such a
/// gap.
const GAP: f32 = 20.0;

/// The largest share of Gaussians within the gap: floaters.
const FLOATERS: f32 = 0.002;

/// The least share of Gaussians in front of the gap. Otherwise it is around some detail, and the scene is
/// behind it.
const LEAST_SCENE: f32 = 0.1;

/// The middle of a scene, and the distance from there within which everything belongs to the scene. `None` if
/// there is no backdrop.
pub(crate) fn before_backdrop(scene: &Scene) -> Option<(Vec3, f32)> {
    let sample = sample(&scene.means, |_| true, N_SAMPLE);
    let middle = middle(&sample);
    Some((middle, GAP * reach(&distances(&sample, middle))?))
}

/// The indices of all Gaussians that belong to the scene, or `None` if all of them do.
pub(crate) fn without_backdrop(scene: &Scene) -> Option<Vec<u32>> {
    let (middle, limit) = before_backdrop(scene)?;
    let is_near = |&i: &u32| scene.means[i as usize].distance(middle) < limit;
    Some((0..scene.len() as u32).filter(is_near).collect())
}

/// The smallest and the largest corner of the box around the means of a scene without a backdrop far behind it,
/// which may be a sky or a single stray. `None` if there is none: the box is [`Scene::bounds`].
pub fn bounds_without_backdrop(scene: &Scene) -> Option<(Vec3, Vec3)> {
    let middle = middle(&sample(&scene.means, |_| true, N_SAMPLE));
    // A sample may have no stray.
    let limit = GAP * reach(&distances(&scene.means, middle))?;
    let near = scene.means.iter().copied().filter(|mean| mean.distance(middle) < limit);
    near.map(|mean| (mean, mean)).reduce(|(min, max), (mean, _)| (min.min(mean), max.max(mean)))
}

/// The median along each axis.
fn middle(means: &[Vec3]) -> Vec3 {
    let ones = vec![1.0; means.len()];
    let median = |axis: usize| quantiles(means.iter().map(|mean| mean[axis]), &ones, [0.5])[0];
    Vec3::new(median(0), median(1), median(2))
}

/// The distances from `middle`, in ascending order.
fn distances(means: &[Vec3], middle: Vec3) -> Vec<f32> {
    let mut distances: Vec<f32> = means.iter().map(|mean| mean.distance(middle)).collect();
    distances.sort_unstable_by(f32::total_cmp);
    distances
}

/// The distance of the scene's last Gaussian in front of a gap, or `None` if there is no gap with something
/// behind it.
fn reach(sorted: &[f32]) -> Option<f32> {
    let n = sorted.len();
    let first = (LEAST_SCENE * n as f32).ceil() as usize;
    let most = (FLOATERS * n as f32) as usize;
    (first.max(1)..=n).map(|n_near| (n_near, sorted[n_near - 1])).find_map(|(n_near, distance)| {
        // A scene of one point, or beyond the range of f32, has no measure of near and far.
        let n_within = sorted.partition_point(|&other| other < GAP * distance);
        (distance > 0.0 && n_within < n && n_within - n_near <= most).then_some(distance)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_has_a_scene_before_it_and_something_behind() {
        let sorted = |parts: &[Vec<f32>]| {
            let mut all = parts.concat();
            all.sort_unstable_by(f32::total_cmp);
            reach(&all)
        };
        let scene: Vec<f32> = (1..=1000).map(|i| i as f32 / 1000.0).collect();
        assert_eq!(sorted(std::slice::from_ref(&scene)), None);
        // At 240 times the radius, nine times as many.
        assert_eq!(sorted(&[scene.clone(), vec![240.0; 9000]]), Some(1.0));
        assert_eq!(sorted(&[scene.clone(), vec![240.0; 9100]]), None, "a detail in a large scene");
        // Floaters up to two thousandths.
        assert!(sorted(&[scene.clone(), vec![3.0; 2], vec![240.0; 100]]).is_some());
        assert_eq!(sorted(&[scene.clone(), vec![3.0; 50], vec![240.0; 100]]), Some(3.0), "a larger scene");
        // A landscape that reaches out evenly over five powers of ten.
        let far: Vec<f32> = (0..1000).map(|i| 10.0_f32.powf(i as f32 / 200.0)).collect();
        assert_eq!(sorted(&[scene, far]), None);
        assert_eq!(reach(&[]), None);
        assert_eq!(reach(&[0.0, 0.0, 1.0]), None);
        assert_eq!(reach(&[f32::MAX; 3]), None);
    }
}
