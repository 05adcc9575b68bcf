//! From Gaussians to splats: cull, project, sort by depth.

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::alpha::{MIN_ALPHA, cutoff};
use crate::{
    camera::Camera,
    mask::Visibility,
    scene::{Scene, ScreenFilter},
};

/// Added to the diagonal of every 2D covariance, in px^2, so that no splat is thinner than about a pixel.
const LOW_PASS: f32 = 0.3;
/// The same of pixels of half the size: variances are in px^2.
const HALF_LOW_PASS: f32 = LOW_PASS / 4.0;

/// A Gaussian farther from the picture's center than this, in half pictures, is linearized as if it were at
/// this distance. The Jacobian grows without bound toward the side, and would smear such a Gaussian over the
/// picture.
const LINEARIZED_WITHIN: f32 = 1.3;

/// The footprint of one Gaussian.
///
/// With (dx, dy) the offset from its center in pixels and (a, b, c) the 2D covariance, alpha is opacity exp(-q
/// / 2) with q = (dx, dy) cov^-1 (dx, dy)^T. Completing the square gives q = (c / det) (dx - (b / c) dy)^2 +
/// dy^2 / c. This sum of two squares loses no digits on needles, and gives the extent of a row of pixels
/// directly.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splat {
    /// Projected mean, in pixels.
    pub center: Vec2,
    /// b / c: how far the middle of a row moves in x per pixel in y.
    pub slope: f32,
    /// c / det, in px^-2: the inverse variance within a row.
    pub row_precision: f32,
    /// 1 / c, in px^-2.
    pub y_precision: f32,
    /// Half width and height of the box around the pixels with q <= `cutoff`, in pixels.
    pub half_size: Vec2,
    /// The offset in y of the footprint's rightmost point (its leftmost is at the negative), in pixels.
    pub rightmost_dy: f32,
    /// Alpha at the center, 0..1, before it is capped.
    pub opacity: f32,
    /// The q at which alpha falls to [`MIN_ALPHA`]: see [`cutoff`].
    pub cutoff: f32,
    /// View-space z of the mean, in scene units.
    pub depth: f32,
    /// Index of the Gaussian in the scene.
    pub gaussian: u32,
}

/// The splats that can touch the picture, by ascending view-space z and, if that is equal, by Gaussian index.
pub(super) fn project(scene: &Scene, camera: &Camera, visibility: Option<&Visibility>) -> Vec<Splat> {
    project_with(&Projection::new(camera), scene, visibility)
}

/// The same by a given projection.
pub(super) fn project_with(
    projection: &Projection,
    scene: &Scene,
    visibility: Option<&Visibility>,
) -> Vec<Splat> {
    let splat = |i: usize| {
        let share = visibility.map_or(1.0, |visibility| visibility.share(i));
        projection.splat(scene, i, share * scene.opacities[i])
    };
    let splats: Vec<Splat> = (0..scene.len()).into_par_iter().filter_map(splat).collect();

    // Positive floats compare like their bits, so one integer holds the depth and, in its lower half, the
    // tie-breaker. Positions are ascending Gaussian indices here, since the parallel filter keeps the order.
    let mut keys: Vec<u64> = splats
        .par_iter()
        .enumerate()
        .map(|(position, splat)| u64::from(splat.depth.to_bits()) << 32 | position as u64)
        .collect();
    keys.par_sort_unstable();
    // The cast keeps the lower half, the position.
    keys.par_iter().map(|&key| splats[key as u32 as usize]).collect()
}

/// A camera with the values that projecting every Gaussian needs.
pub(crate) struct Projection<'a> {
    camera: &'a Camera,
    /// View from world, without the translation.
    rotation: Mat3,
    /// The largest |x / z| and |y / z| at which the projection is linearized.
    limit: Vec2,
    /// Whether splats keep the sums that they have in a picture of twice the width and height.
    is_half: bool,
}

impl<'a> Projection<'a> {
    /// The projection of `camera`.
    pub(crate) fn new(camera: &'a Camera) -> Self {
        let limit = LINEARIZED_WITHIN * camera.size.as_vec2() / (2.0 * camera.focal);
        Self { camera, rotation: camera.view_from_world.matrix3.into(), limit, is_half: false }
    }

    /// The same projection, into a picture of half the size if `is_half` is true.
    pub(super) fn of_half(self, is_half: bool) -> Self {
        Self { is_half, ..self }
    }

    /// The standard deviations of Gaussian `i` along its three axes as they appear in the picture, in pixels,
    /// without the low-pass. The Gaussian must be before the camera.
    pub(crate) fn axes_in_pixels(&self, scene: &Scene, i: usize) -> Vec3 {
        let mean: Vec3 = self.camera.view_from_world.transform_point3(scene.means[i]);
        let (row_x, row_y) = self.footprint_axes(scene, i, mean.truncate() / mean.z, mean.z);
        (row_x * row_x + row_y * row_y).map(f32::sqrt)
    }

    /// The gradients of a Gaussian's position on screen, x and y, in pixels per scene unit. `mean` is its
    /// view-space position, before the camera.
    pub(super) fn gradients(&self, mean: Vec3) -> (Vec3, Vec3) {
        let focal = self.camera.focal / mean.z;
        let ray = mean.truncate() / mean.z;
        let to_scene = self.rotation.transpose();
        let x = to_scene * Vec3::new(focal.x, 0.0, -focal.x * ray.x);
        let y = to_scene * Vec3::new(0.0, focal.y, -focal.y * ray.y);
        (x, y)
    }

