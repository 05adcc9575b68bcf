//! The memory that only a change of style needs.

use stylegaussian_shaders::style::Storage;

use super::{
    content::StyleShape,
    plan::{Split, sum_columns},
    planes::Planes,
    scene::storage,
};
use crate::colors::GaussianColors;

/// Bytes of [`Scratch::colors`] that a scene needs.
pub(super) fn color_bytes(shape: &StyleShape) -> u64 {
    if shape.smoothing_passes > 0 { GaussianColors::bytes(shape.n_gaussians) } else { 0 }
}

/// Activations of hidden layers, which write them in turns, and sums over planes that do not fit one binding.
#[derive(Clone, Debug)]
pub(super) struct Scratch {
    pub activations: [Planes; 2],
    pub sums: wgpu::Buffer,
    /// Colors `[N]` between averages, which go to and fro between these and the ones that are asked for; a single one where
    /// there are no averages.
    pub colors: wgpu::Buffer,
}

impl Scratch {
    pub fn new(device: &wgpu::Device, shape: &StyleShape, split: &Split, kept_as: Storage) -> Self {
        let n = split.capacity;
        let planes = |which: usize| {
            let width = shape.scratch_width(which);
            Planes::new(device, "style_activations", width, n, kept_as, split.scratch[which])
        };
        let sums = sum_columns(shape, split) * 4 * split.chunk_rows.min(n);
        Self {
            activations: [planes(0), planes(1)],
            sums: storage(device, "style_sums", (sums as u64).max(16)),
            colors: storage(device, "style_colors", color_bytes(shape).max(GaussianColors::STRIDE)),
        }
    }
}
