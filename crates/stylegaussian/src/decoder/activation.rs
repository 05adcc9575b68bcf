//! The activation between the decoder's layers.

use std::{fmt, str::FromStr};

/// The activation between layers. There is none after the last.
///
/// Its text form, in files and on the command line, is `sigmoid` or `leaky_relu:SLOPE`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Activation {
    /// 1 / (1 + exp(-x)), the paper's.
    Sigmoid,
    /// x for x > 0, slope * x otherwise.
    LeakyRelu {
        /// The slope for negative inputs, 0..1.
        slope: f32,
    },
}

impl Activation {
    /// Applies the activation in place.
    pub fn apply(self, values: &mut [f32]) {
        match self {
            Self::Sigmoid => values.iter_mut().for_each(|x| *x = sigmoid(*x)),
            Self::LeakyRelu { slope } => {
                values.iter_mut().for_each(|x| *x = if *x > 0.0 { *x } else { slope * *x })
            }
        }
    }

    /// The activation of one value by its definition, in f64, for comparisons with [`apply`](Self::apply).
    pub fn evaluate(self, x: f64) -> f64 {
        match self {
            Self::Sigmoid => 1.0 / (1.0 + (-x).exp()),
            Self::LeakyRelu { slope } => {
                if x > 0.0 {
                    x
                } else {
                    f64::from(slope) * x
                }
            }
        }
    }
}

/// 1 / (1 + 2^t) with t = -x / ln 2, within 2e-7.
///
/// It has neither a branch nor a call, so the compiler vectorizes it. 2^t is 2^i 2^f with i = round(t) and |f|
/// <= 1/2. 2^f is the Taylor series of exp(f ln 2) to the sixth order, with a remainder of (0.3466)^7 / 7! =
/// 1.2e-7.
fn sigmoid(x: f32) -> f32 {
    // 1.5 * 2^23. From 2^23 to 2^24 an f32 has no bits below 1, so adding this rounds t to an integer, which
    // then stands in the low bits of the sum. Starting at the middle of that range leaves room for negative
    // integers.
    const ROUND: f32 = 12_582_912.0;
    // Within these bounds the exponent field below neither overflows nor reaches 0. Beyond them the sigmoid is
    // 0 or 1 within 2^-125.
    let t = (x * -std::f32::consts::LOG2_E).clamp(-125.0, 125.0);
    let shifted = t + ROUND;
    let y = (t - (shifted - ROUND)) * std::f32::consts::LN_2;
    let series = 1.0
        + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y * (1.0 / 120.0 + y * (1.0 / 720.0))))));
    // 2^i: i plus the bias of 127, in the exponent's place. NaN passes through `series`.
    let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    1.0 / (1.0 + series * f32::from_bits(exponent))
}

/// The text form, which [`FromStr`] parses.
impl fmt::Display for Activation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sigmoid => f.write_str("sigmoid"),
            Self::LeakyRelu { slope } => write!(f, "leaky_relu:{slope}"),
        }
    }
}

/// A text that names no activation.
#[derive(Debug, thiserror::Error)]
#[error("activation `{found}`: expected `sigmoid` or `leaky_relu:SLOPE` with a slope from 0 to 1")]
pub struct ActivationError {
    found: String,
}

impl FromStr for Activation {
    type Err = ActivationError;

    fn from_str(text: &str) -> Result<Self, ActivationError> {
        let slope =
            // `nan` parses as a number. No range contains it.
            || text.strip_prefix("leaky_relu:")?.parse().ok().filter(|slope| (0.0..=1.0).contains(slope));
        match text {
            "sigmoid" => Ok(Self::Sigmoid),
            _ => slope()
                .map(|slope| Self::LeakyRelu { slope })
                .ok_or_else(|| ActivationError { found: text.into() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sigmoid_matches_f64_over_its_range() {
        // Up to |x| = 200, beyond the clamp of t at |x| = 125 ln 2 = 86.6.
        for i in -20_000..=20_000 {
            let x = i as f32 / 100.0;
            let expected = Activation::Sigmoid.evaluate(f64::from(x));
            assert!((f64::from(sigmoid(x)) - expected).abs() < 2e-7, "sigmoid({x})");
        }
        assert!(sigmoid(f32::NAN).is_nan());
    }

    #[test]
    fn names_round_trip_and_unknown_ones_are_errors() {
        // Files hold these texts.
        assert_eq!(Activation::Sigmoid.to_string(), "sigmoid");
        assert_eq!(Activation::LeakyRelu { slope: 0.2 }.to_string(), "leaky_relu:0.2");
        for activation in [Activation::Sigmoid, Activation::LeakyRelu { slope: 0.1 }] {
            assert_eq!(activation.to_string().parse::<Activation>().unwrap(), activation);
        }
        for text in ["relu", "leaky_relu:", "leaky_relu:2", "leaky_relu:nan", ""] {
            assert!(text.parse::<Activation>().is_err(), "{text}");
        }
    }
}
