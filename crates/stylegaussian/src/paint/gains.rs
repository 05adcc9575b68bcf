//! Factors of the parts of a painted scene, such that its pictures have as much detail of each size as the painting.

use super::bands::N_BANDS;

/// Price of a factor e times the usual one. The price of a band with e times too much energy is 1.
pub(super) const PRICE: f64 = 0.02;

/// Least share of a band in a painting's variance that is aimed at: below it, nobody sees a difference.
pub(super) const LEAST_SHARE: f64 = 1e-3;

/// Steps of the search, and the first ones' size in the logarithm of a factor. They are few numbers: it takes no time.
const STEPS: i32 = 250;
const STEP: f64 = 0.05;

/// One part of a painted scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    /// The factor without any measurement.
    pub usual: f64,
    /// The largest factor.
    pub most: f64,
    /// Price of a factor e times the usual one.
    pub price: f64,
}

/// Factors `[K]` of parts for which each band's share of the variance is near to `target`. `products` `[K, K]` are the
/// energies that pairs of parts give in each band.
pub(super) fn gains(products: &[Vec<f64>; N_BANDS], target: &[f64; N_BANDS], ranges: &[Range]) -> Vec<f64> {
    let target = target.map(|share| share.max(LEAST_SHARE).ln());
    let n = ranges.len();
    // In logarithms, by Adam's rule (Kingma and Ba, 2015): parts differ much in what they give.
    let (mut x, mut mean, mut square) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let factor = |x: f64, range: &Range| (range.usual * x.exp()).min(range.most);
    for step in 1..=STEPS {
        let g: Vec<f64> = x.iter().zip(ranges).map(|(x, range)| factor(*x, range)).collect();
        let slopes = slopes(products, &target, &g);
        for k in 0..n {
            // At its largest a factor no longer changes, unless it is to shrink.
            let is_held = g[k] >= ranges[k].most && slopes[k] < 0.0;
            let slope = if is_held { 0.0 } else { slopes[k] * g[k] } + 2.0 * ranges[k].price * x[k];
            mean[k] += 0.1 * (slope - mean[k]);
            square[k] += 0.01 * (slope * slope - square[k]);
            let (mean, square) =
                (mean[k] / (1.0 - 0.9_f64.powi(step)), square[k] / (1.0 - 0.99_f64.powi(step)));
            x[k] -= STEP * mean / (square.sqrt() + 1e-9);
        }
    }
    x.iter().zip(ranges).map(|(x, range)| factor(*x, range)).collect()
}

/// The derivatives by the factors `g` of the squared differences of the bands' shares from `target`, in logarithms.
fn slopes(products: &[Vec<f64>; N_BANDS], target: &[f64; N_BANDS], g: &[f64]) -> Vec<f64> {
    let n = g.len();
    let row = |band: usize, k: usize| -> f64 {
        products[band][k * n..(k + 1) * n].iter().zip(g).map(|(product, g)| product * g).sum()
    };
    let rows: Vec<Vec<f64>> = (0..N_BANDS).map(|band| (0..n).map(|k| row(band, k)).collect()).collect();
    let energy = |row: &Vec<f64>| row.iter().zip(g).map(|(row, g)| row * g).sum::<f64>().max(1e-12);
    let energies: Vec<f64> = rows.iter().map(energy).collect();
    let total: f64 = energies.iter().sum();
    let of_total = |k: usize| rows.iter().map(|row| 2.0 * row[k]).sum::<f64>() / total;
    let slope = |k: usize| {
        let bands = 0..N_BANDS;
        bands
            .map(|band| {
                let excess = (energies[band] / total).ln() - target[band];
                2.0 * excess * (2.0 * rows[band][k] / energies[band] - of_total(k))
            })
            .sum()
    };
    (0..n).map(slope).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: Range = Range { usual: 1.0, most: 10.0, price: PRICE };

    /// Parts that each give energy 1 in a band of their own.
    fn separate() -> [Vec<f64>; N_BANDS] {
        std::array::from_fn(|band| {
            (0..N_BANDS * N_BANDS).map(|i| f64::from(u8::from(i == band * (N_BANDS + 1)))).collect()
        })
    }

    #[test]
    fn separate_parts_reach_any_spectrum() {
        let target = [0.02, 0.02, 0.04, 0.08, 0.14, 0.7];
        let g = gains(&separate(), &target, &[RANGE; N_BANDS]);
        let total: f64 = g.iter().map(|g| g * g).sum();
        for (g, target) in g.iter().zip(target) {
            let share = g * g / total;
            assert!((share / target).ln().abs() < 0.3, "{share} for {target}");
        }
    }

    #[test]
    fn factors_stay_within_their_range() {
        let mut ranges = [RANGE; N_BANDS];
        ranges[0].most = 1.2;
        let g = gains(&separate(), &[0.95, 0.01, 0.01, 0.01, 0.01, 0.01], &ranges);
        assert!((g[0] - 1.2).abs() < 1e-9 && g[1..].iter().all(|g| *g > 0.0 && *g < 1.0), "{g:?}");
        // Nothing to measure: the usual factors.
        let nothing = std::array::from_fn(|_| vec![0.0; N_BANDS * N_BANDS]);
        assert!(gains(&nothing, &[0.1; N_BANDS], &[RANGE; N_BANDS]).iter().all(|g| (g - 1.0).abs() < 1e-6));
    }
}
