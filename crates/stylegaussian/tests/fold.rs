//! The folded path against the paper's equations in f64, on random decoders.

use glam::{Quat, Vec3};
use stylegaussian::{
    Activation, ChannelStatistics, Decoder, Features, Layer, Neighbors, Scene,
    fold::{ChannelMap, StylizeError, stylize, transfer},
    noise::noise,
    scene::Sh,
};

mod twin;

/// SplitMix64, which gives the same numbers everywhere.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Sum of twelve uniforms: mean 0, deviation 1.
    fn normal(&mut self) -> f32 {
        ((0..12).map(|_| self.uniform()).sum::<f64>() - 6.0) as f32
    }

    fn normals(&mut self, n: usize, deviation: f32) -> Vec<f32> {
        (0..n).map(|_| deviation * self.normal()).collect()
    }
}

const N_CHANNELS: usize = 256;
const K: usize = 8;

fn scene(random: &mut Random, n: usize, n_latent: usize, n_extra: usize) -> Scene {
    let basis = if n_latent == N_CHANNELS {
        (0..n_latent * n_latent).map(|i| if i % (n_latent + 1) == 0 { 1.0 } else { 0.0 }).collect()
    } else {
        random.normals(N_CHANNELS * n_latent, 1.0 / (n_latent as f32).sqrt())
    };
    let mut scene = Scene {
        means: (0..n).map(|_| Vec3::new(random.normal(), random.normal(), random.normal())).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::ONE; n],
        opacities: vec![0.5; n],
        order: (0..n as u32).collect(),
        n_source: n,
        features: Some(Features {
            values: random.normals(n * n_latent, 1.0),
            n_latent,
            basis,
            offset: random.normals(N_CHANNELS, 1.0),
            extra: random.normals(n * n_extra, 1.0),
            n_extra,
            encoder: None,
        }),
        ..Scene::default()
    };
    scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, K));
    scene
}

/// A decoder with pre-activations of about mean 0 and deviation 1 over Gaussians, so that nothing saturates.
/// Inputs of a first layer have deviation 1, a sigmoid of a unit normal has mean 0.5 and deviation 0.21, and
/// neighborhoods of random points overlap little.
fn decoder(random: &mut Random, n_inputs: usize, activation: Activation) -> Decoder {
    let mut d_in = n_inputs;
    let layer = |d_out: usize| {
        let (mean, gain) = match activation {
            _ if d_in == n_inputs => (0.0, 1.0),
            Activation::Sigmoid => (0.5, 1.0 / 0.21),
            Activation::LeakyRelu { .. } => (0.0, 2.0_f32.sqrt()),
        };
        let weight = random.normals(d_out * K * d_in, gain / ((K * d_in) as f32).sqrt());
        // Takes away the response to the mean of the inputs.
        let bias = weight.chunks_exact(K * d_in).map(|row| -mean * row.iter().sum::<f32>()).collect();
        let layer = Layer { weight, bias, d_in, d_out };
        d_in = d_out;
        layer
    };
    let layers = Decoder::WIDTHS.map(layer).into();
    Decoder { layers, k: K, activation, ..Decoder::default() }
}

fn style(random: &mut Random) -> ChannelStatistics {
    let std_dev = (0..N_CHANNELS).map(|_| 0.5 + random.uniform() as f32).collect();
    ChannelStatistics { mean: random.normals(N_CHANNELS, 0.5), std_dev, ..Default::default() }
}

fn with_extra(scene: &Scene, mut rows: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let features = scene.features.as_ref().unwrap();
    for (i, row) in rows.iter_mut().enumerate() {
        row.extend(features.extra[i * features.n_extra..][..features.n_extra].iter().map(|v| f64::from(*v)));
    }
    rows
}

fn check_close(colors: &[[f32; 3]], expected: &[Vec<f64>], what: &str) {
    assert_eq!(colors.len(), expected.len());
    for (i, (color, expected)) in colors.iter().zip(expected).enumerate() {
        for (a, b) in color.iter().zip(expected) {
            assert!(
                (f64::from(*a) - b).abs() < 1e-4,
                "{what}: Gaussian {i} is {color:?}, expected {expected:?}"
            );
        }
    }
}

