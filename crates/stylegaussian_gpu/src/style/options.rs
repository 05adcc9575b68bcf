//! How exactly and in how much memory scenes are decoded.

use stylegaussian_shaders::style::Storage;

use super::{content::StyleShape, planes::Planes, scratch::color_bytes};

/// How numbers are kept between layers. Sums are f32 in any case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Precision {
    /// f32, features included: twice the memory and the gathers.
    F32,
    /// f16: colors of the paper's layers are within 2e-3 of f32's.
    #[default]
    F16,
    /// Bytes, for decoders whose activation is the sigmoid, which lives in 0..1; features f16. Each activation is rounded by at
    /// most 1/510: colors of the paper's layers are within 5e-3 of f32's. Half the scratch memory of f16.
    Unorm8,
}

impl Precision {
    /// How the scene's inputs are kept.
    pub(super) fn of_inputs(self) -> Storage {
        match self {
            Self::F32 => Storage::F32,
            Self::F16 | Self::Unorm8 => Storage::F16,
        }
    }

    /// How activations are kept.
    pub(super) fn of_activations(self) -> Storage {
        match self {
            Self::F32 => Storage::F32,
            Self::F16 => Storage::F16,
            Self::Unorm8 => Storage::Unorm8,
        }
    }
}

/// How scenes are decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StyleOptions {
    /// How numbers are kept between layers.
    pub precision: Precision,
    /// The most bytes that activations take on the GPU, and beside them the colors between averages, 8 for each Gaussian, as
    /// far as these leave a quarter. A scene that would need more is decoded in blocks, one after another, whose borders are
    /// computed by each that they touch. Scenes whose neighbor lists do not name near Gaussians cannot be cut and take what
    /// they need.
    pub scratch_bytes: u64,
}

impl Default for StyleOptions {
    /// f16, and 64 MiB: 87,381 rows of the paper's layers, whose borders are then some percent of them.
    fn default() -> Self {
        Self { precision: Precision::default(), scratch_bytes: 64 << 20 }
    }
}

impl StyleOptions {
    /// Rows of `shape` whose activations fit.
    pub(super) fn max_rows(&self, shape: &StyleShape) -> usize {
        let of_row = activation_bytes(shape, 1, self.precision);
        let left = self.scratch_bytes.saturating_sub(color_bytes(shape)).max(self.scratch_bytes / 4);
        usize::try_from(left / of_row.max(1)).unwrap_or(usize::MAX).max(1)
    }
}

/// Bytes of the activations of `n_rows`.
pub(super) fn activation_bytes(shape: &StyleShape, n_rows: usize, precision: Precision) -> u64 {
    let storage = precision.of_activations();
    [0, 1].map(|which| Planes::bytes(shape.scratch_width(which), n_rows, storage)).iter().sum()
}
