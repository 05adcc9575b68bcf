//! Scenes and decoders for measurements, always the same, and of any size.

use std::f32::consts::TAU;

use glam::{Quat, Vec3};
use stylegaussian::{Decoder, Features, Layer, Neighbors, Scene, morton, scene::Sh};

/// The encoder's channels D.
pub const N_CHANNELS: usize = 256;
/// The stored channels L of a folded scene.
pub const N_LOW: usize = 32;
/// Neighbors K.
pub const K: usize = 8;

/// Numbers in 0..1 (Marsaglia, "Xorshift RNGs", 2003).
pub struct Random(u64);

impl Random {
    /// Starts the sequence, which is always the same.
    pub fn new() -> Self {
        Self(0x9e37_79b9_7f4a_7c15)
    }

    /// The next number.
    pub fn next(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        // The upper 24 bits, as many as an f32 holds exactly.
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    /// `n` numbers in -scale..scale.
    pub fn many(&mut self, n: usize, scale: f32) -> Vec<f32> {
        (0..n).map(|_| scale * (2.0 * self.next() - 1.0)).collect()
    }
}

/// A Gaussian on a surface: its position, the surface's normal, its area times n, and its color.
struct Patch {
    mean: Vec3,
    normal: Vec3,
    area: f32,
    rgb: Vec3,
}

/// `n` flat Gaussians in the surfaces of a unit sphere (40%), a torus (20%) and a checkered floor (40%): the
/// structured scene of the peer's benchmark, number by number.
pub fn structured(n: usize) -> Scene {
    let mut random = Random::new();
    let patches = (0..n).map(|_| patch(&mut random)).collect::<Vec<_>>();
    let size = |patch: &Patch| 0.8 * (patch.area / n as f32).sqrt();
    Scene {
        means: patches.iter().map(|patch| patch.mean).collect(),
        rotations: patches.iter().map(|patch| Quat::from_rotation_arc(Vec3::Z, patch.normal)).collect(),
        scales: patches.iter().map(|patch| size(patch) * Vec3::new(1.0, 1.0, 0.1)).collect(),
        opacities: vec![0.9; n],
        ..colored(patches.iter().map(|patch| patch.rgb))
    }
}

fn patch(random: &mut Random) -> Patch {
    let (kind, u, v) = (random.next(), random.next(), random.next());
    if kind < 0.4 {
        let (z, a) = (2.0 * u - 1.0, TAU * v);
        let r = (1.0 - z * z).sqrt();
        let normal = Vec3::new(r * a.cos(), z, r * a.sin());
        let rgb = Vec3::new(0.5 + 0.5 * (4.0 * a).sin(), 0.35, 0.5 + 0.5 * z);
        // The sphere's area is 4 pi = 12.57. It has 0.4 n Gaussians.
        Patch { mean: normal + Vec3::Y, normal, area: 12.57 / 0.4, rgb }
    } else if kind < 0.6 {
        let (a, b) = (TAU * u, TAU * v);
        let ring = Vec3::new(a.cos(), 0.0, a.sin());
        let normal = ring * b.cos() + Vec3::Y * b.sin();
        let rgb = Vec3::new(0.9, 0.6 + 0.3 * b.sin(), 0.1);
        // 4 pi^2 1.8 * 0.25 = 17.8, and 0.2 n Gaussians.
        Patch { mean: 1.8 * ring + 0.25 * normal + 0.6 * Vec3::Y, normal, area: 17.8 / 0.2, rgb }
    } else {
        let (x, z) = (8.0 * u - 4.0, 8.0 * v - 4.0);
        let is_light = (x.floor() as i32 + z.floor() as i32) & 1 == 0;
        let rgb = Vec3::splat(if is_light { 0.85 } else { 0.2 });
        // 8 x 8, and 0.4 n Gaussians.
        Patch { mean: Vec3::new(x, 0.0, z), normal: Vec3::Y, area: 64.0 / 0.4, rgb }
    }
}

/// `n` Gaussians of all shapes and colors in a cube of 40 units.
pub fn random(n: usize) -> Scene {
    let mut random = Random::new();
    let mut vector = || Vec3::new(random.next(), random.next(), random.next());
    let unit = |v: Vec3| (v - 0.5).normalize_or(Vec3::Y);
    let means = (0..n).map(|_| 40.0 * vector() - 20.0).collect();
    let rotations = (0..n).map(|_| Quat::from_axis_angle(unit(vector()), TAU * vector().x)).collect();
    let scales = (0..n).map(|_| 0.02 + 0.6 * vector().powf(2.0)).collect();
    let opacities = (0..n).map(|_| vector().x).collect();
    let colors: Vec<Vec3> = (0..n).map(|_| vector()).collect();
    Scene { means, rotations, scales, opacities, ..colored(colors.into_iter()) }
}

/// A scene with colors and without features.
fn colored(rgb: impl ExactSizeIterator<Item = Vec3>) -> Scene {
    let n = rgb.len();
    let coefficients = rgb.flat_map(|rgb| stylegaussian::sh::dc_from_color(rgb.to_array())).collect();
    Scene {
        sh: Some(Sh { degree: 0, coefficients }),
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    }
}

/// The structured scene in Morton order, as files keep it, with `n_latent` features for 256 channels and
/// neighbor lists. The features are noise, because times do not depend on them. If there are 256, they are the
/// channels themselves, as in the literal method.
pub fn embedded(n: usize, n_latent: usize) -> Scene {
    let scene = structured(n);
    let mut scene = scene.subset(&morton::order(&scene.means));
    scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, K));
    let mut random = Random::new();
    let basis = if n_latent == N_CHANNELS { identity() } else { random.many(N_CHANNELS * n_latent, 1.0) };
    scene.features = Some(Features {
        values: random.many(n * n_latent, 1.0),
        n_latent,
        basis,
        offset: vec![0.0; N_CHANNELS],
        extra: Vec::new(),
        n_extra: 0,
        encoder: None,
    });
    scene
}

