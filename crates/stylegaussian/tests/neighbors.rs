//! Neighbor lists against a search through all pairs.

use glam::Vec3;
use stylegaussian::Neighbors;

/// The lists by definition, in f64: itself first, then ascending distance, ties by source index, and itself
/// again if N < K.
fn all_pairs(means: &[Vec3], order: &[u32], k: usize) -> Vec<u32> {
    let list = |i: usize| {
        let mut others: Vec<usize> = (0..means.len()).filter(|&j| j != i).collect();
        let distance = |j: usize| (means[i].as_dvec3() - means[j].as_dvec3()).length_squared();
        others.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(order[a].cmp(&order[b])));
        let list = std::iter::once(i).chain(others).chain(std::iter::repeat(i));
        list.take(k).map(|j| j as u32).collect::<Vec<_>>()
    };
    (0..means.len()).flat_map(list).collect()
}

fn check(means: &[Vec3], k: usize, what: &str) {
    let n = means.len() as u32;
    // Source indices in another order than memory. 7 is coprime to every n used here.
    let order: Vec<u32> = (0..n).map(|i| (i * 7 + 3) % n.max(1)).collect();
    assert_eq!(Neighbors::find(means, &order, k).indices, all_pairs(means, &order, k), "{what}");
}

#[test]
fn equals_all_pairs() {
    let scattered = |i: u32| {
        let hash = |salt: u32| ((i + salt).wrapping_mul(2_654_435_761) >> 8) as f32 / 1e6;
        Vec3::new(hash(0), hash(77), hash(991))
    };
    check(&(0..500).map(scattered).collect::<Vec<_>>(), 8, "scattered");
    check(
        &(0..500).map(|i| Vec3::new((i % 20) as f32, (i / 20) as f32, 0.0)).collect::<Vec<_>>(),
        8,
        "lattice",
    );
    check(&(0..500).map(|i| Vec3::splat((i % 5) as f32)).collect::<Vec<_>>(), 8, "duplicates");
    check(&vec![Vec3::ONE; 300], 8, "one point");
    check(&[Vec3::new(0.0, -0.0, 1.0), Vec3::new(-0.0, 0.0, 1.0), Vec3::X], 2, "signed zeros");
    for n in [0, 1, 3, 8, 9] {
        check(&(0..n).map(scattered).collect::<Vec<_>>(), 8, "few");
    }
    check(&(0..50).map(scattered).collect::<Vec<_>>(), 1, "K = 1");
}

#[test]
fn many_equal_points_are_not_slow() {
    let n = 100_000;
    let neighbors = Neighbors::find(&vec![Vec3::ZERO; n], &(0..n as u32).collect::<Vec<_>>(), 8);
    assert_eq!(neighbors.indices[8 * 50_000..][..8], [50_000, 0, 1, 2, 3, 4, 5, 6]);
}
