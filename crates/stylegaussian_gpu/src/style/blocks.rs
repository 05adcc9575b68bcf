//! Blocks: parts of a scene that are decoded one after another, so that scratch memory does not grow with the
//! scene.
//!
//! A layer reads the output of the layer before it at the neighbors of its rows. A block lists some Gaussians
//! that lie together, then their other neighbors, then the other neighbors of these: one *halo* for each layer.
//! The last layer computes the block's own Gaussians, the layer before it also the first halo, and so on.
//! Layers number rows by their place in the block's list. The rows of each layer come first in it, so that one
//! array of neighbors serves all layers.
//!
//! Halos are computed by several blocks. Captured scenes are surfaces, where 8 neighbors reach sqrt(8 / pi) =
//! 1.6 spacings far. Around a square of 256 x 256 Gaussians, the widest of four halos makes it 269 x 269: a
//! tenth more.

use stylegaussian::{Scene, fold, morton, neighbors::Neighbors};

use super::{options::StyleOptions, shape::StyleShape};

/// Smallest share of the room that a block's own Gaussians may take, as a divisor. A scene that needs smaller
/// blocks has neighbor lists of distant Gaussians, and its halos would cost more than they save. (If Gaussians
/// fill a volume, halos take half of the room.)
const SMALLEST_PART: usize = 8;

/// Share of the room that a block's own Gaussians get at first. The halos get the rest.
const OWN_SHARE: f64 = 0.8;

/// The rows of a block that each layer computes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct BlockShape {
    /// Rows that each layer computes `[layers]`, from the front of the block's list. The last layer computes
    /// the block's own Gaussians.
    pub rows: Vec<usize>,
    /// Whether the block is not the whole scene.
    pub is_part: bool,
}

/// One block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Block {
    pub shape: BlockShape,
    /// The Gaussian of each row. Empty if the block is the whole scene.
    pub gaussians: Vec<u32>,
    /// The neighbors of the rows of the first layer `[rows, K]`, as rows.
    pub neighbors: Vec<u32>,
}

/// A scene cut into blocks: a single one that is the whole scene, or several.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    pub list: Vec<Block>,
    /// The most rows of a block that a hidden layer computes.
    pub capacity: usize,
}

impl BlockShape {
    /// The whole of a scene of `shape`.
    pub fn whole(shape: &StyleShape) -> Self {
        Self { rows: vec![shape.n_gaussians; shape.n_layers()], is_part: false }
    }

    /// The number of the block's own Gaussians, which the last layer computes.
    pub fn n_own(&self) -> usize {
        self.rows.last().copied().unwrap_or(0)
    }

    /// The number of rows that have neighbor lists.
    pub fn n_lists(&self) -> usize {
        self.rows[0]
    }
}

impl Blocks {
    /// Cuts `scene` into blocks that keep to the scratch memory of `options`. Finds neighbors if the scene has
    /// none.
    pub fn of_scene(scene: &Scene, shape: &StyleShape, options: &StyleOptions) -> Self {
        let neighbors = || fold::neighbors_for(scene, shape.k).into_owned();
        Self::cut(shape, &scene.means, neighbors, options.max_rows(shape))
    }

    /// Cuts a scene of `shape` into blocks. Their hidden layers compute at most `max_rows` rows. The scene
    /// stays whole if it fits, or if its neighbors are not near one another.
    fn cut(
        shape: &StyleShape,
        means: &[glam::Vec3],
        neighbors: impl FnOnce() -> Neighbors,
        max_rows: usize,
    ) -> Self {
        if shape.n_gaussians <= max_rows {
            return Self::whole(shape, neighbors().indices);
        }
        let neighbors = neighbors();
        // Runs of Gaussians in Morton order lie together.
        match Cutter::new(&neighbors, shape.n_layers(), max_rows).cut(&morton::order(means)) {
            Some(list) => {
                let capacity = list.iter().map(|block| block.shape.n_lists()).max().unwrap_or(0);
                Self { list, capacity }
            }
            None => Self::whole(shape, neighbors.indices),
        }
    }

