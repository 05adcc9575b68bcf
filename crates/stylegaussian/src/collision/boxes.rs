//! Occupied voxels, merged into boxes.

use glam::{UVec3, Vec3};

use super::Voxels;

/// A box whose voxels are all occupied, in scene space and along its axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CollisionBox {
    /// The least corner.
    pub min: Vec3,
    /// The greatest corner.
    pub max: Vec3,
}

impl Voxels {
    /// Boxes that cover the occupied voxels and nothing else, and do not overlap. Each begins at the first
    /// voxel that is not covered yet and grows along x, then y, then z, as far as it can. That is not the least
    /// number of boxes, which nobody computes in reasonable time.
    pub fn boxes(&self) -> Vec<CollisionBox> {
        let corner = |at: UVec3| self.origin + self.size * at.as_vec3();
        self.merged()
            .into_iter()
            .map(|[begin, end]| CollisionBox { min: corner(begin), max: corner(end) })
            .collect()
    }

    /// The boxes in voxels: the first along each axis, and the one after the last.
    pub(super) fn merged(&self) -> Vec<[UVec3; 2]> {
        let mut is_free: Vec<bool> = self.occupied.iter().map(|occupied| !occupied).collect();
        let mut boxes = Vec::new();
        for index in 0..is_free.len() {
            if is_free[index] {
                continue;
            }
            let begin = self.place(index);
            let mut end = begin + 1;
            for axis in 0..3 {
                // The next sheet of voxels along the axis.
                while end[axis] < self.counts[axis] {
                    let (mut first, mut last) = (begin, end);
                    (first[axis], last[axis]) = (end[axis], end[axis] + 1);
                    if self.indices(first, last).any(|i| is_free[i]) {
                        break;
                    }
                    end[axis] += 1;
                }
            }
            self.indices(begin, end).for_each(|i| is_free[i] = true);
            boxes.push([begin, end]);
        }
        boxes
    }

    /// The voxel at an index.
    pub(super) fn place(&self, index: usize) -> UVec3 {
        let [x, y] = [self.counts.x as usize, self.counts.y as usize];
        UVec3::new((index % x) as u32, (index / x % y) as u32, (index / (x * y)) as u32)
    }

    /// The indices of the voxels of a box.
    pub(super) fn indices(&self, begin: UVec3, end: UVec3) -> impl Iterator<Item = usize> {
        let rows = (begin.z..end.z).flat_map(move |z| (begin.y..end.y).map(move |y| (y, z)));
        rows.flat_map(move |(y, z)| (begin.x..end.x).map(move |x| self.index(UVec3::new(x, y, z))))
    }
}
