//! Cutting a block into the cells of nodes.

use glam::Vec3;

/// Gaussians below which a cell is not cut for its size: a node of fewer is not worth a choice of its own.
const LEAST: usize = 256;

/// A box that grows: the smallest and the largest corner of nothing.
const EMPTY: [Vec3; 2] = [Vec3::INFINITY, Vec3::NEG_INFINITY];

/// Indices of the means in each cell, halved at the median of the longest side until each has `most` at most,
/// and until each is `cell` wide at most, if that is given. Cells that are near one another follow one another.
pub(super) fn cells(means: &[Vec3], most: usize, cell: Option<f32>) -> Vec<Vec<u32>> {
    let mut cells = Vec::new();
    let mut indices: Vec<u32> = (0..means.len() as u32).collect();
    halve(means, &mut indices, most, cell, &mut cells);
    cells
}

fn halve(means: &[Vec3], indices: &mut [u32], most: usize, cell: Option<f32>, cells: &mut Vec<Vec<u32>>) {
    if indices.is_empty() {
        return;
    }
    let [low, high] = indices.iter().fold(EMPTY, |[low, high], &i| {
        let mean = means[i as usize];
        [low.min(mean), high.max(mean)]
    });
    let sides = high - low;
    let is_wide = cell.is_some_and(|cell| sides.max_element() > cell) && indices.len() >= 2 * LEAST;
    if indices.len() <= most && !is_wide {
        // The halves are sets that do not depend on how they were searched for, and so are the cells.
        indices.sort_unstable();
        cells.push(indices.to_vec());
        return;
    }
    let axis = sides.max_position();
    let middle = indices.len() / 2;
    // Ties go by the order of the source.
    let along = |i: &u32| means[*i as usize][axis];
    indices.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
    let (first, second) = indices.split_at_mut(middle);
    halve(means, first, most, cell, cells);
    halve(means, second, most, cell, cells);
}
