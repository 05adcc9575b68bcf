//! Noise that belongs to a Gaussian: the same in every run, on every machine, and whatever order a file has.
//!
//! Features are smooth where a scene is plain, and a decoder can only paint what its inputs tell apart. [`noise`] tells
//! every Gaussian from its neighbors: grain, which views show each in their own way, because a pixel blends many.
//! [`Waves`] tell places apart: strokes, as wide as the waves are long, on which all views agree.

use std::f32::consts::TAU;

use glam::Vec3;

/// What a decoder's noise is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum NoiseKind {
    /// A number for each Gaussian that its neighbors know nothing of: [`noise`].
    #[default]
    White,
    /// Numbers that change smoothly over the scene, each channel twice as fast as the one before: [`Waves`].
    Waves,
}

impl NoiseKind {
    /// `white` or `waves`.
    pub fn name(self) -> &'static str {
        match self {
            Self::White => "white",
            Self::Waves => "waves",
        }
    }
}

impl std::str::FromStr for NoiseKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let kinds = [Self::White, Self::Waves];
        let kind = kinds.into_iter().find(|kind| kind.name() == text);
        kind.ok_or_else(|| format!("`{text}`: expected `white` or `waves`"))
    }
}

/// Plane waves in a channel of [`Waves`]: enough that their sum shows no stripes.
const N_WAVES: u32 = 12;

/// Smooth noise over a scene: in each channel the sum of a dozen plane waves of random directions, phases and lengths
/// within an octave, with mean 0 and deviation 1.
///
/// Channel c's waves are about radius / 2^(c + 1) long, where the *radius* is the median distance of the Gaussians from
/// their median: half of the scene, which a camera that looks at it from around shows some 30 pixels wide per 256, so
/// that four channels span strokes of about 15 to 2 pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Waves {
    center: Vec3,
    radius: f32,
    /// For each channel the waves' vectors, in radians per radius, and phases, in radians.
    channels: Vec<[(Vec3, f32); N_WAVES as usize]>,
}

impl Waves {
    /// Channels 0 to `n_channels` over a scene with these means.
    pub fn new(means: &[Vec3], n_channels: usize) -> Self {
        let center = Vec3::from_array([0, 1, 2].map(|axis| median(means.iter().map(|mean| mean[axis]))));
        let radius = median(means.iter().map(|mean| mean.distance(center))).max(f32::MIN_POSITIVE);
        let wave = |channel: u32, wave: usize| {
            // Uniform in 0..1, four for each wave of each channel.
            let random = |which: u32| 0.5 + noise(4 * wave as u32 + which, channel) / (2.0 * 3.0_f32.sqrt());
            let (azimuth, height) = (TAU * random(0), 2.0 * random(1) - 1.0);
            let across = (1.0 - height * height).max(0.0).sqrt();
            let direction = Vec3::new(across * azimuth.cos(), across * azimuth.sin(), height);
            // From 2^-1/2 to 2^1/2 of the channel's.
            let waves_per_radius = (channel as f32 + 0.5 + random(2)).exp2();
            (TAU * waves_per_radius * direction, TAU * random(3))
        };
        let channel = |channel: u32| std::array::from_fn(|i| wave(channel, i));
        Self { center, radius, channels: (0..n_channels as u32).map(channel).collect() }
    }

    /// Every channel at a place in the scene.
    pub fn at(&self, position: Vec3) -> impl Iterator<Item = f32> {
        let place = (position - self.center) / self.radius;
        // A wave's mean square is a half.
        let scale = (2.0 / N_WAVES as f32).sqrt();
        self.channels.iter().map(move |waves| {
            scale * waves.iter().map(|(vector, phase)| (vector.dot(place) + phase).cos()).sum::<f32>()
        })
    }
}