    /// The whole scene as one block, with its own neighbor lists `[N, K]`.
    fn whole(shape: &StyleShape, neighbors: Vec<u32>) -> Self {
        let block = Block { shape: BlockShape::whole(shape), gaussians: Vec::new(), neighbors };
        Self { list: vec![block], capacity: shape.n_gaussians }
    }

    /// Bytes of all neighbor lists of K and of all lists of Gaussians on the GPU.
    pub fn bytes(&self, k: usize) -> u64 {
        let of_block = |block: &Block| 4 * (block.gaussians.len() + k * block.shape.n_lists()) as u64;
        self.list.iter().map(of_block).sum()
    }
}

/// A scene that is being cut into blocks.
struct Cutter<'a> {
    neighbors: &'a Neighbors,
    n_layers: usize,
    max_rows: usize,
    /// The row of each Gaussian in the current block `[N]`, or `ABSENT`.
    row_from_gaussian: Vec<u32>,
}

const ABSENT: u32 = u32::MAX;

impl<'a> Cutter<'a> {
    fn new(neighbors: &'a Neighbors, n_layers: usize, max_rows: usize) -> Self {
        let n = neighbors.indices.len() / neighbors.k;
        Self { neighbors, n_layers, max_rows, row_from_gaussian: vec![ABSENT; n] }
    }

    /// Blocks of runs of `order`, or `None` if neighbors are not near one another.
    fn cut(mut self, order: &[u32]) -> Option<Vec<Block>> {
        let smallest = self.max_rows.div_ceil(SMALLEST_PART);
        let mut size = ((self.max_rows as f64 * OWN_SHARE) as usize).max(1);
        let (mut blocks, mut rest) = (Vec::new(), order);
        while !rest.is_empty() {
            // The rest in blocks of equal sizes, rather than a small last one that is mostly halo.
            let n = rest.len().div_ceil(rest.len().div_ceil(size));
            if let Some(block) = self.block(&rest[..n]) {
                blocks.push(block);
                rest = &rest[n..];
            } else {
                // The halos did not fit: fewer own Gaussians leave them more room.
                size = n * 3 / 4;
                if size < smallest {
                    return None;
                }
            }
        }
        Some(blocks)
    }

    /// The block of `own` Gaussians, or `None` if its halos are too large.
    fn block(&mut self, own: &[u32]) -> Option<Block> {
        let mut gaussians = Vec::with_capacity(self.max_rows);
        own.iter().for_each(|&gaussian| self.add(gaussian, &mut gaussians));
        let (mut rows, mut first) = (Vec::with_capacity(self.n_layers), 0);
        for _ in 0..self.n_layers {
            let n = gaussians.len();
            if n > self.max_rows {
                break;
            }
            rows.push(n);
            // The neighbors of earlier rows are in the list already.
            for row in first..n {
                for &neighbor in self.list(gaussians[row]) {
                    self.add(neighbor, &mut gaussians);
                }
            }
            first = n;
        }
        // Found from the last layer to the first.
        rows.reverse();
        let fits = rows.len() == self.n_layers;
        let lists = gaussians.iter().take(if fits { rows[0] } else { 0 });
        let neighbors = lists.flat_map(|&gaussian| self.list(gaussian));
        let neighbors = neighbors.map(|&gaussian| self.row_from_gaussian[gaussian as usize]).collect();
        // Only the touched entries, so that the cost of a block does not depend on the size of the scene.
        gaussians.iter().for_each(|&gaussian| self.row_from_gaussian[gaussian as usize] = ABSENT);
        fits.then_some(Block { shape: BlockShape { rows, is_part: true }, gaussians, neighbors })
    }

