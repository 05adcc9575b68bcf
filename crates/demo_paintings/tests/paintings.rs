//! The paintings are the same everywhere, the right size, and far from each other in color.

use std::sync::LazyLock;

use demo_paintings::{PAINTINGS, SIZE};

/// Pixels of each painting, 8-bit RGB, painted once for all tests.
static PIXELS: LazyLock<Vec<Vec<u8>>> =
    LazyLock::new(|| PAINTINGS.iter().map(|painting| (painting.paint)().to_rgb()).collect());

/// FNV-1a of each painting's pixels, in the order of `PAINTINGS`. Only a change of a painting may change its
/// line. If anything else does, determinism is lost.
const HASHES: [u64; 8] = [
    0x1006_e647_a7a5_d5ab,
    0xe165_ceac_9c80_eea8,
    0x8db4_fa73_ffb8_aaf0,
    0x4369_8665_c1dc_8613,
    0x054f_977f_92da_5ca1,
    0x9fe5_4f0b_9f32_2468,
    0x8f70_0fa9_a78f_2e5b,
    0x6f55_ff8b_a060_f817,
];

/// FNV-1a, 64 bits.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, &b| (h ^ b as u64).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Mean `[3]` and covariance `[3, 3]` of the colors, in 0..1.
fn color_statistics(pixels: &[u8]) -> ([f64; 3], [[f64; 3]; 3]) {
    let n = (pixels.len() / 3) as f64;
    let (mut sum, mut products) = ([0.0; 3], [[0.0; 3]; 3]);
    for pixel in pixels.chunks_exact(3) {
        let c: [f64; 3] = std::array::from_fn(|i| pixel[i] as f64 / 255.0);
        for i in 0..3 {
            sum[i] += c[i];
            for j in 0..3 {
                products[i][j] += c[i] * c[j];
            }
        }
    }
    let mean = sum.map(|s| s / n);
    (mean, std::array::from_fn(|i| std::array::from_fn(|j| products[i][j] / n - mean[i] * mean[j])))
}

/// Distance of the means plus the root of the covariances' Frobenius distance, both in units of color.
fn distance(a: &[u8], b: &[u8]) -> f64 {
    let ((mean_a, covariance_a), (mean_b, covariance_b)) = (color_statistics(a), color_statistics(b));
    let mean: f64 = (0..3).map(|i| (mean_a[i] - mean_b[i]).powi(2)).sum();
    let spread: f64 = (0..9).map(|k| (covariance_a[k / 3][k % 3] - covariance_b[k / 3][k % 3]).powi(2)).sum();
    mean.sqrt() + spread.sqrt().sqrt()
}

#[test]
fn every_painting_has_the_size_of_the_canvas() {
    for pixels in PIXELS.iter() {
        assert_eq!(pixels.len(), SIZE * SIZE * 3);
    }
}

#[test]
fn painting_again_gives_the_same_pixels() {
    for (painting, pixels) in PAINTINGS.iter().zip(PIXELS.iter()) {
        assert!(&(painting.paint)().to_rgb() == pixels, "{} differs from its first run", painting.name);
    }
}

#[test]
fn pixels_are_the_pinned_ones() {
    let found: Vec<u64> = PIXELS.iter().map(|pixels| hash(pixels)).collect();
    assert_eq!(found, HASHES, "found {found:#018x?}");
}

#[test]
fn no_painting_is_blank() {
    for (painting, pixels) in PAINTINGS.iter().zip(PIXELS.iter()) {
        let (_, covariance) = color_statistics(pixels);
        for (channel, row) in covariance.iter().enumerate() {
            let std_dev = row[channel].sqrt();
            assert!(std_dev > 0.07, "{}: channel {channel} deviates by {std_dev:.3} only", painting.name);
        }
    }
}

#[test]
fn palettes_are_far_apart() {
    for (i, a) in PIXELS.iter().enumerate() {
        for (j, b) in PIXELS.iter().enumerate().skip(i + 1) {
            let d = distance(a, b);
            eprintln!("{} - {}: {d:.3}", PAINTINGS[i].name, PAINTINGS[j].name);
            assert!(d > 0.25, "{} and {} are only {d:.3} apart", PAINTINGS[i].name, PAINTINGS[j].name);
        }
    }
}
