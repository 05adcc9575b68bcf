//! The K nearest neighbors of every Gaussian: the decoder's window.

use std::num::NonZero;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// Neighbor lists `[N, K]`, row-major: self first, then by ascending distance, ties by source index. With fewer than
/// K Gaussians the Gaussian itself fills the rest of its list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Neighbors {
    /// K.
    pub k: usize,
    /// Gaussian indices `[N, K]`.
    pub indices: Vec<u32>,
}

/// Gaussians that share one point, by ascending source index.
type Cluster = Vec<u32>;

impl Neighbors {
    /// Finds the exact K nearest of each mean. `order` `[N]` holds source indices, by which ties break.
    ///
    /// Equal points enter the k-d tree once, so that a scene with very many of them costs no more than another.
    ///
    /// # Panics
    /// When `order` is not as long as `means`, a mean is not finite, or k is 0.
    pub fn find(means: &[Vec3], order: &[u32], k: usize) -> Self {
        assert_eq!(means.len(), order.len(), "order [N]");
        let n_nearest = NonZero::new(k).expect("K is at least 1");
        let (points, clusters, cluster_from_gaussian) = cluster_equal_points(means, order);
        let search = Search { tree: tree(&points), points, clusters, order, n_nearest };
        let mut indices = vec![0; means.len() * k];
        indices.par_chunks_exact_mut(k).enumerate().for_each_init(Vec::new, |found, (i, row)| {
            search.nearest(cluster_from_gaussian[i] as usize, found);
            fill(row, i as u32, found);
        });
        Self { k, indices }
    }

    /// The lists cut to the nearest `k`.
    pub fn truncated(&self, k: usize) -> Self {
        let indices = self.indices.chunks_exact(self.k).flat_map(|row| &row[..k.min(self.k)]).copied();
        Self { k: k.min(self.k), indices: indices.collect() }
    }
}

/// Self first, then what was found, then self again where too few were.
fn fill(row: &mut [u32], own: u32, found: &[(f64, u32, u32)]) {
    let others = found.iter().map(|&(_, _, gaussian)| gaussian).filter(|&gaussian| gaussian != own);
    let list = std::iter::once(own).chain(others).chain(std::iter::repeat(own));
    for (slot, gaussian) in row.iter_mut().zip(list) {
        *slot = gaussian;
    }
}

fn tree(points: &[[f64; 3]]) -> Option<ImmutableKdTree<f64, 3>> {
    if points.is_empty() { None } else { ImmutableKdTree::new_from_slice(points).ok() }
}

fn cluster_equal_points(means: &[Vec3], order: &[u32]) -> (Vec<[f64; 3]>, Vec<Cluster>, Vec<u32>) {
    // Adding zero turns -0 into 0, which is the same point.
    let key = |i: u32| (means[i as usize] + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut by_point: Vec<u32> = (0..means.len() as u32).collect();
    by_point.par_sort_unstable_by_key(|&i| (key(i), order[i as usize]));
    let (mut points, mut clusters) = (Vec::new(), Vec::<Cluster>::new());
    let mut cluster_from_gaussian = vec![0; means.len()];
    for (position, &i) in by_point.iter().enumerate() {
        if position == 0 || key(by_point[position - 1]) != key(i) {
            points.push(means[i as usize].to_array().map(f64::from));
            clusters.push(Vec::new());
        }
        let cluster = clusters.len() - 1;
        clusters[cluster].push(i);
        cluster_from_gaussian[i as usize] = cluster as u32;
    }
    (points, clusters, cluster_from_gaussian)
}

struct Search<'a> {
    tree: Option<ImmutableKdTree<f64, 3>>,
    points: Vec<[f64; 3]>,
    clusters: Vec<Cluster>,
    order: &'a [u32],
    n_nearest: NonZero<usize>,
}

impl Search<'_> {
    /// The nearest K + 1 Gaussians of a point as (squared distance, source index, Gaussian), sorted: one of them may
    /// be the asking Gaussian itself, which its list names first whatever the ties.
    fn nearest(&self, cluster: usize, found: &mut Vec<(f64, u32, u32)>) {
        found.clear();
        let Some(tree) = &self.tree else { return };
        let (query, wanted) = (&self.points[cluster], self.n_nearest.saturating_add(1));
        let nearest = tree.query(query).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
        let full = nearest.len() == wanted.get() && self.points.len() > wanted.get();
        let radius = nearest.last().map_or(0.0, |item| item.distance);
        let tied = full && nearest.iter().rev().nth(1).is_some_and(|item| item.distance == radius);
        let mut add = |distance: f64, cluster: usize| {
            let members = self.clusters[cluster].iter().take(wanted.get());
            found.extend(members.map(|&i| (distance, self.order[i as usize], i)));
        };
        if tied {
            // Which of the points at the last distance came back is the tree's whim: ask for all of them.
            let within = tree.query(query).within::<SquaredEuclidean<f64>>(radius).execute();
            within.iter().for_each(|item| add(item.distance, item.item as usize));
        } else {
            nearest.iter().for_each(|item| add(item.distance, item.item as usize));
        }
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.truncate(wanted.get());
    }
}