    /// The splat of Gaussian `i` at this opacity, or `None` if no pixel would see it.
    fn splat(&self, scene: &Scene, i: usize, mut opacity: f32) -> Option<Splat> {
        let mean: Vec3 = self.camera.view_from_world.transform_point3(scene.means[i]);
        // Written so that NaN is culled too.
        let visible = mean.z > self.camera.near && opacity >= MIN_ALPHA;
        if !visible {
            return None;
        }
        let ray = mean.truncate() / mean.z;
        let center = self.camera.focal * ray + self.camera.center;
        if self.is_far_outside(scene.scales[i], center, ray, mean.z) {
            return None;
        }
        // Only the shape of the footprint is linearized, at a ray that may be clamped. The center is exact.
        let (row_x, row_y) = self.footprint_axes(scene, i, ray, mean.z);

        let a = row_x.length_squared() + LOW_PASS;
        let b = row_x.dot(row_y);
        let c = row_y.length_squared() + LOW_PASS;
        // a c - b^2 by Lagrange's identity. Subtracting the two products would cancel all digits of a needle.
        // With a = a0 + l, c = c0 + l and the low-pass l: a c - b^2 = (a0 c0 - b^2) + l (a0 + c0 + l).
        let det_before = row_x.cross(row_y).length_squared();
        let det = det_before + LOW_PASS * (a + c - LOW_PASS);
        let kept = match scene.filter {
            ScreenFilter::Antialiased => Some(det_before),
            ScreenFilter::Classic if self.is_half => {
                let squared = row_x.length_squared() + row_y.length_squared();
                Some(det_before + HALF_LOW_PASS * (squared + HALF_LOW_PASS))
            }
            ScreenFilter::Classic => None,
        };
        if let Some(kept) = kept {
            opacity *= compensation(kept, det);
            // Such a splat has no footprint.
            if opacity < MIN_ALPHA {
                return None;
            }
        }

        let cutoff = cutoff(opacity);
        // An ellipse reaches sqrt(cutoff variance) along each axis.
        let half_size = (cutoff * Vec2::new(a, c)).sqrt();
        let low = center + half_size;
        let high = center - half_size - self.camera.size.as_vec2();
        let inside = low.cmpge(Vec2::ZERO).all() && high.cmple(Vec2::ZERO).all();
        // Numbers that overflow make the determinant infinite or NaN.
        (inside && det.is_finite()).then(|| Splat {
            center,
            slope: b / c,
            row_precision: c / det,
            y_precision: 1.0 / c,
            half_size,
            // x is largest on q = cutoff at sqrt(cutoff / a) (a, b).
            rightmost_dy: b * (cutoff / a).sqrt(),
            opacity,
            cutoff,
            depth: mean.z,
            gaussian: i as u32,
        })
    }

    /// Whether a footprint around `center` stays outside of the picture even if the Gaussian's longest axis
    /// were that of a ball. Most Gaussians that a crop does not show are spared the rest by it.
    fn is_far_outside(&self, scales: Vec3, center: Vec2, ray: Vec2, z: f32) -> bool {
        let ray = ray.clamp(-self.limit, self.limit);
        // The lengths of the rows of J W, since those of W are orthonormal.
        let rows = self.camera.focal / z * (Vec2::ONE + ray * ray).map(f32::sqrt);
        let deviation = scales.max_element() * rows;
        // A little more, for rounding.
        let half_size = 1.001 * (cutoff(1.0) * (deviation * deviation + LOW_PASS)).map(f32::sqrt) + 0.001;
        let (low, high) = (center + half_size, center - half_size - self.camera.size.as_vec2());
        low.cmplt(Vec2::ZERO).any() || high.cmpgt(Vec2::ZERO).any()
    }

    /// The two rows of J W R S, in pixels. The 2D covariance is their Gram matrix, so it is never indefinite.
    fn footprint_axes(&self, scene: &Scene, i: usize, ray: Vec2, z: f32) -> (Vec3, Vec3) {
        let ray = ray.clamp(-self.limit, self.limit);
        let pixels_per_unit = self.camera.focal / z;
        // The columns of the transpose are the rows of W: the axes of view space in the world.
        let [x, y, z] = self.rotation.transpose().to_cols_array_2d().map(Vec3::from_array);
        let j_x = pixels_per_unit.x * (x - ray.x * z);
        let j_y = pixels_per_unit.y * (y - ray.y * z);
        // A row j of J W times R is R^T j as a vector, and S scales its entries.
        let gaussian_from_world = scene.rotations[i].inverse();
        (gaussian_from_world * j_x * scene.scales[i], gaussian_from_world * j_y * scene.scales[i])
    }
}

/// The factor by which the low-pass leaves a splat's sum over the picture as it was: alpha o exp(-q / 2) with
/// covariance C sums to 2 pi o sqrt(det C), so o is scaled by sqrt(det C / det (C + 0.3 I)). Below 1, and 0 for
/// a splat without area.
///
/// With the determinant before the low-pass, this is the 2D filter of Yu et al., "Mip-Splatting" (2024), as
/// gsplat's rasterize mode `antialiased` computes it. The determinants are positive sums, so neither is below
/// 0.
fn compensation(det_before: f32, det: f32) -> f32 {
    (det_before / det).sqrt()
}
