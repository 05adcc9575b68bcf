//! The K nearest neighbors of every Gaussian: the decoder's neighborhoods.

use std::num::NonZero;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::work::{Canceled, Work};

/// Neighbor lists `[N, K]`, row-major.
///
/// A list begins with the Gaussian itself. The others follow by ascending distance, and at equal distances by
/// source index, so that lists depend neither on the order in memory nor on the search. Parts of one source
/// Gaussian come in the order of the scene. If there are fewer than K Gaussians, the Gaussian itself fills the
/// rest of its list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Neighbors {
    /// K, the length of each list.
    pub k: usize,
    /// Gaussian indices `[N, K]`.
    pub indices: Vec<u32>,
}

/// Gaussians at one and the same point, by ascending source index.
type Cluster = Vec<u32>;

impl Neighbors {
    /// Finds the exact K nearest neighbors of each mean. `order` `[N]` holds source indices, which break ties.
    ///
    /// Equal points enter the k-d tree once: a scene with very many of them is no slower than any other.
    ///
    /// # Panics
    /// If `order` is not as long as `means`, a mean is not finite, or k is 0.
    pub fn find(means: &[Vec3], order: &[u32], k: usize) -> Self {
        match Self::find_if_wanted(means, order, k, &Work::default()) {
            Ok(found) => found,
            Err(Canceled) => unreachable!("nobody cancels it"),
        }
    }

    /// As [`find`](Self::find).
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn find_if_wanted(means: &[Vec3], order: &[u32], k: usize, work: &Work) -> Result<Self, Canceled> {
        assert_eq!(means.len(), order.len(), "order [N]");
        let n_nearest = NonZero::new(k).expect("K is at least 1");
        let (points, clusters, cluster_from_gaussian) = cluster_equal_points(means, order);
        let search = Search { tree: tree(&points), points, clusters, order, n_nearest };
        let mut indices = vec![0; means.len() * k];
        indices.par_chunks_exact_mut(k).enumerate().try_for_each_init(Vec::new, |found, (i, row)| {
            search.nearest(cluster_from_gaussian[i] as usize, found);
            fill(row, i as u32, found);
            work.check()
        })?;
        Ok(Self { k, indices })
    }

    /// The lists shortened to the nearest `k`.
    pub fn truncated(&self, k: usize) -> Self {
        let indices = self.indices.chunks_exact(self.k).flat_map(|row| &row[..k.min(self.k)]).copied();
        Self { k: k.min(self.k), indices: indices.collect() }
    }
}

/// Fills a list: the Gaussian itself, those found, and itself again if too few were found.
fn fill(row: &mut [u32], itself: u32, found: &[(f64, u32, u32)]) {
    let others = found.iter().map(|&(_, _, gaussian)| gaussian).filter(|&gaussian| gaussian != itself);
    let list = std::iter::once(itself).chain(others).chain(std::iter::repeat(itself));
    for (entry, gaussian) in row.iter_mut().zip(list) {
        *entry = gaussian;
    }
}

/// The k-d tree of all points, or `None` if there are none.
fn tree(points: &[[f64; 3]]) -> Option<ImmutableKdTree<f64, 3>> {
    if points.is_empty() { None } else { ImmutableKdTree::new_from_slice(points).ok() }
}

/// The distinct points, the Gaussians at each, and the cluster of each Gaussian.
fn cluster_equal_points(means: &[Vec3], order: &[u32]) -> (Vec<[f64; 3]>, Vec<Cluster>, Vec<u32>) {
    // -0 and 0 are the same point with different bits. Adding zero turns -0 into 0.
    let key = |i: u32| (means[i as usize] + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut by_point: Vec<u32> = (0..means.len() as u32).collect();
    by_point.par_sort_unstable_by_key(|&i| (key(i), order[i as usize], i));
    let (mut points, mut clusters) = (Vec::new(), Vec::<Cluster>::new());
    let mut cluster_from_gaussian = vec![0; means.len()];
    for (position, &i) in by_point.iter().enumerate() {
        if position == 0 || key(by_point[position - 1]) != key(i) {
            // In f64 squared distances of f32 points are nearly exact, so that rounding hardly ever makes or
            // breaks a tie.
            points.push(means[i as usize].to_array().map(f64::from));
            clusters.push(Vec::new());
        }
        let cluster = clusters.len() - 1;
        clusters[cluster].push(i);
        cluster_from_gaussian[i as usize] = cluster as u32;
    }
    (points, clusters, cluster_from_gaussian)
}

/// The search for neighbors: the tree, and the Gaussians behind its points.
struct Search<'a> {
    tree: Option<ImmutableKdTree<f64, 3>>,
    points: Vec<[f64; 3]>,
    clusters: Vec<Cluster>,
    order: &'a [u32],
    n_nearest: NonZero<usize>,
}

impl Search<'_> {
    /// The nearest K + 1 Gaussians of a point as (squared distance, source index, Gaussian), sorted. One more
    /// than K, since the Gaussian that asks may be among them, and moves to the front of its list.
    fn nearest(&self, cluster: usize, found: &mut Vec<(f64, u32, u32)>) {
        found.clear();
        let Some(tree) = &self.tree else { return };
        let (query, wanted) = (&self.points[cluster], self.n_nearest.saturating_add(1));
        let nearest = tree.query(query).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
        // With the point itself among them, the last of the K + 1 enters no list, and an arbitrary choice of it
        // does no harm. If the one before it is as far away, the choice matters, and further points at that
        // distance may have been left out.
        let full = nearest.len() == wanted.get() && self.points.len() > wanted.get();
        let radius = nearest.last().map_or(0.0, |item| item.distance);
        let tied = full && nearest.iter().rev().nth(1).is_some_and(|item| item.distance == radius);
        let mut add = |distance: f64, cluster: usize| {
            // Members are sorted by source index, so that those beyond K + 1 can never enter a list.
            let members = self.clusters[cluster].iter().take(wanted.get());
            found.extend(members.map(|&i| (distance, self.order[i as usize], i)));
        };
        if tied {
            // The tree returned an arbitrary choice of the points at the last distance. Ask for all of them.
            let within = tree.query(query).within::<SquaredEuclidean<f64>>(radius).execute();
            within.iter().for_each(|item| add(item.distance, item.item as usize));
        } else {
            nearest.iter().for_each(|item| add(item.distance, item.item as usize));
        }
        // Gaussians are distinct, so an unstable sort gives one order only.
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        found.truncate(wanted.get());
    }
}
