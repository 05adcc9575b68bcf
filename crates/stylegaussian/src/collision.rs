//! Collision for a captured scene: voxels that are occupied, merged into boxes.
//!
//! A voxel is occupied if half of a ray's light would be gone in it, the rule by which a ray hits
//! ([`raycast`](crate::raycast)). Each Gaussian takes the light that the highest alpha anywhere in the voxel
//! takes, so a surface is at most one voxel thicker than it looks. The boxes are plain data for any physics
//! engine:
//!
//! ```
//! # use stylegaussian::{Scene, collision::{CollisionError, VoxelSettings, Voxels}};
//! # fn colliders(scene: &Scene) -> Result<(), CollisionError> {
//! let voxels = Voxels::new(scene, &VoxelSettings { size: 0.1, ..VoxelSettings::default() })?;
//! for solid in voxels.boxes() {
//!     println!("a box of size {} at {}", solid.max - solid.min, (solid.min + solid.max) / 2.0);
//! }
//! # Ok(())
//! # }
//! ```

use glam::{UVec3, Vec3};
use rayon::prelude::*;

use crate::Scene;

mod boxes;
mod footprint;
#[cfg(test)]
mod tests;

pub use boxes::CollisionBox;
use footprint::Footprint;

/// The transmittance at which a voxel is occupied, as a ray hits.
const OCCUPIED: f32 = 0.5;

/// The most voxels of a grid: 2^26, of four bytes each while it is made.
pub const MOST_VOXELS: u64 = 1 << 26;

/// Settings of [`Voxels::new`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelSettings {
    /// The edge of a voxel, in units of the scene, above 0. About half of the smallest thing that should stop
    /// something.
    pub size: f32,
    /// The box in which voxels are made, least and greatest corner. If `None`, the box around the means of all
    /// Gaussians that occupy a voxel alone.
    pub bounds: Option<[Vec3; 2]>,
    /// The least number of voxels that hang together by their faces. Smaller groups are floaters, and left out.
    pub least_group: usize,
}

impl Default for VoxelSettings {
    /// Voxels of a tenth of a unit. Captures are often in meters, where that is less than a step. A floater has
    /// less than 2^3 voxels, the least that resolves a thing in each direction.
    fn default() -> Self {
        Self { size: 0.1, bounds: None, least_group: 8 }
    }
}

/// A grid cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CollisionError {
    /// The size of voxels is no length.
    #[error("voxels have a size of {0}, expected a finite number above 0")]
    Size(f32),
    /// The bounds are no box.
    #[error("bounds are {0} and {1}, expected finite corners, the least one first")]
    Bounds(Vec3, Vec3),
    /// The grid would be too large.
    #[error("{0}x{1}x{2} voxels, expected at most {MOST_VOXELS}; choose larger voxels or smaller bounds")]
    TooMany(f64, f64, f64),
}

/// The voxels of a scene that are occupied.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Voxels {
    /// The least corner of the grid, in scene space.
    pub origin: Vec3,
    /// The edge of a voxel, in units of the scene.
    pub size: f32,
    /// Number of voxels along each axis.
    pub counts: UVec3,
    /// Whether each voxel is occupied `[z, y, x]`.
    pub occupied: Vec<bool>,
}

impl Voxels {
    /// Finds the occupied voxels of a scene. The result is the same for any number of threads. Gaussians that
    /// are not finite are left out.
    ///
    /// # Errors
    /// If the size or the bounds are not usable, or need more than [`MOST_VOXELS`].
    pub fn new(scene: &Scene, settings: &VoxelSettings) -> Result<Self, CollisionError> {
        let size = settings.size;
        if !(size.is_finite() && size > 0.0) {
            return Err(CollisionError::Size(size));
        }
        let Some([least, greatest]) = settings.bounds.or_else(|| solid_bounds(scene)) else {
            return Ok(Self { size, ..Self::default() });
        };
        let mut voxels = Self::empty(least, greatest, size)?;
        let footprints: Vec<_> =
            (0..scene.len()).into_par_iter().filter_map(|i| Footprint::new(scene, i, &voxels)).collect();
        voxels.occupied = voxels.occupied_by(&footprints);
        voxels.remove_groups(settings.least_group);
        Ok(voxels)
    }

