//! Visibility of each Gaussian in usual views, and the size of a pixel of such a view on the scene.

use glam::{UVec2, Vec3};

use super::proofs::Proofs;
use crate::{
    camera::Camera,
    scene::Scene,
    splat::blend_weights_if_wanted,
    views::choose_overviews,
    work::{Canceled, Work},
};

/// Number of views of the scene. Eight show nearly all that is visible from outside.
const N_VIEWS: usize = 8;

/// Longer side of those views, in pixels. Small, since only sums over pixels count.
const VIEW_SIDE: u32 = 128;

/// Longer sides of pictures in which strokes are as large as in the painting, in pixels. Paintings have 512,
/// and so have pictures from chosen views. From a capture's cameras strokes are 1.3 times as large: finer ones
/// turned a woodcut gray on the bonsai (docs/notes.md, "Paint").
const CHOSEN_SIDE: f32 = 512.0;
const CAPTURED_SIDE: f32 = 394.0;

/// Number of proofs: three sides of a scene. Of chosen views they are the farthest, because strokes are meant
/// for pictures of the whole scene. For captures, they are the cameras at median distance.
const N_PROOFS: usize = 3;

/// Side of a proof over that of the picture in which strokes are as large as in the painting. The time of a
/// change of style grows with its square, and detail of a single pixel is left out.
const PROOF_SIDE: f32 = 0.5;

/// Share of the time that the views take; proofs take the rest.
const VIEWS: f32 = 0.6;

/// Least blend weight that counts. Two fifths of all are smaller, and sum to 0.5% of a picture.
pub(super) const FAINT: f32 = 1e-3;

/// Most pixels that a Gaussian seen from the front counts as: all of a picture.
const MOST_PIXELS: f32 = CHOSEN_SIDE * CHOSEN_SIDE;

/// A summary of usual views of a scene.
pub(super) struct Sight {
    /// Pixels that each Gaussian fills, summed over the views `[N]`.
    pub visibility: Vec<f32>,
    /// Size of a pixel of the painting on the scene, in scene units: the median over the proofs.
    pub pixel: f32,
    /// Pictures by which paint is measured.
    pub proofs: Proofs,
    /// The direction that is up in the views, a unit vector.
    pub up: Vec3,
}

impl Sight {
    /// Looks at `scene` through `cameras`: a few of its capture's, or chosen ones if they are not known.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn of(scene: &Scene, cameras: &[Camera], work: &Work) -> Result<Self, Canceled> {
        let cameras: Vec<Camera> =
            cameras.iter().take(N_VIEWS).map(|camera| camera.fitted(VIEW_SIDE)).collect();
        let picture_side = if scene.cameras.is_empty() { CHOSEN_SIDE } else { CAPTURED_SIDE };
        let mut visibility = vec![0.0; scene.len()];
        let mut views = Vec::new();
        for (i, camera) in cameras.iter().enumerate() {
            work.at(VIEWS * i as f32 / cameras.len() as f32)?;
            let weights = blend_weights_if_wanted(scene, camera, FAINT, work)?;
            let mut filled = vec![0.0; scene.len()];
            for (i, weight) in weights.indices.iter().zip(&weights.weights) {
                filled[*i as usize] += weight;
            }
            let mut sizes = Vec::new();
            for (i, pixels) in filled.into_iter().enumerate() {
                if pixels > 0.0 {
                    visibility[i] += pixels;
                    let z = camera.view_from_world.transform_point3(scene.means[i]).z;
                    let focal = camera.focal.x * picture_side / VIEW_SIDE as f32;
                    sizes.push((z / focal, pixels));
                }
            }
            views.extend(weighted_median(&mut sizes).map(|pixel| (pixel, camera)));
        }
        let up = cameras.iter().map(up_of).sum::<Vec3>().try_normalize().unwrap_or(Vec3::Y);
        // The sort is stable: of views from the same distance the most useful come first.
        views.sort_by(|a, b| b.0.total_cmp(&a.0));
        if !scene.cameras.is_empty() {
            views.drain(..views.len().saturating_sub(N_PROOFS) / 2);
        }
        views.truncate(N_PROOFS);
        let pixel = views.get(views.len() / 2).map_or_else(|| pixel_of_extent(scene), |(pixel, _)| *pixel);
        let side = PROOF_SIDE * picture_side;
        let proofs: Vec<Camera> = views.iter().map(|(_, camera)| camera.fitted(side as u32)).collect();
        let proofs = Proofs::new(scene, &proofs, &work.part(VIEWS, 1.0))?;
        Ok(Self { visibility, pixel, proofs, up })
    }
}