fn identity() -> Vec<f32> {
    (0..N_CHANNELS * N_CHANNELS).map(|i| if i % (N_CHANNELS + 1) == 0 { 1.0 } else { 0.0 }).collect()
}

/// The paper's decoder with random weights that keep the scale of activations.
pub fn decoder() -> Decoder {
    let mut random = Random::new();
    let mut d_in = N_CHANNELS;
    let layers = Decoder::WIDTHS.map(|d_out| {
        // Uniform numbers in -s..s have variance s^2 / 3: this makes it 1 / (K d_in).
        let scale = (3.0 / (K * d_in) as f32).sqrt();
        let weight = random.many(d_out * K * d_in, scale);
        let layer = Layer { weight, bias: vec![0.0; d_out], d_in, d_out };
        d_in = d_out;
        layer
    });
    Decoder { layers: layers.into(), k: K, ..Decoder::default() }
}

/// Number of multiplications and additions of each layer for one Gaussian, with `n_latent` inputs.
pub fn flops_of_layers(n_latent: usize) -> [u64; 5] {
    let mut d_in = n_latent;
    Decoder::WIDTHS.map(|d_out| {
        // A multiplication and an addition for each weight.
        let flops = 2 * (K * d_in * d_out) as u64;
        d_in = d_out;
        flops
    })
}

/// Number of multiplications and additions of all layers for `n` Gaussians, with `n_latent` inputs.
pub fn flops(n: usize, n_latent: usize) -> u64 {
    n as u64 * flops_of_layers(n_latent).iter().sum::<u64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper's widths take 410,368 multiply-adds for 32 features and 869,120 for 256.
    #[test]
    fn operations_are_those_of_the_paper() {
        assert_eq!(flops(1, N_LOW), 2 * 410_368);
        assert_eq!(flops(1, N_CHANNELS), 2 * 869_120);
    }

    #[test]
    fn scenes_are_whole() {
        for scene in [embedded(300, N_LOW), embedded(200, N_CHANNELS), random(100)] {
            scene.validate().unwrap();
        }
    }
}
