//! A tree of boxes over a list, of which neighbors are neighbors in space.

use std::{cmp::Reverse, collections::BinaryHeap, ops::Range};

use glam::Vec3;

use super::Ray;

/// Entries of the list in a leaf.
const LEAF: usize = 8;

/// A complete binary tree: node i has the children 2i + 1 and 2i + 2, and the last nodes are the leaves, in the
/// list's order.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    boxes: Vec<[Vec3; 2]>,
    n_inner: usize,
    n_entries: usize,
}

/// The leaves that a ray meets, nearest first.
pub(super) struct Leaves<'a> {
    tree: &'a Tree,
    origin: Vec3,
    /// 1 / direction.
    inverse: Vec3,
    /// Nodes by the distance at which the ray enters them, the nearest on top. Distances are not negative, so
    /// their bits are ordered as they are.
    open: BinaryHeap<Reverse<(u32, u32)>>,
}

const EMPTY: [Vec3; 2] = [Vec3::INFINITY, Vec3::NEG_INFINITY];

fn union(a: [Vec3; 2], b: [Vec3; 2]) -> [Vec3; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl Tree {
    /// A tree over these boxes.
    pub(super) fn new(entries: &[[Vec3; 2]]) -> Self {
        let n_leaves = entries.len().div_ceil(LEAF).next_power_of_two();
        let n_inner = n_leaves - 1;
        let mut boxes = vec![EMPTY; n_inner + n_leaves];
        for (leaf, of_leaf) in entries.chunks(LEAF).enumerate() {
            boxes[n_inner + leaf] = of_leaf.iter().copied().fold(EMPTY, union);
        }
        for node in (0..n_inner).rev() {
            boxes[node] = union(boxes[2 * node + 1], boxes[2 * node + 2]);
        }
        Self { boxes, n_inner, n_entries: entries.len() }
    }

    /// Begins with a ray.
    pub(super) fn begin(&self, ray: Ray) -> Leaves<'_> {
        let mut leaves = Leaves {
            tree: self,
            origin: ray.origin,
            inverse: ray.direction.recip(),
            open: BinaryHeap::new(),
        };
        leaves.open(0);
        leaves
    }
}

impl Leaves<'_> {
    /// The next leaf: the distance at which the ray enters it, and its entries. No later leaf is entered
    /// nearer.
    pub(super) fn next_leaf(&mut self) -> Option<(f32, Range<usize>)> {
        while let Some(Reverse((entry, node))) = self.open.pop() {
            let node = node as usize;
            if let Some(leaf) = node.checked_sub(self.tree.n_inner) {
                let end = (LEAF * (leaf + 1)).min(self.tree.n_entries);
                return Some((f32::from_bits(entry), LEAF * leaf..end));
            }
            self.open(2 * node + 1);
            self.open(2 * node + 2);
        }
        None
    }

    /// Adds a node if the ray meets it.
    fn open(&mut self, node: usize) {
        let [min, max] = self.tree.boxes[node];
        // The box of nothing.
        if min.x > max.x {
            return;
        }
        let (to_min, to_max) = ((min - self.origin) * self.inverse, (max - self.origin) * self.inverse);
        // A ray within the plane of a side gives 0 times infinity. `min` and `max` of f32 pass such a side
        // over.
        let (mut enter, mut leave) = (0.0_f32, f32::INFINITY);
        for axis in 0..3 {
            let (a, b) = (to_min[axis], to_max[axis]);
            if a.is_nan() || b.is_nan() {
                continue;
            }
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        // Rounding must not lose a box that is just touched.
        if enter <= leave * (1.0 + 1e-6) {
            self.open.push(Reverse((enter.to_bits(), node as u32)));
        }
    }
}
