//! Random cameras whose pictures are the crops that are compared.

use glam::{Quat, UVec2, Vec3};
use rayon::prelude::*;
use stylegaussian::{
    Camera, Scene,
    random::Random,
    recolor::{ColorMoments, Recoloring},
    splat::{Colors, RenderedImage, blend_weights, render},
    views::choose_views_if_wanted,
    work::{Canceled, Work},
};

use crate::loss::shapes;

/// Number of views of a scene without cameras.
const N_VIEWS: usize = 24;
/// Most cameras of a capture that are used, spread over the list.
const MOST_VIEWS: usize = 64;
/// Side of the views that find targets of crops, in pixels.
const SURVEY_SIDE: u32 = 96;
/// Deviation of the camera's angle around its target, in radians.
const TURN: f32 = 0.08;
/// Deviation of the logarithm of the distance.
const APPROACH: f32 = 0.1;
/// Largest factor of the distance of chosen views. They fill the picture with the scene, or look closer, but a
/// player also steps back. At 3.5, pictures of the chosen views have 0.67 of a painting's grain, at 1.3 they
/// have 0.75 (docs/notes.md, "Bakes").
const FARTHEST: f32 = 1.3;
/// Groups of views by distance, near, middle and far, with as many views each. Their statistics are pooled
/// apart: strokes have one size in a scene, so far pictures have much fine detail and near ones little, and the
/// mean over all distances would hide both (docs/notes.md, "Bakes").
pub(crate) const DISTANCES: usize = 3;
/// Least share of a crop that should be covered.
const LEAST_COVERED: f32 = 0.5;

/// A view, and the points of the scene at which crops of it may aim.
struct View {
    camera: Camera,
    /// Points in the world.
    targets: Vec<Vec3>,
    /// Pixels per unit of length at the middle depth.
    scale: f32,
    /// The group by distance, 0..[`DISTANCES`], the farthest first.
    distance: usize,
}

/// Where the scene is seen from.
pub(crate) struct Cameras {
    views: Vec<View>,
    /// The views that were chosen, the most useful first; none if there were cameras.
    pub chosen: Vec<Camera>,
    /// Moments of the captured colors, as the views show them.
    pub colors: ColorMoments,
    /// The captured mean colors of the large shapes of each view: cells that the scene covers.
    shapes: Vec<Vec<Vec3>>,
    /// Pixels that each Gaussian fills of the view that shows most of it, at the views' full size `[N]`.
    pub pixels: Vec<f32>,
    /// The length that a pixel shows at the middle distance.
    pub pixel_size: f32,
    /// Factor up to which views are seen from farther away.
    farthest: f32,
}

impl Cameras {
    /// Surveys `given`; if there are none, the cameras of the scene's capture; if those are not known or the
    /// scene tells what to frame, views chosen for the scene. Returns `None` if they see nothing.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn survey(
        scene: &Scene,
        given: &[Camera],
        side: u32,
        crop: u32,
        work: &Work,
    ) -> Result<Option<Self>, Canceled> {
        let given = if given.is_empty() && scene.frame.is_none() { &scene.cameras } else { given };
        let cameras = match given {
            [] => choose_views_if_wanted(scene, N_VIEWS, UVec2::splat(side), work)?,
            given => {
                let stride = given.len().div_ceil(MOST_VIEWS);
                given
                    .iter()
                    .step_by(stride)
                    .map(|camera| camera.near_among(&scene.means).fitted(side))
                    .collect()
            }
        };
        let chosen = if given.is_empty() { cameras.clone() } else { Vec::new() };
        let of_camera = |camera| work.check().map(|()| survey(scene, camera, crop));
        let surveyed: Vec<(View, RenderedImage, Vec<f32>)> =
            cameras.into_par_iter().map(of_camera).collect::<Result<_, _>>()?;
        let mut pixels = vec![0.0_f32; scene.len()];
        let enlarged = (side as f32 / SURVEY_SIDE as f32).powi(2);
        let (mut views, mut pictures) = (Vec::new(), Vec::new());
        for (view, picture, of_view) in surveyed {
            pixels.iter_mut().zip(of_view).for_each(|(most, value)| *most = most.max(enlarged * value));
            pictures.push(picture);
            views.push(view);
        }
        views.retain(|view| !view.targets.is_empty());
        let mut scales: Vec<f32> = views.iter().map(|view| view.scale).collect();
        scales.sort_by(f32::total_cmp);
        for view in &mut views {
            view.distance = distance(view.scale, &scales);
        }
        let farthest = if given.is_empty() { FARTHEST } else { 1.0 };
        Ok((!views.is_empty()).then(|| Self {
            pixel_size: farthest.sqrt() / scales[scales.len() / 2],
            colors: ColorMoments::of_views(&pictures),
            shapes: pictures.iter().map(|picture| shapes_of(picture, side)).collect(),
            views,
            chosen,
            pixels,
            farthest,
        }))
    }

    /// The contrast between large shapes, recolored.
    pub fn contrast(&self, recoloring: &Recoloring) -> f32 {
        let brightness = |color: &Vec3| shapes::brightness(recoloring.color(color.to_array()).into());
        shapes::contrast(self.shapes.iter().map(|colors| colors.iter().map(brightness).collect()))
    }

    /// The view of a step.
    fn view(&self, step: u32, seed: u64) -> &View {
        let n = self.views.len();
        // Every view once before any comes again.
        let round = u64::from(step) / n as u64;
        let order = Random::new(seed ^ round.wrapping_mul(0x9E37_79B9)).permutation(n);
        &self.views[order[step as usize % n]]
    }

    /// The group by distance of a step's view, 0..[`DISTANCES`].
    pub fn distance(&self, step: u32, seed: u64) -> usize {
        self.view(step, seed).distance
    }

    /// The camera of a step.
    pub fn sample(&self, step: u32, crop: u32, random: &mut Random, seed: u64) -> Camera {
        let view = self.view(step, seed);
        let target = view.targets[random.below(view.targets.len())];
        let rotation = view.camera.view_from_world.matrix3.transpose();
        let (right, up) = (Vec3::from(rotation.x_axis), -Vec3::from(rotation.y_axis));
        let turn = Quat::from_axis_angle(up, TURN * random.normal())
            * Quat::from_axis_angle(right, TURN * random.normal());
        let offset = turn * (view.camera.position() - target);
        let farther = self.farthest.powf(random.uniform());
        let eye = target + farther * (APPROACH * random.normal()).exp() * offset;
        let fov_y = 2.0 * (crop as f32 / (2.0 * view.camera.focal.y)).atan();
        let near = view.camera.near;
        Camera { near, ..Camera::look_at(eye, target, up, fov_y, UVec2::splat(crop)) }
    }
}

