//! The memory that only a change of style needs.

use stylegaussian_shaders::style::NumberFormat;

use super::{
    plan::{Split, sum_columns},
    planes::Planes,
    shape::StyleShape,
};
use crate::{buffers, colors::GaussianColors};

/// Activations of hidden layers, and sums over planes that do not fit one binding.
#[derive(Clone, Debug)]
pub(super) struct Scratch {
    /// Hidden layers write to these in turns.
    pub activations: [Planes; 2],
    pub sums: wgpu::Buffer,
    /// Colors `[N]` between smoothing passes. Passes go back and forth between these and the final colors. A
    /// single color if there are no passes.
    pub colors: wgpu::Buffer,
}

impl Scratch {
    pub fn new(device: &wgpu::Device, shape: &StyleShape, split: &Split, format: NumberFormat) -> Self {
        let n = split.capacity;
        let planes = |which: usize| {
            let width = shape.scratch_width(which);
            Planes::new(device, "style_activations", width, n, format, split.scratch[which])
        };
        // f32 sums; a binding holds one vec4 at least, even if no layer is split.
        let sums = sum_columns(shape, split) * 4 * split.chunk_rows.min(n);
        let colors = shape.color_bytes().max(GaussianColors::STRIDE);
        Self {
            activations: [planes(0), planes(1)],
            sums: buffers::storage(device, "style_sums", (sums as u64).max(16)),
            colors: buffers::storage(device, "style_colors", colors),
        }
    }
}
