//! The numeric core on views small enough to work out by hand or densely.

use glam::{UVec2, Vec3};
use stylegaussian::{Neighbors, random::Random, splat::BlendWeights};
use stylegaussian_encoder::FeatureMap;

use super::{
    closed_form::closed_form,
    model::Model,
    refine::{Schedule, refine},
    samples::Samples,
    under_observed::{fill_in, seen_weights},
};

/// A picture whose pixels have the given (Gaussian, weight) lists.
fn weights(size: [u32; 2], n_gaussians: usize, pixels: &[&[(u32, f32)]]) -> BlendWeights {
    let mut out = BlendWeights {
        size: UVec2::from(size),
        n_gaussians,
        starts: vec![0],
        indices: Vec::new(),
        weights: Vec::new(),
    };
    for pixel in pixels {
        out.indices.extend(pixel.iter().map(|entry| entry.0));
        out.weights.extend(pixel.iter().map(|entry| entry.1));
        out.starts.push(out.indices.len() as u32);
    }
    out
}

fn features([width, height]: [u32; 2], n_channels: usize, values: Vec<f32>) -> FeatureMap {
    FeatureMap { width, height, n_channels, values }
}

/// A view of 12x6 cells of one pixel each, with three random Gaussians in most, and the features of `truth`
/// under it times `contrast`. Every fifth cell is bare, with features of `bare`.
fn random_view(n_gaussians: usize, truth: &Model, contrast: f32, bare: f32, seed: u64) -> Vec<Samples> {
    let mut random = Random::new(seed);
    let size = [12, 6];
    let (mut pixels, mut values) = (Vec::new(), Vec::new());
    // 12 * 6 cells. Weights of 0.05 to 0.33 keep the sum of three below 1.
    for cell in 0..72 {
        let mut pixel: Vec<(u32, f32)> = Vec::new();
        if cell % 5 != 0 {
            for _ in 0..3 {
                pixel.push(((random.uniform() * n_gaussians as f32) as u32, 0.05 + 0.28 * random.uniform()));
            }
        }
        let coverage: f32 = pixel.iter().map(|entry| entry.1).sum();
        for d in 0..truth.n_channels() {
            let f = |p: u32| truth.offset[d] + contrast * dot_row(truth, d, p as usize);
            let sum: f32 = pixel.iter().map(|&(p, w)| w * f(p)).sum();
            values.push(if coverage > 0.0 { sum / coverage } else { bare });
        }
        pixels.push(pixel);
    }
    let pixels: Vec<&[(u32, f32)]> = pixels.iter().map(Vec::as_slice).collect();
    Samples::of_view(&weights(size, n_gaussians, &pixels), &features(size, truth.n_channels(), values))
        .unwrap()
}

fn dot_row(model: &Model, d: usize, p: usize) -> f32 {
    let row = &model.basis[d * model.n_latent..][..model.n_latent];
    row.iter().zip(&model.features[p * model.n_latent..]).map(|(a, f)| a * f).sum()
}

fn of_slices(views: &[Vec<Samples>]) -> Vec<&[Samples]> {
    views.iter().map(Vec::as_slice).collect()
}

fn all_finite(model: &Model) -> bool {
    [&model.features, &model.basis, &model.offset]
        .iter()
        .all(|values| values.iter().all(|value| value.is_finite()))
}

#[test]
fn cells_average_their_pixels() {
    // A 4x2 picture, two cells of 2x2. Gaussian 1 fills the left one's top row with 0.8 and 0.4: (0.8 + 0.4) /
    // 4 = 0.3. Gaussian 0 is in one pixel with 0.4: 0.1. The right cell has a single weight of 0.1, 0.025 on
    // average: dropped.
    let left: &[(u32, f32)] = &[(1, 0.8), (0, 0.4)];
    let picture = weights([4, 2], 2, &[left, &[(1, 0.4)], &[], &[(0, 0.1)], &[], &[], &[], &[]]);
    let parts = Samples::of_view(&picture, &features([2, 1], 1, vec![7.0, 9.0])).unwrap();
    assert_eq!(parts.len(), 1, "the right cell would be the second part");
    let part = &parts[0];
    assert_eq!(part.n_cells(), 1);
    assert!((part.coverage()[0] - 0.4).abs() < 1e-4, "{:?}", part.coverage());
    let mut rendered = Vec::new();
    part.render(&[10.0, 100.0], 1, 0..1, &mut rendered);
    assert!((rendered[0] - 31.0).abs() < 0.01, "0.1 * 10 + 0.3 * 100, found {rendered:?}");
    let mut target = Vec::new();
    part.targets(0..1, &mut target);
    assert_eq!(target, [7.0]);
    // The transpose: each Gaussian gathers its weight times the cell's value.
    let gathered: Vec<(usize, f32)> = part
        .seen_in_piece(0)
        .map(|(row, gaussian)| {
            let mut sum = [0.0];
            part.gather(row, &[2.0], &mut sum);
            (gaussian, (sum[0] * 1000.0).round())
        })
        .collect();
    assert_eq!(gathered, [(0, 200.0), (1, 600.0)]);
}

