//! The voxels that a Gaussian reaches, and its alpha in them.

use glam::{Mat3, UVec3, Vec3};

use super::Voxels;
use crate::{
    Scene,
    splat::{MAX_ALPHA, MIN_ALPHA},
};

/// The least standard deviation, in voxels. A sheet that is thinner than a tenth of a voxel is in the same voxels as one that
/// is not, and f32 resolves its ellipsoid.
const LEAST_SCALE: f32 = 0.1;

/// Sweeps of the descent in [`Footprint::alpha`]. A sweep is exact for ellipsoids along the axes; slanted ones need a few.
const SWEEPS: usize = 4;

/// A Gaussian in units of voxels.
pub(super) struct Footprint {
    mean: Vec3,
    /// The inverse covariance.
    precision: Mat3,
    opacity: f32,
    /// The voxels that it reaches: the first along each axis, and the one after the last.
    pub(super) begin: UVec3,
    pub(super) end: UVec3,
}

impl Footprint {
    /// The footprint of a Gaussian, or `None` if it reaches no voxel.
    pub(super) fn new(scene: &Scene, i: usize, voxels: &Voxels) -> Option<Self> {
        let (mean, rotation, opacity) = (scene.means[i], scene.rotations[i], scene.opacities[i]);
        let scales = (scene.scales[i] / voxels.size).max(Vec3::splat(LEAST_SCALE));
        let is_finite = mean.is_finite() && rotation.is_finite() && scene.scales[i].is_finite();
        if !(is_finite && opacity >= MIN_ALPHA && rotation.length_squared() > 0.0) {
            return None;
        }
        let axes = Mat3::from_quat(rotation.normalize());
        let whiten = Mat3::from_diagonal(scales.recip()) * axes.transpose();
        let mean = voxels.in_grid(mean);
        // A box around the image of a ball: the length of each row.
        let rows = (axes * Mat3::from_diagonal(scales)).transpose();
        let extent = (2.0 * (opacity / MIN_ALPHA).ln()).sqrt();
        let half = extent * Vec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
        let counts = voxels.counts.as_vec3();
        // Conversions to integers saturate, and boxes beside the grid are empty.
        let begin = (mean - half).floor().clamp(Vec3::ZERO, counts).as_uvec3();
        let end = ((mean + half).floor() + 1.0).clamp(Vec3::ZERO, counts).as_uvec3();
        let precision = whiten.transpose() * whiten;
        let is_met = precision.is_finite() && begin.cmplt(end).all();
        is_met.then_some(Self { mean, precision, opacity, begin, end })
    }

    /// The highest alpha in a voxel, up to [`MAX_ALPHA`]; never more than that, and 0 below 1/255.
    ///
    /// The point of a box that is nearest to the mean, in standard deviations, by descent along one axis after the other.
    pub(super) fn alpha(&self, voxel: UVec3) -> f32 {
        let least = voxel.as_vec3() - self.mean;
        let greatest = least + 1.0;
        let p = &self.precision;
        let mut offset = Vec3::ZERO.clamp(least, greatest);
        for _ in 0..SWEEPS {
            let [y, z] = [offset.y, offset.z];
            offset.x = (-(p.y_axis.x * y + p.z_axis.x * z) / p.x_axis.x).clamp(least.x, greatest.x);
            offset.y = (-(p.x_axis.y * offset.x + p.z_axis.y * z) / p.y_axis.y).clamp(least.y, greatest.y);
            offset.z =
                (-(p.x_axis.z * offset.x + p.y_axis.z * offset.y) / p.z_axis.z).clamp(least.z, greatest.z);
        }
        self.alpha_at(self.mean + offset)
    }

    /// The alpha at a point, in units of voxels.
    pub(super) fn alpha_at(&self, point: Vec3) -> f32 {
        let offset = point - self.mean;
        let q = offset.dot(self.precision * offset).max(0.0);
        let alpha = (self.opacity * (-0.5 * q).exp()).min(MAX_ALPHA);
        if alpha >= MIN_ALPHA { alpha } else { 0.0 }
    }
}
