//! Random scenes, styles and decoders, the same in every run.

use glam::{Quat, Vec3};
use stylegaussian::{
    Activation, ChannelStatistics, Decoder, Features, Layer, Neighbors, Scene, scene::Sh,
    statistics::ContentStatistics,
};

/// Channels D of the random features.
const N_CHANNELS: usize = 48;

/// A generator of Knuth's, MMIX (The Art of Computer Programming 2, 3.3.4).
pub struct Random(pub u64);

impl Random {
    /// Uniform in -1..1.
    pub fn signed(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u32 << 23) as f32 - 1.0
    }

    /// `n` numbers, uniform in -scale..scale.
    fn many(&mut self, n: usize, scale: f32) -> Vec<f32> {
        (0..n).map(|_| scale * self.signed()).collect()
    }

    /// `n` embedded Gaussians in a cube. Latent features have sizes from 10 down to 0.1, as after a principal
    /// component analysis, about means that are not 0.
    pub fn scene(&mut self, n: usize, n_latent: usize, n_extra: usize, k: usize) -> Scene {
        let means: Vec<Vec3> =
            (0..n).map(|_| Vec3::new(self.signed(), self.signed(), self.signed())).collect();
        let order: Vec<u32> = (0..n as u32).collect();
        let size = |channel: usize| 10.0 * 0.01_f32.powf(channel as f32 / n_latent as f32);
        let values = (0..n * n_latent).map(|i| size(i % n_latent) * (self.signed() + 0.5)).collect();
        let features = Features {
            values,
            n_latent,
            basis: self.many(N_CHANNELS * n_latent, 1.0),
            offset: self.many(N_CHANNELS, 3.0),
            extra: self.many(n * n_extra, 1.0),
            n_extra,
            encoder: None,
        };
        Scene {
            neighbors: Some(Neighbors::find(&means, &order, k)),
            rotations: vec![Quat::IDENTITY; n],
            scales: vec![Vec3::splat(0.01); n],
            opacities: vec![0.5; n],
            sh: Some(Sh { degree: 0, coefficients: self.many(3 * n, 1.0) }),
            means,
            order,
            n_source: n,
            features: Some(features),
            ..Scene::default()
        }
    }

    /// A style with statistics like those of the content.
    pub fn style(&mut self, features: &Features) -> ChannelStatistics {
        let content = ContentStatistics::of(features);
        let near = |random: &mut Self, value: &f64| *value as f32 * (1.0 + 0.5 * random.signed());
        // If there is one Gaussian, the content has no deviation, and neither may the style.
        ChannelStatistics {
            mean: content.mean.iter().map(|mean| near(self, mean)).collect(),
            std_dev: content.std_dev.iter().map(|std_dev| near(self, std_dev)).collect(),
            covariance: None,
            encoder: None,
        }
    }

    /// A decoder without layers.
    pub fn empty(&self, k: usize, activation: Activation) -> Decoder {
        Decoder { layers: Vec::new(), k, activation, ..Decoder::default() }
    }

    /// A decoder of these widths for a scene.
    pub fn decoder(&mut self, scene: &Scene, k: usize, widths: &[usize], activation: Activation) -> Decoder {
        let empty = self.empty(k, activation);
        self.layers(empty, scene, widths, false)
    }

    /// `decoder` with layers of these widths. Their weights keep activations at about the same size and give
    /// colors that deviate by a quarter, like those of a picture. f16 holds numbers up to 2 to 5e-4.
    pub fn layers(
        &mut self,
        mut decoder: Decoder,
        scene: &Scene,
        widths: &[usize],
        sees_statistics: bool,
    ) -> Decoder {
        let features = scene.features.as_ref().expect("an embedded scene");
        let mut d_in = features.n_channels() + features.n_extra + decoder.n_procedural();
        // A feature is a sum of L numbers of up to 10.
        let mut size = 10.0;
        for (i, &d_out) in widths.iter().enumerate() {
            let fan_in = decoder.k * d_in;
            let gain = if i + 1 == widths.len() { 0.2 } else { 1.0 };
            let scale = gain * (6.0 / fan_in as f32).sqrt() / size;
            let weight = self.many(d_out * fan_in, scale);
            decoder.layers.push(Layer { weight, bias: self.many(d_out, 0.1), d_in, d_out });
            (d_in, size) = (d_out, 1.0);
        }
        if sees_statistics {
            decoder.statistics_weight = self.many(widths[0] * 2 * features.n_channels(), 0.01);
        }
        decoder
    }
}
