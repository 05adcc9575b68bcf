//! Curves that give pictures a painting's share of dark and bright.

/// Knots of a curve: quantiles at even steps.
const KNOTS: usize = 65;

/// A curve of luminance, from pictures to the painting.
pub(super) struct Curve {
    from: Vec<f32>,
    to: Vec<f32>,
}

impl Curve {
    /// The curve by which values that are distributed as `from` become distributed as `to`. The identity if either is
    /// empty.
    pub fn new(from: Vec<f32>, to: Vec<f32>) -> Self {
        if from.is_empty() || to.is_empty() {
            return Self { from: Vec::new(), to: Vec::new() };
        }
        Self { from: quantiles(from), to: quantiles(to) }
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

fn quantiles(mut values: Vec<f32>) -> Vec<f32> {
    values.sort_unstable_by(f32::total_cmp);
    (0..KNOTS).map(|i| values[i * (values.len() - 1) / (KNOTS - 1)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_moves_one_distribution_to_another() {
        let ramp = |n: usize| (0..n).map(move |i| i as f32 / (n - 1) as f32);
        let curve = Curve::new(ramp(1000).collect(), ramp(500).map(|x| 0.2 + 0.5 * x * x).collect());
        for x in [0.1, 0.5, 0.9] {
            assert!((curve.at(x) - (0.2 + 0.5 * x * x)).abs() < 0.01);
        }
        assert!((curve.at(1.5) - 1.2).abs() < 0.01 && (curve.at(-0.5) + 0.3).abs() < 0.01);
        assert_eq!(Curve::new(Vec::new(), vec![0.5]).at(0.3), 0.3);
        // A single value on either side: no division by zero.
        assert!(Curve::new(vec![0.5; 9], vec![0.7]).at(0.5).is_finite());
    }
}