    fn list(&self, gaussian: u32) -> &'a [u32] {
        let k = self.neighbors.k;
        &self.neighbors.indices[gaussian as usize * k..][..k]
    }

    fn add(&mut self, gaussian: u32, gaussians: &mut Vec<u32>) {
        let row = &mut self.row_from_gaussian[gaussian as usize];
        if *row == ABSENT {
            *row = gaussians.len() as u32;
            gaussians.push(gaussian);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn shape(n_gaussians: usize, n_layers: usize) -> StyleShape {
        let widths = std::iter::repeat_n(8, n_layers).chain([3]).collect();
        StyleShape { n_gaussians, k: 3, widths, residual: false, smoothing_passes: 0 }
    }

    /// 12 Gaussians in a row; the neighbors of each are itself, the one before and the one after.
    fn row() -> (Vec<Vec3>, Neighbors) {
        let means: Vec<Vec3> = (0..12).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
        let near = |i: u32| [i, i.saturating_sub(1), (i + 1).min(11)];
        (means, Neighbors { k: 3, indices: (0..12).flat_map(near).collect() })
    }

    #[test]
    fn halos_stand_around_their_gaussians() {
        let (means, neighbors) = row();
        let cut = Blocks::cut(&shape(12, 2), &means, || neighbors, 8);
        let [first, second] = &cut.list[..] else { panic!("{cut:?}") };
        assert_eq!(cut.capacity, 7);
        // The last layer 0..6, the first layer 0..7, which looks at 0..8.
        assert_eq!(first.shape, BlockShape { rows: vec![7, 6], is_part: true });
        assert_eq!(first.gaussians, [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(first.neighbors[15..], [5, 4, 6, 6, 5, 7]);
        assert_eq!(second.shape, first.shape);
        assert_eq!(second.gaussians, [6, 7, 8, 9, 10, 11, 5, 4]);
        assert_eq!(second.neighbors[..3], [0, 6, 1]);
        assert_eq!(cut.bytes(3), 4 * 2 * (8 + 3 * 7));
    }

    #[test]
    fn what_fits_stays_whole() {
        let (means, neighbors) = row();
        let lists = neighbors.indices.clone();
        let cut = Blocks::cut(&shape(12, 2), &means, || neighbors, 12);
        let whole = BlockShape { rows: vec![12; 2], is_part: false };
        assert_eq!(cut.list, [Block { shape: whole, gaussians: vec![], neighbors: lists }]);
    }

    /// The neighbors of every Gaussian are itself and two distant ones.
    #[test]
    fn neighbors_that_are_not_near_stay_whole() {
        let n = 4000;
        let (means, near) = (vec![Vec3::ZERO; n as usize], |i: u32| [i, i * 7919 % n, i * 104_729 % n]);
        let neighbors = Neighbors { k: 3, indices: (0..n).flat_map(near).collect() };
        let cut = Blocks::cut(&shape(n as usize, 5), &means, || neighbors, 200);
        assert_eq!((cut.list.len(), cut.capacity), (1, n as usize));
    }

    /// Every row of every layer finds its neighbors among the rows of the layer before.
    #[test]
    fn each_layer_computes_what_the_next_one_reads() {
        let (means, neighbors) = row();
        for n_layers in 1..4 {
            let cut = Blocks::cut(&shape(12, n_layers), &means, || neighbors.clone(), 11);
            let mut decoded = Vec::new();
            for block in &cut.list {
                assert!(block.shape.is_part);
                decoded.extend_from_slice(&block.gaussians[..block.shape.rows[n_layers - 1]]);
                for (layer, &n) in block.shape.rows.iter().enumerate() {
                    let available =
                        if layer == 0 { block.gaussians.len() } else { block.shape.rows[layer - 1] };
                    for row in 0..n {
                        let list = &neighbors.indices[block.gaussians[row] as usize * 3..][..3];
                        let local = &block.neighbors[row * 3..][..3];
                        let found = local.iter().map(|&row| block.gaussians[row as usize]);
                        assert!(found.eq(list.iter().copied()));
                        assert!(local.iter().all(|&row| (row as usize) < available));
                    }
                }
            }
            decoded.sort_unstable();
            assert!(decoded.into_iter().eq(0..12));
        }
    }
}
