//! Curves that give pictures a painting's share of dark and bright.

/// Knots of a curve: quantiles at even steps.
const KNOTS: usize = 65;

/// Distribution of luminance: quantiles at even steps, and none if there are no values.
#[derive(Clone)]
pub(super) struct Tones(Vec<f32>);

/// A curve of luminance, from pictures to the painting.
pub(super) struct Curve<'a> {
    from: &'a [f32],
    to: &'a [f32],
}

impl Tones {
    /// The distribution of `values`.
    pub fn new(values: Vec<f32>) -> Self {
        Self(if values.is_empty() { values } else { quantiles(values) })
    }

    /// A mixture of distributions by weights, in steps of a sixty-fourth of the largest weight.
    pub fn mixed<'a>(parts: impl Iterator<Item = (&'a Self, f32)> + Clone) -> Self {
        let most = parts.clone().map(|(_, weight)| weight).fold(f32::MIN_POSITIVE, f32::max);
        // Knots at even steps stand for as many values each.
        let copies = |(tones, weight): (&Self, f32)| tones.0.repeat((64.0 * weight / most).round() as usize);
        Self::new(parts.flat_map(copies).collect())
    }
}

impl<'a> Curve<'a> {
    /// The curve by which values that are distributed as `from` become distributed as `to`. The identity if
    /// either is empty.
    pub fn new(from: &'a Tones, to: &'a Tones) -> Self {
        if from.0.is_empty() || to.0.is_empty() {
            return Self { from: &[], to: &[] };
        }
        Self { from: &from.0, to: &to.0 }
    }

    /// The luminance that `value` gets. Beyond the ends the curve goes on with slope 1.
    pub fn at(&self, value: f32) -> f32 {
        let (Some(first), Some(last)) = (self.from.first(), self.from.last()) else { return value };
        if value <= *first {
            return value - first + self.to[0];
        }
        if value >= *last {
            return value - last + self.to[KNOTS - 1];
        }
        let upper = self.from.partition_point(|knot| *knot <= value);
        let (a, b) = (self.from[upper - 1], self.from[upper]);
        let between = (value - a) / (b - a);
        self.to[upper - 1] + between * (self.to[upper] - self.to[upper - 1])
    }
}

/// The curve's knots on `values`, which must not be empty.
fn quantiles(mut values: Vec<f32>) -> Vec<f32> {
    let ranks: Vec<usize> = (0..KNOTS).map(|i| i * (values.len() - 1) / (KNOTS - 1)).collect();
    select(&mut values, 0, &ranks);
    ranks.into_iter().map(|rank| values[rank]).collect()
}

/// Puts the values of these `ranks`, which ascend, where sorting would put them. `values` are those from rank
/// `first` on.
fn select(values: &mut [f32], first: usize, ranks: &[usize]) {
    let Some(&middle) = ranks.get(ranks.len() / 2) else { return };
    let (below, _, above) = values.select_nth_unstable_by(middle - first, f32::total_cmp);
    let lower = ranks.partition_point(|rank| *rank < middle);
    let upper = ranks.partition_point(|rank| *rank <= middle);
    rayon::join(|| select(below, first, &ranks[..lower]), || select(above, middle + 1, &ranks[upper..]));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_sorted_values() {
        let mut random = crate::random::Random::new(3);
        for n in [1, 2, 64, 65, 1000] {
            let values: Vec<f32> = (0..n).map(|_| random.below(50) as f32).collect();
            let mut sorted = values.clone();
            sorted.sort_by(f32::total_cmp);
            let expected: Vec<f32> = (0..KNOTS).map(|i| sorted[i * (n - 1) / (KNOTS - 1)]).collect();
            assert_eq!(quantiles(values), expected);
        }
    }

    #[test]
    fn a_curve_moves_one_distribution_to_another() {
        let ramp = |n: usize| (0..n).map(move |i| i as f32 / (n - 1) as f32);
        let (from, to) =
            (Tones::new(ramp(1000).collect()), Tones::new(ramp(500).map(|x| 0.2 + 0.5 * x * x).collect()));
        let curve = Curve::new(&from, &to);
        for x in [0.1, 0.5, 0.9] {
            assert!((curve.at(x) - (0.2 + 0.5 * x * x)).abs() < 0.01);
        }
        assert!((curve.at(1.5) - 1.2).abs() < 0.01 && (curve.at(-0.5) + 0.3).abs() < 0.01);
        assert_eq!(Curve::new(&Tones::new(Vec::new()), &Tones::new(vec![0.5])).at(0.3), 0.3);
        // A single value on either side: no division by zero.
        assert!(Curve::new(&Tones::new(vec![0.5; 9]), &Tones::new(vec![0.7])).at(0.5).is_finite());
    }
}