    /// Whether a point in scene space is in an occupied voxel.
    pub fn contains(&self, point: Vec3) -> bool {
        let at = self.in_grid(point).floor();
        let is_inside = at.cmpge(Vec3::ZERO).all() && at.cmplt(self.counts.as_vec3()).all();
        is_inside && self.occupied[self.index(at.as_uvec3())]
    }

    /// A grid without any occupied voxel.
    fn empty(least: Vec3, greatest: Vec3, size: f32) -> Result<Self, CollisionError> {
        if !(least.is_finite() && greatest.is_finite() && least.cmple(greatest).all()) {
            return Err(CollisionError::Bounds(least, greatest));
        }
        // One more than fits, so that the greatest corner is in a voxel. In f64, where no product overflows.
        let counts = ((greatest.as_dvec3() - least.as_dvec3()) / f64::from(size)).floor() + 1.0;
        if counts.element_product() > MOST_VOXELS as f64 {
            return Err(CollisionError::TooMany(counts.x, counts.y, counts.z));
        }
        let counts = counts.as_uvec3();
        let n = counts.x as usize * counts.y as usize * counts.z as usize;
        Ok(Self { origin: least, size, counts, occupied: vec![false; n] })
    }

    /// A point in units of voxels from the least corner.
    fn in_grid(&self, point: Vec3) -> Vec3 {
        (point - self.origin) / self.size
    }

    fn index(&self, at: UVec3) -> usize {
        let [x, y, z] = at.to_array().map(|i| i as usize);
        (z * self.counts.y as usize + y) * self.counts.x as usize + x
    }

    /// Whether each voxel is occupied `[z, y, x]`. Layers are computed side by side, each over its Gaussians in
    /// their order.
    fn occupied_by(&self, footprints: &[Footprint]) -> Vec<bool> {
        let mut in_layer = vec![Vec::new(); self.counts.z as usize];
        for (i, footprint) in footprints.iter().enumerate() {
            (footprint.begin.z..footprint.end.z).for_each(|z| in_layer[z as usize].push(i));
        }
        let layer = self.counts.x as usize * self.counts.y as usize;
        let layers = in_layer.into_par_iter().enumerate().flat_map_iter(|(z, members)| {
            let mut light = vec![1.0_f32; layer];
            for footprint in members.into_iter().map(|i| &footprints[i]) {
                for y in footprint.begin.y..footprint.end.y {
                    for x in footprint.begin.x..footprint.end.x {
                        let at = UVec3::new(x, y, z as u32);
                        light[(y * self.counts.x + x) as usize] *= 1.0 - footprint.alpha(at);
                    }
                }
            }
            light.into_iter().map(|light| light <= OCCUPIED)
        });
        layers.collect()
    }

    /// Frees groups of less than `least` voxels that hang together by their faces.
    fn remove_groups(&mut self, least: usize) {
        let mut is_known = vec![false; self.occupied.len()];
        let mut group = Vec::new();
        for first in 0..self.occupied.len() {
            if !self.occupied[first] || is_known[first] {
                continue;
            }
            group.clear();
            group.push(first);
            is_known[first] = true;
            let mut next = 0;
            while let Some(&at) = group.get(next) {
                next += 1;
                for neighbor in self.neighbors(at).into_iter().flatten() {
                    if self.occupied[neighbor] && !std::mem::replace(&mut is_known[neighbor], true) {
                        group.push(neighbor);
                    }
                }
            }
            if group.len() < least {
                group.iter().for_each(|&at| self.occupied[at] = false);
            }
        }
    }

    /// The voxels that share a face with the voxel at an index.
    fn neighbors(&self, index: usize) -> [Option<usize>; 6] {
        let counts = self.counts.to_array().map(|count| count as usize);
        let steps = [1, counts[0], counts[0] * counts[1]];
        let mut neighbors = [None; 6];
        for axis in 0..3 {
            let at = index / steps[axis] % counts[axis];
            neighbors[2 * axis] = (at > 0).then(|| index - steps[axis]);
            neighbors[2 * axis + 1] = (at + 1 < counts[axis]).then(|| index + steps[axis]);
        }
        neighbors
    }
}

/// The box around the means of all Gaussians that occupy a voxel alone.
fn solid_bounds(scene: &Scene) -> Option<[Vec3; 2]> {
    let opaque = scene.means.iter().zip(&scene.opacities).filter(|(_, opacity)| **opacity >= 1.0 - OCCUPIED);
    let means = opaque.map(|(mean, _)| *mean).filter(|mean| mean.is_finite());
    means.map(|mean| [mean, mean]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}
