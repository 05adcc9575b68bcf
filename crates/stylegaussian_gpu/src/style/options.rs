//! Precision and memory of the style pass.

use stylegaussian_shaders::style::NumberFormat;

use super::{planes::Planes, shape::StyleShape};

/// The precision of numbers between layers. Sums are f32 in any case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Precision {
    /// f32, features included: twice the memory and twice the bytes to gather.
    F32,
    /// f16. Colors of the paper's layers are within 2e-3 of those in f32.
    #[default]
    F16,
    /// Bytes, for decoders with the sigmoid as their activation, whose values lie in 0..1; features are f16.
    /// Each activation is rounded by at most 1/510: colors of the paper's layers are within 5e-3 of those in
    /// f32. Half the scratch memory of f16.
    Unorm8,
}

impl Precision {
    /// The format of the scene's inputs.
    pub(super) fn input_format(self) -> NumberFormat {
        match self {
            Self::F32 => NumberFormat::F32,
            Self::F16 | Self::Unorm8 => NumberFormat::F16,
        }
    }

    /// The format of activations.
    pub(super) fn activation_format(self) -> NumberFormat {
        match self {
            Self::F32 => NumberFormat::F32,
            Self::F16 => NumberFormat::F16,
            Self::Unorm8 => NumberFormat::Unorm8,
        }
    }
}

/// Options of decoding a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StyleOptions {
    /// The precision of numbers between layers.
    pub precision: Precision,
    /// Bytes of GPU memory for activations and for the colors between smoothing passes. These colors take 8
    /// bytes for each Gaussian, and activations get a quarter of this budget at least. A scene that needs more
    /// is decoded in blocks, one after another; the Gaussians at their borders are computed by each block that
    /// needs them. Scenes whose neighbor lists name distant Gaussians cannot be cut and take as much as they
    /// need.
    pub scratch_bytes: u64,
}

impl Default for StyleOptions {
    /// f16, and 64 MiB: 87,381 rows of the paper's layers, of which some percent are borders of blocks.
    fn default() -> Self {
        Self { precision: Precision::default(), scratch_bytes: 64 << 20 }
    }
}

impl StyleOptions {
    /// Rows of `shape` with activations that fit.
    pub(super) fn max_rows(&self, shape: &StyleShape) -> usize {
        let row_bytes = activation_bytes(shape, 1, self.precision);
        let left = self.scratch_bytes.saturating_sub(shape.color_bytes()).max(self.scratch_bytes / 4);
        usize::try_from(left / row_bytes.max(1)).unwrap_or(usize::MAX).max(1)
    }
}

/// Bytes of the activations of `n_rows`.
pub(super) fn activation_bytes(shape: &StyleShape, n_rows: usize, precision: Precision) -> u64 {
    let format = precision.activation_format();
    [0, 1].map(|which| Planes::bytes(shape.scratch_width(which), n_rows, format)).iter().sum()
}