impl Sight {
    /// All of a scene seen from the front, where a pixel of the painting has this size, in scene units. The
    /// unit vector `up` is up unless the scene tells it. Gaussians are half as wide as they are apart. There
    /// are no proofs.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn from_the_front(scene: &Scene, pixel: f32, up: Vec3, work: &Work) -> Result<Self, Canceled> {
        let visible = |side: f32| (2.0 * side / pixel).powi(2).min(MOST_PIXELS);
        Ok(Self {
            visibility: scene.broad_sides().into_iter().map(visible).collect(),
            pixel,
            proofs: Proofs::new(scene, &[], work)?,
            up: scene.up.and_then(Vec3::try_normalize).unwrap_or(up),
        })
    }
}

/// The views: a few of the capture's cameras, spread over it, or chosen ones if there are none or the scene
/// tells what to frame.
///
/// # Errors
/// If `work` is canceled.
pub(super) fn usual_views(scene: &Scene, work: &Work) -> Result<Vec<Camera>, Canceled> {
    if scene.cameras.is_empty() || scene.frame.is_some() {
        return choose_overviews(scene, N_VIEWS, UVec2::splat(VIEW_SIDE), work);
    }
    let stride = scene.cameras.len().div_ceil(N_VIEWS);
    Ok(scene.cameras.iter().step_by(stride).map(|camera| camera.near_among(&scene.means)).collect())
}

/// A camera's up direction in the world. Its y axis points down.
fn up_of(camera: &Camera) -> Vec3 {
    -Vec3::from(camera.view_from_world.matrix3.row(1))
}

/// The weighted median, or `None` if there is no value.
pub(super) fn weighted_median(values: &mut [(f32, f32)]) -> Option<f32> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = values.iter().map(|(_, weight)| f64::from(*weight)).sum();
    let mut sum = 0.0;
    let middle = values.iter().find(|(_, weight)| {
        sum += f64::from(*weight);
        sum >= total / 2.0
    });
    middle.map(|(value, _)| *value)
}

/// A pixel if the whole scene fills the picture: for scenes of which no view shows anything.
fn pixel_of_extent(scene: &Scene) -> f32 {
    let extent = scene.bounds().map_or(0.0, |(min, max)| (max - min).max_element());
    // A scene of one point has no extent. Any size does, as long as it is above 0.
    if extent > 0.0 { extent / CHOSEN_SIDE } else { 1.0 / CHOSEN_SIDE }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel_of(scene: &Scene) -> f32 {
        let work = Work::default();
        Sight::of(scene, &usual_views(scene, &work).unwrap(), &work).unwrap().pixel
    }

    /// A pixel of the painting is a pixel of the capture's middle camera, whatever the order of the cameras.
    #[test]
    fn strokes_are_for_the_places_of_the_capture() {
        let (fov, side) = (0.8_f32, UVec2::new(1000, 500));
        let camera = |distance: f32| {
            let eye = Vec3::new(0.0, 0.0, -distance);
            Camera::look_at(eye, Vec3::ZERO, Vec3::NEG_Y, fov, side)
        };
        let scene = Scene {
            means: vec![Vec3::ZERO],
            rotations: vec![glam::Quat::IDENTITY],
            scales: vec![Vec3::splat(0.3)],
            opacities: vec![0.9],
            order: vec![0],
            n_source: 1,
            cameras: [5.0, 40.0, 10.0, 2.0, 20.0].map(camera).to_vec(),
            ..Scene::default()
        };
        let focal = camera(1.0).fitted(CAPTURED_SIDE as u32).focal.x;
        let found = pixel_of(&scene);
        assert!((found / (10.0 / focal) - 1.0).abs() < 1e-2, "{found}, expected {}", 10.0 / focal);
    }

    /// A pixel of the painting is a pixel of a picture of 512 pixels from the second of the chosen views, the
    /// farthest first.
    #[test]
    fn strokes_are_for_pictures_of_the_whole_scene() {
        let scene = Scene {
            means: vec![Vec3::new(0.5, -1.0, 2.0)],
            rotations: vec![glam::Quat::IDENTITY],
            scales: vec![Vec3::splat(0.3)],
            opacities: vec![0.9],
            order: vec![0],
            n_source: 1,
            ..Scene::default()
        };
        let pixel = |camera: Camera| {
            camera.view_from_world.transform_point3(scene.means[0]).z / camera.fitted(512).focal.x
        };
        let mut pixels: Vec<f32> =
            usual_views(&scene, &Work::default()).unwrap().into_iter().map(pixel).collect();
        pixels.sort_by(|a, b| b.total_cmp(a));
        let found = pixel_of(&scene);
        assert!((found / pixels[1] - 1.0).abs() < 1e-2, "{found}, expected {}", pixels[1]);
    }

    #[test]
    fn the_median_counts_weights() {
        assert_eq!(weighted_median(&mut [(3.0, 1.0), (1.0, 1.0), (2.0, 5.0)]), Some(2.0));
        assert_eq!(weighted_median(&mut [(3.0, 9.0), (1.0, 1.0), (2.0, 5.0)]), Some(3.0));
        assert_eq!(weighted_median(&mut []), None);
    }
}
