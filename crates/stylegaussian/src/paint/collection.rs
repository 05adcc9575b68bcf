//! Which painting of a collection each seed is painted from.

use super::{
    canvas::Canvas,
    places::{Hues, of_seeds, quality},
    surface::Surface,
};

/// Places of each painting that are compared with seeds, about. A sixteenth of all tells one painting from
/// another, so that sixteen paintings cost about as much as the search for places in one.
const SOME: usize = 256;

/// Cost of a seed with another painting than all of its neighbors, relative to that of a usual best match.
/// Where paintings differ, the best ones of their places differ by several times a usual match.
const ALONE: f32 = 2.0;

/// Rounds in which seeds choose again, after their neighbors did.
const ROUNDS: usize = 4;

/// The number of the painting of each seed `[M]`: the one that has a place like it, and if several have, the
/// one that its neighbors have. `fixed` seeds have theirs.
///
/// The colors of seeds are those of painting 0 in `hues`, which stands for all: what is blue in the scene must
/// not be made green before it is compared.
pub(super) fn choose(
    surface: &Surface,
    paintings: &[&Canvas],
    hues: &Hues,
    fixed: impl Iterator<Item = (u32, usize)>,
) -> Vec<u8> {
    let n_seeds = surface.n_seeds();
    if paintings.len() < 2 {
        return vec![0; n_seeds];
    }
    let mut given: Vec<Option<u8>> = vec![None; n_seeds];
    for (j, painting) in fixed {
        given[j as usize] = Some(painting as u8);
    }
    // Most small parts of a scene have no seeds of their own.
    if let Some(labels) = given.iter().copied().collect::<Option<Vec<u8>>>() {
        return labels;
    }
    let seeds: Vec<u32> = (0..n_seeds as u32).collect();
    let descriptors = of_seeds(surface, 0, &seeds, 0, hues);
    // The least cost of each seed in each painting.
    let of_painting = |canvas: &&Canvas| -> Vec<f32> {
        let some = some_places(canvas);
        let distances = descriptors.distances(&canvas.places[0].some(&some));
        let least = |row: &[f32]| row.iter().copied().fold(f32::INFINITY, f32::min);
        distances.chunks_exact(some.len()).map(least).collect()
    };
    let costs: Vec<Vec<f32>> = paintings.iter().map(of_painting).collect();
    let best = |j: usize| costs.iter().map(|costs| costs[j]).fold(f32::INFINITY, f32::min);
    let typical = ((0..n_seeds).map(best).sum::<f32>() / n_seeds.max(1) as f32).max(1e-6);
    // Places of single seeds are chance where paintings are alike, so a neighborhood chooses first.
    let costs: Vec<Vec<f32>> = costs.iter().map(|costs| averaged(surface, costs)).collect();
    let choose = |j: usize, apart: &dyn Fn(usize) -> f32| {
        let cost = |k: usize| costs[k][j] / typical + apart(k);
        (1..paintings.len()).fold(0, |best, k| if cost(k) < cost(best) { k } else { best }) as u8
    };
    let mut labels: Vec<u8> = (0..n_seeds).map(|j| given[j].unwrap_or_else(|| choose(j, &|_| 0.0))).collect();
    for _ in 0..ROUNDS {
        for &j in surface.seeds.order.iter().filter(|j| given[**j as usize].is_none()) {
            let around = &surface.seeds.around[j as usize];
            let others = |k: usize| {
                let n = around.iter().filter(|i| usize::from(labels[**i as usize]) != k).count();
                ALONE * n as f32 / around.len().max(1) as f32
            };
            labels[j as usize] = choose(j as usize, &others);
        }
    }
    labels
}

/// Means of the values of seeds `[M]` over each and its neighbors.
fn averaged(surface: &Surface, values: &[f32]) -> Vec<f32> {
    let mean = |j: usize| {
        let around = &surface.seeds.around[j];
        let sum: f32 = around.iter().map(|i| values[*i as usize]).sum();
        (values[j] + sum) / (around.len() + 1) as f32
    };
    (0..values.len()).map(mean).collect()
}

/// Some places of a painting, spread over it: good ones, if there are any.
fn some_places(canvas: &Canvas) -> Vec<u32> {
    let n_places = canvas.n_places.0 * canvas.n_places.1;
    // A place without strokes costs 1 more than a usual one.
    let among = |most: f32| -> Vec<u32> {
        (0..n_places as u32).filter(|place| quality(canvas, *place as usize) < most).collect()
    };
    let mut good = among(1.0);
    if good.is_empty() {
        good = among(f32::INFINITY);
    }
    // Odd, so that columns change from row to row.
    let stride = (good.len() / SOME).max(1) | 1;
    good.into_iter().step_by(stride).collect()
}
