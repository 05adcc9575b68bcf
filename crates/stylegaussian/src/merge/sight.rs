//! Light that each Gaussian takes away as it is seen from around a scene.

use glam::{UVec2, Vec3};

use crate::{
    camera::Camera,
    scene::Scene,
    splat::blend_weights_if_wanted,
    work::{Canceled, Work},
};

/// Side of a view in pixels. Small, since only sums over pixels count.
const SIDE: u32 = 128;

/// Distance of the eyes from the middle, in radii of the scene. Rays are nearly parallel there.
const DISTANCE: f32 = 4.0;

/// Least blend weight that counts, as for the sight of paint.
const FAINT: f32 = 1e-3;

/// Share of its light that a hidden Gaussian counts as: an eye may be within the scene.
const HIDDEN: f64 = 0.01;

/// The directions to a cube's faces and corners, which are even around it.
fn directions() -> impl Iterator<Item = Vec3> {
    let faces = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    let sign = |corner: u32, axis: u32| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
    let corners = (0..8).map(move |corner| Vec3::from_array([0, 1, 2].map(|axis| sign(corner, axis))));
    faces.chain(corners.map(Vec3::normalize))
}

/// The light that each Gaussian takes away from views around the scene `[N]`, where others may hide it, in the
/// unit of `lights` `[N]`, that which it takes away alone.
///
/// # Errors
/// If `work` is canceled.
pub(super) fn seen(scene: &Scene, lights: &[f64], work: &Work) -> Result<Vec<f64>, Canceled> {
    let none = Vec3::INFINITY;
    let (low, high) =
        scene.means.iter().fold((none, -none), |(low, high), &mean| (low.min(mean), high.max(mean)));
    let (middle, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
    // A single place hides nothing, and a scene that is not finite has no views.
    if !(radius.is_normal() && (DISTANCE * radius).is_finite()) {
        return Ok(lights.to_vec());
    }
    let mut seen: Vec<f64> = lights.iter().map(|light| HIDDEN * light).collect();
    let n_views = directions().count();
    for direction in directions() {
        let up = if direction.y.abs() > 0.9 { Vec3::X } else { Vec3::Y };
        let eye = middle + DISTANCE * radius * direction;
        let camera = Camera::look_at(eye, middle, up, 2.0 * (1.0 / DISTANCE).asin(), UVec2::splat(SIDE));
        let weights = blend_weights_if_wanted(scene, &camera, FAINT, work)?;
        let pixel = f64::from(DISTANCE * radius / camera.focal.x);
        // The light of a Gaussian alone is the integral of its alpha over 2 pi.
        let unit = pixel * pixel / (std::f64::consts::TAU * n_views as f64);
        for (i, weight) in weights.indices.iter().zip(&weights.weights) {
            seen[*i as usize] += unit * f64::from(*weight);
        }
    }
    Ok(seen)
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;

    #[test]
    fn what_is_within_is_hidden() {
        // An opaque ball around the first, and a small one alone beside it.
        let mut means = vec![Vec3::ZERO, Vec3::new(5.0, 0.0, 0.0)];
        means.extend(directions());
        let n = means.len();
        let scene = Scene {
            scales: (0..n).map(|i| Vec3::splat(if i < 2 { 0.3 } else { 0.6 })).collect(),
            rotations: vec![Quat::IDENTITY; n],
            opacities: (0..n).map(|i| if i < 2 { 0.5 } else { 0.99 }).collect(),
            order: (0..n as u32).collect(),
            n_source: n,
            means,
            ..Scene::default()
        };
        let lights = vec![1.0; n];
        let found = seen(&scene, &lights, &Work::default()).unwrap();
        assert!(found[0] < 0.02, "{found:?}");
        // o times the squared deviation, and a little more since pixels widen it.
        assert!((found[1] - HIDDEN - 0.5 * 0.09).abs() < 0.01, "{found:?}");
        let work = Work::default();
        work.cancel();
        assert_eq!(seen(&scene, &lights, &work), Err(Canceled));
        let place = scene.subset(&[0]);
        assert_eq!(seen(&place, &[3.0], &Work::default()), Ok(vec![3.0]));
    }
}
