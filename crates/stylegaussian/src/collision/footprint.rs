//! The voxels that a Gaussian reaches, and its alpha in them.

use glam::{Mat3, UVec3, Vec2, Vec3};

use super::Voxels;
use crate::{
    Scene,
    splat::{MAX_ALPHA, MIN_ALPHA},
};

/// The least standard deviation, in voxels. A sheet that is thinner than a tenth of a voxel is in the same
/// voxels as one that is not, and f32 resolves its ellipsoid.
const LEAST_SCALE: f32 = 0.1;

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
        let is_met = mean.is_finite() && half.is_finite() && begin.cmplt(end).all();
        is_met.then_some(Self { mean, precision, opacity, begin, end })
    }

    /// The highest alpha in a voxel, up to [`MAX_ALPHA`]; 0 below 1/255.
    ///
    /// The point of a box that is nearest to the mean, in standard deviations, is the mean or lies on a face
    /// that the mean sees: from any other point, the way to the mean goes on within the box.
    pub(super) fn alpha(&self, voxel: UVec3) -> f32 {
        let least = voxel.as_vec3() - self.mean;
        let bounds = [least, least + 1.0];
        let faces = (0..3).filter_map(|axis| {
            let [least, greatest] = bounds.map(|corner| corner[axis]);
            let seen = if least > 0.0 { least } else { greatest };
            (least > 0.0 || greatest < 0.0).then(|| self.nearest_of_face(axis, seen, bounds))
        });
        self.alpha_at(self.mean + self.nearest(faces).unwrap_or(Vec3::ZERO))
    }

    /// The point of a voxel's face that is nearest to the mean, in standard deviations, as an offset from it.
    /// On the face, the coordinate of `axis` is `fixed`.
    fn nearest_of_face(&self, axis: usize, fixed: f32, [least, greatest]: [Vec3; 2]) -> Vec3 {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let p = |row: usize, column: usize| self.precision.col(column)[row];
        let at = |on_a: f32, on_b: f32| {
            let mut offset = Vec3::splat(fixed);
            (offset[a], offset[b]) = (on_a, on_b);
            offset
        };
        // Where both derivatives along the face are 0, by Cramer's rule.
        let determinant = p(a, a) * p(b, b) - p(a, b) * p(a, b);
        let middle = fixed / determinant
            * Vec2::new(
                p(a, b) * p(axis, b) - p(b, b) * p(axis, a),
                p(a, b) * p(axis, a) - p(a, a) * p(axis, b),
            );
        let middle = at(middle.x, middle.y);
        if middle.cmpge(least).all() && middle.cmple(greatest).all() {
            return middle;
        }
        // Otherwise on one of its edges, each of which fixes one more coordinate.
        let along_b =
            |on_a: f32| (-(p(axis, b) * fixed + p(a, b) * on_a) / p(b, b)).clamp(least[b], greatest[b]);
        let along_a =
            |on_b: f32| (-(p(axis, a) * fixed + p(a, b) * on_b) / p(a, a)).clamp(least[a], greatest[a]);
        let edges = [least, greatest]
            .into_iter()
            .flat_map(|corner| [at(corner[a], along_b(corner[a])), at(along_a(corner[b]), corner[b])]);
        self.nearest(edges).unwrap_or(middle)
    }

    /// The nearest of some offsets, in standard deviations.
    fn nearest(&self, offsets: impl Iterator<Item = Vec3>) -> Option<Vec3> {
        let squared = |offset: &Vec3| offset.dot(self.precision * *offset);
        offsets.min_by(|a, b| squared(a).total_cmp(&squared(b)))
    }

    /// The alpha at a point, in units of voxels.
    pub(super) fn alpha_at(&self, point: Vec3) -> f32 {
        let offset = point - self.mean;
        // A Gaussian so wide that its precision is 0 in f32 has its opacity everywhere, also if this is no
        // number.
        let q = offset.dot(self.precision * offset).max(0.0);
        let alpha = (self.opacity * (-0.5 * q).exp()).min(MAX_ALPHA);
        if alpha >= MIN_ALPHA { alpha } else { 0.0 }
    }
}
