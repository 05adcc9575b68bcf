//! Triangles that are split until they are small.

use glam::Vec3;
use rustc_hash::FxHashMap;

use crate::work::{Canceled, Work};

/// Most triangles that splitting gives. A closed surface has two for each vertex, and the surface of that many
/// Gaussians takes about two seconds on two cores. A mesh that has more is not split.
pub const MAX_TRIANGLES: usize = 1 << 18;

/// Vertices are no farther from the origin than this along an axis: the fourth power of a distance is a number
/// then.
const FARTHEST: f32 = 1e9;

/// Factor of the longest edge if there would be too many triangles.
const COARSER: f32 = std::f32::consts::SQRT_2;

/// A mesh of small triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Split {
    /// Positions of the vertices: those that were given, then those that were added.
    pub positions: Vec<Vec3>,
    /// The triangles.
    pub triangles: Vec<[u32; 3]>,
    /// The two vertices between which each added vertex is the middle. They come before it.
    pub parents: Vec<[u32; 2]>,
}

impl Split {
    /// Splits `triangles`, which number the vertices at `positions`, until no edge is longer than `longest`, or
    /// until there are [`MAX_TRIANGLES`]. Edges are split in the middle, whichever triangle they belong to, so
    /// there are no gaps. Triangles are left out that name no vertex, or one that is not finite, or farther
    /// away than a billion units.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new(
        positions: Vec<Vec3>,
        triangles: impl IntoIterator<Item = [u32; 3]>,
        longest: f32,
        work: &Work,
    ) -> Result<Self, Canceled> {
        // Comparisons with NaN are false.
        let is_near = |at: &Vec3| at.abs().cmple(Vec3::splat(FARTHEST)).all();
        let is_there = |i: &u32| positions.get(*i as usize).is_some_and(is_near);
        let triangles = triangles.into_iter().filter(|corners| corners.iter().all(is_there)).collect();
        let mut split = Self { positions, triangles, parents: Vec::new() };
        let mut longest = longest;
        // NaN is not above 0 either.
        while longest > 0.0 && longest.is_finite() {
            work.check()?;
            let n_long = |corners: &[u32; 3]| split.long_edges(corners, longest).into_iter().filter(|l| *l);
            let n_after: usize = split.triangles.iter().map(|corners| 1 + n_long(corners).count()).sum();
            if n_after == split.triangles.len() {
                break;
            }
            if n_after > MAX_TRIANGLES {
                longest *= COARSER;
            } else {
                split.split(longest);
            }
        }
        Ok(split)
    }

    /// Whether each edge of a triangle is too long: from each corner to the next.
    fn long_edges(&self, corners: &[u32; 3], longest: f32) -> [bool; 3] {
        [0, 1, 2].map(|k| {
            let [a, b] = [corners[k], corners[(k + 1) % 3]].map(|i| self.positions[i as usize].as_dvec3());
            a.distance_squared(b) > f64::from(longest).powi(2)
        })
    }

    /// Splits each edge that is too long once.
    fn split(&mut self, longest: f32) {
        let mut known: FxHashMap<[u32; 2], u32> = FxHashMap::default();
        let mut after = Vec::with_capacity(2 * self.triangles.len());
        for corners in std::mem::take(&mut self.triangles) {
            let long = self.long_edges(&corners, longest);
            // The corner to begin at, so that few cases are left.
            let first = match long {
                [true, true, true] | [false, false, false] => 0,
                // The edge that stays is the last one, or the edge that is split is the first one.
                _ => (0..3).find(|&k| long[k] && !long[(k + 2) % 3]).unwrap_or(0),
            };
            let [a, b, c] = [0, 1, 2].map(|k| corners[(first + k) % 3]);
            let long = [0, 1, 2].map(|k| long[(first + k) % 3]);
            let mut middle = |a: u32, b: u32| {
                *known.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    let [from, to] = [a.min(b), a.max(b)].map(|i| self.positions[i as usize]);
                    // The sum of two positions may not be finite.
                    self.positions.push(0.5 * from + 0.5 * to);
                    self.parents.push([a.min(b), a.max(b)]);
                    (self.positions.len() - 1) as u32
                })
            };
            match long {
                [true, true, true] => {
                    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                    after.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
                }
                [true, true, false] => {
                    let (ab, bc) = (middle(a, b), middle(b, c));
                    after.extend([[ab, b, bc], [a, ab, bc], [a, bc, c]]);
                }
                [true, false, false] => {
                    let ab = middle(a, b);
                    after.extend([[a, ab, c], [ab, b, c]]);
                }
                _ => after.push(corners),
            }
        }
        self.triangles = after;
    }
}