/// The middle of some numbers; 0 of none.
fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Channel `channel` of the noise of the Gaussian with index `source_index` in its source file: uniform between -sqrt(3)
/// and sqrt(3), so that its deviation is 1. A hash (the finalizer of MurmurHash3 by Appleby, over both numbers), so that
/// nothing needs to be stored.
pub fn noise(source_index: u32, channel: u32) -> f32 {
    // 2^32 divided by the golden ratio, odd: neighboring channels start far apart.
    let mut h = source_index.wrapping_add(channel.wrapping_add(1).wrapping_mul(0x9E37_79B9));
    h = (h ^ (h >> 16)).wrapping_mul(0x85EB_CA6B);
    h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
    h ^= h >> 16;
    // The upper 24 bits, each value in the middle of its step.
    let unit = ((h >> 8) as f32 + 0.5) / (1_u32 << 24) as f32;
    (2.0 * unit - 1.0) * 3.0_f32.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_white() {
        let n = 20_000;
        let channel = |c: u32| (0..n).map(move |i| f64::from(noise(i, c)));
        for c in 0..4 {
            let mean = channel(c).sum::<f64>() / f64::from(n);
            let variance = channel(c).map(|v| v * v).sum::<f64>() / f64::from(n);
            assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.03, "channel {c}: {mean}, {variance}");
            let next: f64 = channel(c).zip(channel(c).skip(1)).map(|(a, b)| a * b).sum();
            let across: f64 = channel(c).zip(channel(c + 1)).map(|(a, b)| a * b).sum();
            assert!((next / f64::from(n)).abs() < 0.03, "neighbors in channel {c} are correlated");
            assert!((across / f64::from(n)).abs() < 0.03, "channels {c} and {} are correlated", c + 1);
        }
    }

    #[test]
    fn waves_have_deviation_one_and_their_length() {
        // A ball of radius 1: the median distance from its middle is 0.5^(1/3).
        let n = 40_000;
        let unit = |i: u32, c: u32| noise(i, c) / 3.0_f32.sqrt();
        let ball = (0..n).map(|i| Vec3::new(unit(i, 0), unit(i, 1), unit(i, 2)));
        let ball: Vec<Vec3> = ball.filter(|place| place.length() < 1.0).collect();
        let waves = Waves::new(&ball, 4);
        let at = |place: Vec3, channel: usize| waves.at(place).nth(channel).unwrap_or(f32::NAN);
        assert!(waves.center.length() < 0.02 && (waves.radius - 0.5_f32.cbrt()).abs() < 0.02);
        for channel in 0..4 {
            let values: Vec<f32> = ball.iter().map(|place| at(*place, channel)).collect();
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / values.len() as f32;
            // The longest waves do not fit the ball often enough for more.
            assert!(
                mean.abs() < 0.2 && (0.6..1.4).contains(&variance),
                "channel {channel}: {mean}, {variance}"
            );
            // Near is alike, half a wave away is not.
            let correlation = |step: f32| {
                let pairs = ball.iter().zip(&values).map(|(place, value)| {
                    (at(*place + Vec3::splat(step / 3.0_f32.sqrt()), channel) - mean) * (value - mean)
                });
                pairs.sum::<f32>() / (values.len() as f32 * variance)
            };
            let length = waves.radius / (channel as f32 + 1.0).exp2();
            assert!(correlation(0.05 * length) > 0.9, "channel {channel}: {}", correlation(0.05 * length));
            assert!(correlation(0.5 * length) < 0.3, "channel {channel}: {}", correlation(0.5 * length));
        }
    }

    #[test]
    fn waves_of_no_or_one_gaussian_are_finite() {
        assert!(Waves::new(&[], 2).at(Vec3::ONE).all(f32::is_finite));
        let place = Vec3::new(1e6, -3.0, 0.5);
        assert!(Waves::new(&[place], 4).at(place).all(f32::is_finite));
    }

    /// Decoders are trained on it. The numbers were worked out with integers of any size.
    #[test]
    fn noise_never_changes() {
        let known = [
            (0, 0, 0.254_256_767_6),
            (1, 0, 0.306_205_027_8),
            (0, 1, -0.908_793_407_0),
            (123_456, 3, 0.272_454_784_5),
        ];
        for (source_index, channel, expected) in known {
            assert!(
                (f64::from(noise(source_index, channel)) - expected).abs() < 1e-6,
                "{source_index}, {channel}"
            );
        }
    }
}