#[test]
fn an_odd_feature_map_is_an_error() {
    let picture = weights([3, 1], 1, &[&[], &[], &[]]);
    let error = Samples::of_view(&picture, &features([5, 1], 1, vec![0.0; 5])).unwrap_err();
    assert!(error.to_string().contains("5x1") && error.to_string().contains("3x1"), "{error}");
}

#[test]
fn gradients_match_finite_differences() {
    let truth = Model::noise(9, 5, 3, &mut Random::new(1));
    let view = random_view(9, &truth, 1.0, 0.0, 2);
    let part = &view[0];
    // Another model, so that no residual is near 0, where the L1 error bends.
    let model = Model::noise(9, 5, 3, &mut Random::new(77));
    let gradient = model.gradient(part, 1.0);
    let mut of_features = vec![0.0; model.features.len()];
    for (row, p) in part.seen_in_piece(0) {
        part.gather(row, &gradient.cells, &mut of_features[p * 3..][..3]);
    }
    // Small against the residuals, so that no sign changes, and large against the rounding of the loss.
    let h = 2e-3;
    let check = |name: &str, analytic: &[f32], values: fn(&mut Model) -> &mut Vec<f32>| {
        for (i, analytic) in analytic.iter().enumerate() {
            let loss = |step: f32| {
                let mut moved = model.clone();
                values(&mut moved)[i] += step;
                moved.gradient(part, 1.0).loss
            };
            let numeric = (loss(h) - loss(-h)) / f64::from(2.0 * h);
            assert!(
                (numeric - f64::from(*analytic)).abs() < 2e-2,
                "{name}[{i}]: {analytic}, numeric {numeric}"
            );
        }
    };
    check("features", &of_features, |model| &mut model.features);
    check("basis", &gradient.basis, |model| &mut model.basis);
    check("offset", &gradient.offset, |model| &mut model.offset);
}

#[test]
fn lifting_is_the_weighted_mean() {
    // One channel. Gaussian 0 is seen as 1 with weight 0.5 and as 4 with weight 0.25: (0.5 + 1) / 0.75 = 2.
    // Gaussian 1 is seen as 4 with weight 0.75; Gaussian 2 never.
    let picture = weights([2, 1], 3, &[&[(0, 0.5)], &[(0, 0.25), (1, 0.75)]]);
    let view = Samples::of_view(&picture, &features([2, 1], 1, vec![1.0, 4.0])).unwrap();
    let model = closed_form(&[&view], 1, 3, 32);
    assert_eq!(model.n_latent, 1, "no more channels than the encoder has");
    let feature = |p: usize| model.offset[0] + dot_row(&model, 0, p);
    // The PCA looks at the first part alone, whose only cell has no variance: then A = 0 and f = b = the mean.
    assert!((feature(0) - 1.0).abs() < 1e-3);
    let both: Vec<Samples> = [[0, 0], [0, 1], [0, 2]]
        .iter()
        .flat_map(|_| {
            let rows: [&[(u32, f32)]; 6] = [&[(0, 0.5)], &[], &[(0, 0.25), (1, 0.75)], &[], &[], &[]];
            let values = vec![1.0, 0.0, 4.0, 0.0, 0.0, 0.0];
            Samples::of_view(&weights([6, 1], 3, &rows), &features([6, 1], 1, values)).unwrap()
        })
        .collect();
    let model = closed_form(&[&both], 1, 3, 32);
    let feature = |p: usize| model.offset[0] + dot_row(&model, 0, p);
    assert!((feature(0) - 2.0).abs() < 1e-3, "{}", feature(0));
    assert!((feature(1) - 4.0).abs() < 1e-3, "{}", feature(1));
    assert!((feature(2) - model.offset[0]).abs() < 1e-6, "never seen: the mean");
}

