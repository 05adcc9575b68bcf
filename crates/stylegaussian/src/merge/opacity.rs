//! Opacity and optical depth of a Gaussian.
//!
//! A Gaussian of opacity o lets the share 1 - o g of the light pass, where g is its falloff, and so has an
//! optical depth of -ln(1 - o g) there. Its integral over the picture is 2 pi Li2(o) times the Gaussian's area
//! (product of its deviations), where Li2 is the dilogarithm. Depths of Gaussians before one another add up,
//! which their alphas do not.

use std::f64::consts::PI;

/// Li2(1): the depth of an opaque Gaussian.
const MOST: f64 = PI * PI / 6.0;

/// Halvings in which an opacity is found: one more than an `f32` has bits.
const HALVINGS: u32 = 25;

/// Li2(x), the sum of x^k / k^2 over k from 1 on, for x of 0..1.
pub(super) fn depth(x: f64) -> f64 {
    if x <= 0.0 {
        0.0
    } else if x >= 1.0 {
        MOST
    } else if x > 0.5 {
        // Euler's reflection. The series is slow near 1.
        MOST - x.ln() * (-x).ln_1p() - depth(1.0 - x)
    } else {
        let (mut sum, mut power, mut k) = (0.0, x, 1.0);
        while power > f64::EPSILON * x {
            sum += power / (k * k);
            (power, k) = (power * x, k + 1.0);
        }
        sum
    }
}

/// The opacity that has a depth: its inverse, and 1 beyond an opaque Gaussian's.
pub(super) fn opacity(of: f64) -> f64 {
    if of >= MOST {
        return 1.0;
    }
    // Li2(x) is x to 2 x at most, so a small depth keeps its digits.
    let (mut low, mut high) = (of / MOST, of.clamp(0.0, 1.0));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if depth(middle) < of {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_those_of_the_integral() {
        // Known values: Li2(1/2) = pi^2 / 12 - ln(2)^2 / 2.
        assert!((depth(0.5) - (PI * PI / 12.0 - 0.5 * 2_f64.ln().powi(2))).abs() < 1e-14);
        assert_eq!((depth(0.0), depth(1.0)), (0.0, MOST));
        // The integral of -ln(1 - o exp(-r^2 / 2)) r dr, by 40,000 steps.
        for o in [0.01, 0.3, 0.5, 0.51, 0.9, 0.999] {
            let step = 8.0 / 40_000.0;
            let at = |r: f64| -(-o * (-0.5 * r * r).exp()).ln_1p() * r * step;
            let sum: f64 = (0..40_000).map(|i| at((f64::from(i) + 0.5) * step)).sum();
            assert!((depth(o) - sum).abs() < 1e-6, "{o}: {} and {sum}", depth(o));
        }
    }

    #[test]
    fn opacities_are_the_inverse() {
        for o in [0.0, 1e-9, 0.004, 0.2, 0.5, 0.7, 0.99, 1.0] {
            let found = opacity(depth(o));
            assert!((found - o).abs() <= 1e-7 * o.max(1e-30), "{o}: {found}");
        }
        assert_eq!((opacity(2.0), opacity(f64::INFINITY)), (1.0, 1.0));
    }
}
