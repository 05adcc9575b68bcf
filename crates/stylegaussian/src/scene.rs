//! The scene: N Gaussians, and what embedding adds to them.

use glam::{Quat, Vec3};

use crate::{decoder::Decoder, encoder_id::EncoderId, neighbors::Neighbors};

/// N 3D Gaussians in structure-of-arrays form, with optional features, neighbors and decoder.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Means `[N]`, in scene units.
    pub means: Vec<Vec3>,
    /// Rotations `[N]`, unit quaternions (x, y, z, w), world from Gaussian.
    pub rotations: Vec<Quat>,
    /// Standard deviations along the three local axes `[N]`, linear, in scene units.
    pub scales: Vec<Vec3>,
    /// Opacities `[N]`, 0..1.
    pub opacities: Vec<f32>,
    /// Unstyled colors; `None` for checkpoints, which keep none (their unstyled color is mid-gray).
    pub sh: Option<Sh>,
    /// Index of each Gaussian in the source file `[N]`.
    pub order: Vec<u32>,
    /// How many Gaussians the source file held, those dropped at loading included.
    pub n_source: usize,
    /// What embedding adds.
    pub features: Option<Features>,
    /// The K nearest neighbors of every Gaussian, where already known.
    pub neighbors: Option<Neighbors>,
    /// A decoder trained for this scene; it wins over the default one.
    pub decoder: Option<Decoder>,
    /// Which direction is up in the scene, where the file tells. The loader never rotates a scene.
    pub up: Option<Vec3>,
    /// Where the scene comes from, for people.
    pub source: Option<String>,
    /// The licence of the capture.
    pub licence: Option<String>,
}

/// Spherical harmonics of N Gaussians.
#[derive(Clone, Debug)]
pub struct Sh {
    /// Degree, 0..=3.
    pub degree: u8,
    /// Coefficients `[N, (degree + 1)^2, 3]`, flattened: coefficient-major within a Gaussian, RGB innermost.
    pub coefficients: Vec<f32>,
}

/// Low-dimensional features and the affine map to the encoder's D channels: f = A f' + b.
#[derive(Clone, Debug)]
pub struct Features {
    /// f' of every Gaussian `[N, L]`, row-major.
    pub values: Vec<f32>,
    /// L, the number of stored channels.
    pub n_low: usize,
    /// A `[D, L]`, row-major.
    pub basis: Vec<f32>,
    /// b `[D]`.
    pub offset: Vec<f32>,
    /// Inputs that the transfer does not touch `[N, E]`, row-major; empty when E = 0.
    pub extra: Vec<f32>,
    /// E, the number of extra inputs.
    pub n_extra: usize,
    /// The encoder the D channels belong to; `None` when the file did not say.
    pub encoder: Option<EncoderId>,
}

impl Features {
    /// D, the number of channels of the encoder.
    pub fn n_channels(&self) -> usize {
        self.offset.len()
    }
}

impl Scene {
    /// N, the number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether the scene has no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }
}