#[test]
fn the_basis_holds_the_variance_of_low_rank_features() {
    // Features of rank 2 in 6 channels: with two channels, each Gaussian alone in its cells is reproduced.
    let truth = Model::noise(8, 6, 2, &mut Random::new(5));
    let pixels: Vec<Vec<(u32, f32)>> = (0..16).map(|cell| vec![(cell / 2, 1.0)]).collect();
    let rows: Vec<&[(u32, f32)]> = pixels.iter().map(Vec::as_slice).collect();
    let feature = |model: &Model, p: usize, d: usize| model.offset[d] + dot_row(model, d, p);
    let values =
        (0..16).flat_map(|cell| (0..6).map(move |d| (cell / 2, d))).map(|(p, d)| feature(&truth, p, d));
    let map = features([16, 1], 6, values.collect());
    let view = Samples::of_view(&weights([16, 1], 8, &rows), &map).unwrap();
    let model = closed_form(&[&view], 6, 8, 2);
    for (p, d) in (0..8).flat_map(|p| (0..6).map(move |d| (p, d))) {
        let (found, expected) = (feature(&model, p, d), feature(&truth, p, d));
        assert!((found - expected).abs() < 5e-3, "Gaussian {p} channel {d}: {found}, expected {expected}");
    }
}

#[test]
fn descent_with_a_fixed_map_finds_the_dense_solution() {
    // Targets that the model can reach exactly: the L1 minimum is 0, at the solution of the normal equations,
    // which are well conditioned as each of the 6 Gaussians is in about 30 of 58 * 3 cells' lists.
    let truth = Model::noise(6, 8, 2, &mut Random::new(8));
    let views: Vec<Vec<Samples>> = (0..3).map(|seed| random_view(6, &truth, 1.0, 0.0, 20 + seed)).collect();
    let mut model = Model { features: vec![0.0; 12], ..truth.clone() };
    let schedule = Schedule { iterations: 3000, feature_rate: 0.05, map_rate: 0.0, decay: true };
    refine(&mut model, &of_slices(&views), schedule, &mut Random::new(0), |_| true);
    for (found, expected) in model.features.iter().zip(&truth.features) {
        assert!((found - expected).abs() < 0.02, "{:?}, expected {:?}", model.features, truth.features);
    }
}

#[test]
fn descent_finds_the_median_and_not_the_mean() {
    // One Gaussian, one channel, seen as 1, 2 and 9 (in one part): the L1 error is least at 2; the mean is 4.
    let rows: [&[(u32, f32)]; 5] = [&[(0, 1.0)], &[], &[(0, 1.0)], &[], &[(0, 1.0)]];
    let map = features([5, 1], 1, vec![1.0, 0.0, 2.0, 0.0, 9.0]);
    let view = Samples::of_view(&weights([5, 1], 1, &rows), &map).unwrap();
    let mut model = closed_form(&[&view], 1, 1, 32);
    let feature = |model: &Model| model.offset[0] + dot_row(model, 0, 0);
    assert!((feature(&model) - 4.0).abs() < 1e-3);
    let batches: Vec<&[Samples]> = view.chunks(1).collect();
    // The rate that follows from A would mean nothing here: one Gaussian is its own mean, so f' is a rounding
    // error.
    let schedule = Schedule { map_rate: 0.05, ..Schedule::after_closed_form(1000, &model) };
    refine(&mut model, &batches, schedule, &mut Random::new(0), |_| true);
    assert!((feature(&model) - 2.0).abs() < 0.05, "{}", feature(&model));
}

#[test]
fn uncovered_cells_teach_nothing() {
    let truth = Model::noise(9, 5, 3, &mut Random::new(1));
    let embed = |bare: f32| {
        let view = random_view(9, &truth, 1.0, bare, 4);
        let mut model = closed_form(&[&view], 5, 9, 3);
        let schedule = Schedule::after_closed_form(50, &model);
        refine(&mut model, &[&view], schedule, &mut Random::new(0), |_| true);
        (model.features, model.basis, model.offset)
    };
    assert_eq!(embed(0.0), embed(1000.0));
}

#[test]
fn one_seed_gives_one_result_on_any_number_of_threads() {
    let truth = Model::noise(3000, 8, 4, &mut Random::new(3));
    let views: Vec<Vec<Samples>> = (0..4).map(|seed| random_view(3000, &truth, 1.0, 0.0, seed)).collect();
    let embed = |n_threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| {
            let mut model = closed_form(&of_slices(&views), 8, 3000, 4);
            let schedule = Schedule::after_closed_form(40, &model);
            refine(&mut model, &of_slices(&views), schedule, &mut Random::new(seed), |_| true);
            model.features
        })
    };
    assert_eq!(embed(1, 7), embed(3, 7));
    assert_ne!(embed(1, 7), embed(1, 8));
}