/// Mean over the three channels of the standard deviation over Gaussians.
fn deviation(rows: &[Vec<f64>]) -> f64 {
    let n = rows.len() as f64;
    let channel = |c: usize| {
        let mean = rows.iter().map(|row| row[c]).sum::<f64>() / n;
        (rows.iter().map(|row| (row[c] - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    (0..3).map(channel).sum::<f64>() / 3.0
}

fn check_fold(n: usize, n_latent: usize, n_extra: usize, activation: Activation) {
    let mut random = Random((n * 1000 + n_latent) as u64);
    let scene = scene(&mut random, n, n_latent, n_extra);
    let decoder = decoder(&mut random, N_CHANNELS + n_extra, activation);
    let (a, b) = (style(&mut random), style(&mut random));
    let features = scene.features.as_ref().unwrap();
    let neighbors = scene.neighbors.as_ref().unwrap();
    let f = twin::full_features(features);
    let what = format!("N = {n}, L = {n_latent}, E = {n_extra}");

    let map = transfer(features, &[(&a, 1.0)], 0.0).unwrap();
    let expected = twin::decode(&decoder, neighbors, with_extra(&scene, twin::adain(&f, &a)));
    check_close(&stylize(&scene, &decoder, &map).unwrap(), &expected, &what);
    if n > 1000 {
        assert!(deviation(&expected) > 0.1, "{what}: an output that hardly varies proves nothing");
    }
    if n > 1000 {
        return; // mixing and content cost as much again, and depend on N no more than the transfer above
    }

    // 0.3 and 0.7 once they are normalized.
    let map = transfer(features, &[(&a, 0.6), (&b, 1.4)], 0.0).unwrap();
    let (fa, fb) = (twin::adain(&f, &a), twin::adain(&f, &b));
    let mixed = |i: usize| fa[i].iter().zip(&fb[i]).map(|(a, b)| 0.3 * a + 0.7 * b).collect();
    let expected = twin::decode(&decoder, neighbors, with_extra(&scene, (0..n).map(mixed).collect()));
    check_close(&stylize(&scene, &decoder, &map).unwrap(), &expected, &format!("{what}, mixed 30/70"));

    let map = transfer(features, &[(&a, 1.0)], 1.0).unwrap();
    assert_eq!(map, ChannelMap::identity(N_CHANNELS));
    let expected = twin::decode(&decoder, neighbors, with_extra(&scene, f));
    check_close(&stylize(&scene, &decoder, &map).unwrap(), &expected, &format!("{what}, content 1"));
}

#[test]
fn folded_equals_unfolded() {
    for n in [1, 7, 300] {
        for n_latent in [32, 256] {
            check_fold(n, n_latent, 0, Activation::Sigmoid);
            check_fold(n, n_latent, 5, Activation::LeakyRelu { slope: 0.2 });
        }
    }
}

#[test]
fn folded_equals_unfolded_at_ten_thousand() {
    check_fold(10_000, 32, 0, Activation::Sigmoid);
    check_fold(10_000, 256, 0, Activation::Sigmoid);
}

/// All inputs that a decoder may have beside the paper's features: the scene's extra inputs, noise, base
/// colors, and the statistics of the style.
#[test]
fn a_decoder_may_see_more() {
    check_all_inputs(0);
    check_all_inputs(1);
    check_all_inputs(3);
}

fn check_all_inputs(smoothing_passes: usize) {
    let mut random = Random(11);
    let mut scene = scene(&mut random, 40, 32, 2);
    scene.sh = Some(Sh { degree: 0, coefficients: random.normals(40 * 3, 0.5) });
    let n_noise = 2;
    let decoder = Decoder {
        base_color: true,
        n_noise,
        smoothing_passes,
        residual: 0.25,
        statistics_weight: random.normals(256 * 2 * N_CHANNELS, 0.02),
        ..decoder(&mut random, N_CHANNELS + 2 + n_noise + 3, Activation::LeakyRelu { slope: 0.2 })
    };
    let styles = [style(&mut random), style(&mut random)];
    let features = scene.features.as_ref().unwrap();
    let f = twin::full_features(features);
    let mixed: Vec<Vec<f64>> = {
        let [a, b] = styles.each_ref().map(|style| twin::adain(&f, style));
        a.iter().zip(&b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| 0.25 * a + 0.75 * b).collect()).collect()
    };
    // Features after AdaIN have the statistics of the style. A mix of two maps of one scene has the mix of
    // their statistics.
    let mix = |part: fn(&ChannelStatistics) -> &Vec<f32>| {
        let [a, b] = styles.each_ref().map(part);
        a.iter().zip(b).map(|(a, b)| 0.25 * f64::from(*a) + 0.75 * f64::from(*b)).collect::<Vec<f64>>()
    };
    let statistics: Vec<f64> =
        mix(|style| &style.mean).into_iter().chain(mix(|style| &style.std_dev)).collect();
    let mut unfolded = decoder.clone();
    let weights = decoder.statistics_weight.chunks_exact(2 * N_CHANNELS);
    for (bias, row) in unfolded.layers[0].bias.iter_mut().zip(weights) {
        *bias += row.iter().zip(&statistics).map(|(w, s)| f64::from(*w) * s).sum::<f64>() as f32;
    }
    let mut rows = with_extra(&scene, mixed);
    for ((row, color), source_index) in rows.iter_mut().zip(scene.base_colors()).zip(&scene.order) {
        row.extend((0..n_noise as u32).map(|channel| f64::from(noise(*source_index, channel))));
        // The 4 is that of the file format, written out so that a change of the constant shows.
        row.extend(color.map(|channel| 4.0 * (f64::from(channel) - 0.5)));
    }
    let mut expected = twin::decode(&unfolded, scene.neighbors.as_ref().unwrap(), rows);
    for (expected, base) in expected.iter_mut().zip(scene.base_colors()) {
        expected.iter_mut().zip(base).for_each(|(channel, base)| *channel += 0.25 * f64::from(base));
    }
    // 0.25 and 0.75 once they are normalized.
    let map = transfer(features, &[(&styles[0], 1.0), (&styles[1], 3.0)], 0.0).unwrap();
    let what = format!("extra inputs of every kind, {smoothing_passes} smoothing passes");
    check_close(&stylize(&scene, &decoder, &map).unwrap(), &expected, &what);
}

#[test]
fn dead_channels_stay_finite() {
    let mut random = Random(5);
    let mut scene = scene(&mut random, 50, 32, 0);
    let features = scene.features.as_mut().unwrap();
    // The first 100 channels equal their offset, and the gain of AdaIN is about 1e8: no encoder is named, so no
    // floor applies.
    features.basis[..32 * 100].fill(0.0);
    let decoder = decoder(&mut random, N_CHANNELS, Activation::Sigmoid);
    let style = style(&mut random);
    let map = transfer(scene.features.as_ref().unwrap(), &[(&style, 1.0)], 0.0).unwrap();
    let f = twin::full_features(scene.features.as_ref().unwrap());
    let expected = twin::decode(&decoder, scene.neighbors.as_ref().unwrap(), twin::adain(&f, &style));
    check_close(&stylize(&scene, &decoder, &map).unwrap(), &expected, "dead channels");
}

#[test]
fn misfits_are_errors() {
    let mut random = Random(9);
    let scene = scene(&mut random, 10, 32, 0);
    let features = scene.features.as_ref().unwrap();
    let style = style(&mut random);
    let short = ChannelStatistics { mean: vec![0.0; 3], std_dev: vec![1.0; 3], ..Default::default() };
    assert!(matches!(transfer(features, &[(&short, 1.0)], 0.0), Err(StylizeError::StyleChannels { .. })));
    // They sum to 0, or hold a number that is negative, NaN or infinite.
    for weights in [[0.0, 0.0], [1.0, -1.0], [f64::NAN, 1.0], [f64::INFINITY, 1.0]] {
        let mix = [(&style, weights[0]), (&style, weights[1])];
        assert!(matches!(transfer(features, &mix, 0.0), Err(StylizeError::MixWeights { .. })), "{weights:?}");
    }
    assert!(matches!(transfer(features, &[], 0.0), Err(StylizeError::MixWeights { .. })));
    for content in [-0.1, 1.1, f64::NAN] {
        assert!(matches!(transfer(features, &[(&style, 1.0)], content), Err(StylizeError::Content { .. })));
    }
    let map = ChannelMap::identity(N_CHANNELS);
    let narrow = decoder(&mut random, 100, Activation::Sigmoid);
    assert!(matches!(stylize(&scene, &narrow, &map), Err(StylizeError::DecoderChannels { .. })));
    let bare = Scene { features: None, ..scene };
    assert!(matches!(stylize(&bare, &narrow, &map), Err(StylizeError::NoFeatures)));
}
