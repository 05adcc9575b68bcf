//! The paper's equations, literally, in f64: the reference for tests of the fast path.
//!
//! This twin forms everything that the fast path avoids: f = A f' + b for every Gaussian, its statistics, AdaIN
//! on it, and unfolded layers. It is slow and wide on purpose.

use stylegaussian::{ChannelStatistics, Decoder, Features, Neighbors, statistics::STD_DEV_EPSILON};

/// f = A f' + b of every Gaussian, `[N][D]`.
pub fn full_features(features: &Features) -> Vec<Vec<f64>> {
    let n_latent = features.n_latent;
    let full = |row: &[f32]| {
        let channel = |d: usize| {
            let basis = &features.basis[d * n_latent..][..n_latent];
            let sum: f64 = basis.iter().zip(row).map(|(a, f)| f64::from(*a) * f64::from(*f)).sum();
            sum + f64::from(features.offset[d])
        };
        (0..features.n_channels()).map(channel).collect()
    };
    features.values.chunks_exact(n_latent).map(full).collect()
}

/// AdaIN of every row: std_s (f - mean(f)) / (std(f) + 1e-8) + mean_s. std is unbiased, and 0 if N <= 1.
pub fn adain(f: &[Vec<f64>], style: &ChannelStatistics) -> Vec<Vec<f64>> {
    let n = f.len() as f64;
    let n_channels = style.mean.len();
    let mean: Vec<f64> = (0..n_channels).map(|d| f.iter().map(|row| row[d]).sum::<f64>() / n).collect();
    let std_dev: Vec<f64> = (0..n_channels)
        .map(|d| {
            let squares: f64 = f.iter().map(|row| (row[d] - mean[d]).powi(2)).sum();
            if f.len() > 1 { (squares / (n - 1.0)).sqrt() } else { 0.0 }
        })
        .collect();
    let channel = |row: &[f64], d: usize| {
        let normalized = (row[d] - mean[d]) / (std_dev[d] + STD_DEV_EPSILON);
        f64::from(style.std_dev[d]) * normalized + f64::from(style.mean[d])
    };
    f.iter().map(|row| (0..n_channels).map(|d| channel(row, d)).collect()).collect()
}

/// Colors `[N][3]` of full-width features and procedural inputs `[N][D + E]`, before a residual decoder adds
/// the base color.
pub fn decode(decoder: &Decoder, neighbors: &Neighbors, mut x: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    for (i, layer) in decoder.layers.iter().enumerate() {
        let is_last = i + 1 == decoder.layers.len();
        let output = |neighborhood: &[u32], o: usize| {
            // Weights stay [D_out, K, D_in] as stored, so the index here is the definition of that shape.
            let mut sum = f64::from(layer.bias[o]);
            for (k, &neighbor) in neighborhood.iter().enumerate() {
                let weight = &layer.weight[(o * decoder.k + k) * layer.d_in..][..layer.d_in];
                let row = &x[neighbor as usize];
                sum += weight.iter().zip(row).map(|(w, v)| f64::from(*w) * v).sum::<f64>();
            }
            if is_last { sum } else { decoder.activation.evaluate(sum) }
        };
        let neighborhoods = neighbors.indices.chunks_exact(neighbors.k);
        x = neighborhoods
            .map(|neighborhood| (0..layer.d_out).map(|o| output(neighborhood, o)).collect())
            .collect();
    }
    for _ in 0..decoder.smoothing_passes {
        let mean = |neighborhood: &[u32], o: usize| {
            neighborhood.iter().map(|&neighbor| x[neighbor as usize][o]).sum::<f64>() / decoder.k as f64
        };
        let neighborhoods = neighbors.indices.chunks_exact(neighbors.k);
        x = neighborhoods.map(|neighborhood| (0..3).map(|o| mean(neighborhood, o)).collect()).collect();
    }
    x
}