#[test]
fn stops_if_asked_to() {
    let truth = Model::noise(9, 5, 3, &mut Random::new(1));
    let view = random_view(9, &truth, 1.0, 0.0, 4);
    let mut model = truth.clone();
    let steps = refine(&mut model, &[&view], Schedule::optimize(100), &mut Random::new(0), |step| step < 7);
    assert_eq!(steps, 7);
}

#[test]
fn standardizing_keeps_what_is_rendered() {
    let mut model = Model::noise(50, 6, 4, &mut Random::new(2));
    model.features.chunks_exact_mut(4).for_each(|row| row[1] = 30.0 + 0.01 * row[1]);
    // A constant channel has no deviation to divide by.
    model.features.chunks_exact_mut(4).for_each(|row| row[2] = 5.0);
    let before = model.clone();
    model.standardize();
    for l in 0..4 {
        let channel: Vec<f32> = model.features.chunks_exact(4).map(|row| row[l]).collect();
        let mean = channel.iter().sum::<f32>() / 50.0;
        let variance = channel.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / 50.0;
        assert!(mean.abs() < 1e-3, "channel {l}: mean {mean}");
        let expected = if l == 2 { 0.0 } else { 1.0 };
        assert!((variance - expected).abs() < 1e-2, "channel {l}: variance {variance}");
    }
    for (p, d) in (0..50).flat_map(|p| (0..6).map(move |d| (p, d))) {
        let feature = |model: &Model| model.offset[d] + dot_row(model, d, p);
        assert!((feature(&model) - feature(&before)).abs() < 1e-3);
    }
}

#[test]
fn unseen_gaussians_take_features_from_neighbors() {
    // On a line at 0, 1, 2, 3; only the first is seen. Each knows itself and the nearest other.
    let means = [0.0, 1.0, 2.1, 3.3].map(|x| Vec3::new(x, 0.0, 0.0));
    let neighbors = Neighbors::find(&means, &[0, 1, 2, 3], 2);
    let view =
        Samples::of_view(&weights([1, 1], 4, &[&[(0, 1.0)]]), &features([1, 1], 1, vec![3.0])).unwrap();
    let seen = seen_weights(&[&view], 4);
    assert!((seen[0] - 1.0).abs() < 1e-3 && seen[1..] == [0.0; 3], "{seen:?}");
    let mut model =
        Model { features: vec![5.0, f32::MAX, 7.0, 8.0], basis: vec![1.0], offset: vec![0.0], n_latent: 1 };
    assert_eq!(fill_in(&mut model, &seen, &neighbors), 3);
    assert_eq!(model.features, [5.0; 4], "spread along the line");
}

#[test]
fn a_well_seen_gaussian_keeps_its_features() {
    // Two neighbors, seen by 10 cells and by 0.1: the first keeps 10 / 10.1, the second half, from those
    // before.
    let neighbors = Neighbors { k: 2, indices: vec![0, 1, 1, 0] };
    let mut model = Model { features: vec![1.0, 2.0], basis: vec![1.0], offset: vec![0.0], n_latent: 1 };
    assert_eq!(fill_in(&mut model, &[10.0, 0.1], &neighbors), 0);
    assert!((model.features[0] - (1.0 + 0.1 / 10.1)).abs() < 1e-5, "{:?}", model.features);
    assert!((model.features[1] - 1.5).abs() < 1e-5, "{:?}", model.features);
}

#[test]
fn one_gaussian_one_cell() {
    let view =
        Samples::of_view(&weights([1, 1], 1, &[&[(0, 0.9)]]), &features([1, 1], 3, vec![1.0, 2.0, 3.0]));
    let view = view.unwrap();
    let mut model = closed_form(&[&view], 3, 1, 32);
    let schedule = Schedule::after_closed_form(20, &model);
    refine(&mut model, &[&view], schedule, &mut Random::new(0), |_| true);
    let seen = seen_weights(&[&view], 1);
    fill_in(&mut model, &seen, &Neighbors::find(&[Vec3::ZERO], &[0], 16));
    model.standardize();
    assert!(all_finite(&model), "{model:?}");
    assert_eq!(model.features, [0.0; 3], "one Gaussian is its own mean");
    for (d, expected) in [1.0, 2.0, 3.0].into_iter().enumerate() {
        assert!((model.offset[d] - expected).abs() < 0.05, "{:?}", model.offset);
    }
}