/// Mean colors of a small picture's cells that are covered, each as large as a large shape of a view of `side`
/// pixels.
fn shapes_of(picture: &RenderedImage, side: u32) -> Vec<Vec3> {
    let cell = (shapes::SIDE as f32 * SURVEY_SIDE as f32 / side as f32).round().max(1.0) as usize;
    let [width, height] = picture.size.to_array().map(|length| length as usize);
    let mean = |(left, top): (usize, usize)| {
        let pixels = (top..top + cell).flat_map(|y| (left..left + cell).map(move |x| y * width + x));
        let covered = pixels.clone().all(|pixel| picture.alpha[pixel] > 0.9);
        let color = |pixel: usize| Vec3::from(picture.color[pixel]) / picture.alpha[pixel];
        covered.then(|| pixels.map(color).sum::<Vec3>() / (cell * cell) as f32)
    };
    let corners = |length: usize| (0..length / cell).map(move |i| i * cell);
    corners(height).flat_map(|top| corners(width).map(move |left| (left, top))).filter_map(mean).collect()
}

/// A view with its targets, its picture, and the pixels that each Gaussian fills.
fn survey(scene: &Scene, camera: Camera, crop: u32) -> (View, RenderedImage, Vec<f32>) {
    let small = camera.fitted(SURVEY_SIDE);
    let picture = render(scene, Colors::Captured, &small);
    let weights = blend_weights(scene, &small);
    let pixels = weights.apply_transposed(&vec![1.0; picture.alpha.len()], 1);
    // Half a crop, in pixels of the small view.
    let half = (crop as f32 / 2.0 * small.focal.y / camera.focal.y).round() as i32;
    let (width, height) = (small.size.x as i32, small.size.y as i32);
    let covered = |x: i32, y: i32| {
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        f32::from(u8::from(inside && picture.alpha[(y * width + x) as usize] > 0.9))
    };
    let around = |x: i32, y: i32| {
        let (mut sum, mut n) = (0.0, 0.0_f32);
        // Every other pixel tells enough.
        for dy in (-half..=half).step_by(2) {
            for dx in (-half..=half).step_by(2) {
                (sum, n) = (sum + covered(x + dx, y + dy), n + 1.0);
            }
        }
        sum / n
    };
    let world_from_view = small.view_from_world.inverse();
    let mut depths: Vec<f32> = (picture.depth.iter().zip(&picture.alpha))
        .filter(|(_, alpha)| **alpha > 0.9)
        .map(|(depth, alpha)| depth / alpha)
        .collect();
    depths.sort_by(f32::total_cmp);
    let scale = camera.focal.y / depths.get(depths.len() / 2).copied().unwrap_or(camera.focal.y);
    let solid: Vec<(f32, Vec3)> = (0..width * height)
        .filter(|&i| covered(i % width, i / width) > 0.0)
        .map(|i| {
            let depth = picture.depth[i as usize] / picture.alpha[i as usize];
            let pixel = glam::Vec2::new((i % width) as f32, (i / width) as f32) + 0.5;
            let ray = ((pixel - small.center) / small.focal).extend(1.0);
            (around(i % width, i / width), world_from_view.transform_point3(depth * ray))
        })
        .collect();
    // A small object covers no crop to half. Then the best covered ones are taken.
    let most = solid.iter().fold(0.0_f32, |most, (share, _)| most.max(*share));
    let enough = LEAST_COVERED.min(0.9 * most);
    let targets = solid.into_iter().filter(|(share, _)| *share >= enough).map(|(_, point)| point).collect();
    (View { camera, targets, scale, distance: 0 }, picture, pixels)
}

/// The group of a view with `scale` among those of all views, sorted.
fn distance(scale: f32, scales: &[f32]) -> usize {
    scales.partition_point(|other| *other < scale) * DISTANCES / scales.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_grouped_by_distance() {
        let scales = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        assert_eq!(scales.map(|scale| distance(scale, &scales)), [0, 0, 1, 1, 2, 2]);
        assert_eq!(distance(7.0, &[7.0]), 0);
        // Views from equally far away are one group.
        assert_eq!([7.0, 7.0, 7.0, 7.0].map(|scale| distance(scale, &[7.0; 4])), [0; 4]);
    }
}
