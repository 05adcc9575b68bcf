//! Noise that belongs to a Gaussian: the same in every run, on every machine, and in every order of the file.

/// Channel `channel` of the noise of the Gaussian with index `source_index` in its source file.
///
/// Uniform between -sqrt(3) and sqrt(3), so that the standard deviation is 1. It is a hash of both numbers (the
/// finalizer of MurmurHash3 by Appleby), so nothing needs to be stored.
pub fn noise(source_index: u32, channel: u32) -> f32 {
    // 0x9E3779B9 is 2^32 divided by the golden ratio, and odd. Multiples of it lie far apart, so channels of
    // one Gaussian do not meet those of its neighbors in the file.
    let mut h = source_index.wrapping_add(channel.wrapping_add(1).wrapping_mul(0x9E37_79B9));
    h = (h ^ (h >> 16)).wrapping_mul(0x85EB_CA6B);
    h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
    h ^= h >> 16;
    // The upper 24 bits, which f32 holds exactly, each value in the middle of its step so that the mean is 0.
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
            // The standard error of these means is about 1 / sqrt(20,000) = 0.007, a quarter of the bound.
            assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.03, "channel {c}: {mean}, {variance}");
            let next: f64 = channel(c).zip(channel(c).skip(1)).map(|(a, b)| a * b).sum();
            let across: f64 = channel(c).zip(channel(c + 1)).map(|(a, b)| a * b).sum();
            assert!((next / f64::from(n)).abs() < 0.03, "neighbors in channel {c} are correlated");
            assert!((across / f64::from(n)).abs() < 0.03, "channels {c} and {} are correlated", c + 1);
        }
    }

    /// Decoders are trained on this noise, so it may never change. The expected numbers come from an
    /// implementation with integers of unlimited size.
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
