//! A folded decoder on the GPU.

use stylegaussian::{Activation, Layer};

use super::{
    folded_layers::FoldedLayers,
    planes::{PLANE_CHANNELS, n_planes},
};
use crate::buffers::{self, TooLarge};

/// The weights of a folded decoder in f32: one buffer for each layer, `[K * planes * 8 + 1, columns]`, with the
/// bias last.
///
/// They are not f16, because a folded first layer multiplies the basis with gains of any size. The paper's
/// layers on 32 latent features take 1.3 MB.
#[derive(Debug)]
pub struct GpuDecoder {
    layers: Vec<wgpu::Buffer>,
    pub(super) k: usize,
    /// Inputs of the first layer, then outputs of each layer.
    pub(super) widths: Vec<usize>,
    pub(super) activation: Activation,
    pub(super) residual: f32,
    pub(super) smoothing_passes: usize,
}

impl GpuDecoder {
    /// Uploads folded layers.
    ///
    /// # Errors
    /// If a layer is larger than the device can bind.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, folded: &FoldedLayers) -> Result<Self, TooLarge> {
        let limit = buffers::largest_binding(device);
        let mut layers = Vec::with_capacity(folded.layers.len());
        for (layer, is_last) in with_last(&folded.layers) {
            let size = 16 * (n_rows(layer, folded.k) * stride(layer.d_out, is_last)) as u64;
            TooLarge::check("weights of a layer", size, limit)?;
            layers.push(buffers::storage(device, "style_weights", size));
        }
        let decoder = Self {
            layers,
            k: folded.k,
            widths: widths(&folded.layers),
            activation: folded.activation,
            residual: folded.residual,
            smoothing_passes: folded.smoothing_passes,
        };
        decoder.upload(queue, folded);
        Ok(decoder)
    }

    /// Replaces the weights by those of another style of the same decoder and scene, and allocates nothing.
    /// Returns `false` and does nothing if the layers have other shapes; they need a new `GpuDecoder`.
    pub fn write(&mut self, queue: &wgpu::Queue, folded: &FoldedLayers) -> bool {
        if self.k != folded.k || self.widths != widths(&folded.layers) {
            return false;
        }
        (self.activation, self.residual) = (folded.activation, folded.residual);
        self.smoothing_passes = folded.smoothing_passes;
        self.upload(queue, folded);
        true
    }

    fn upload(&self, queue: &wgpu::Queue, folded: &FoldedLayers) {
        for (buffer, (layer, is_last)) in self.layers.iter().zip(with_last(&folded.layers)) {
            let rows = packed(layer, folded.k, stride(layer.d_out, is_last));
            queue.write_buffer(buffer, 0, bytemuck::cast_slice(&rows));
        }
    }

    /// Bytes of all weights.
    pub fn bytes(&self) -> u64 {
        self.layers.iter().map(wgpu::Buffer::size).sum()
    }

    pub(super) fn layer(&self, index: usize) -> &wgpu::Buffer {
        &self.layers[index]
    }
}

/// Bytes of a folded decoder of these widths (inputs of the first layer, then outputs of each).
pub(super) fn weight_bytes(widths: &[usize], k: usize) -> u64 {
    let n_layers = widths.len() - 1;
    let layer = |(i, pair): (usize, &[usize])| {
        16 * ((k * n_planes(pair[0]) * PLANE_CHANNELS + 1) * stride(pair[1], i + 1 == n_layers)) as u64
    };
    widths.windows(2).enumerate().map(layer).sum()
}

/// vec4 in a row of weights: whole planes for a hidden layer, a single color for the last.
pub(super) fn stride(d_out: usize, is_last: bool) -> usize {
    if is_last { 1 } else { n_planes(d_out) * 2 }
}

fn n_rows(layer: &Layer, k: usize) -> usize {
    k * n_planes(layer.d_in) * PLANE_CHANNELS + 1
}

fn widths(layers: &[Layer]) -> Vec<usize> {
    let inputs = layers.first().map(|layer| layer.d_in);
    inputs.into_iter().chain(layers.iter().map(|layer| layer.d_out)).collect()
}

fn with_last(layers: &[Layer]) -> impl Iterator<Item = (&Layer, bool)> {
    layers.iter().enumerate().map(|(i, layer)| (layer, i + 1 == layers.len()))
}

/// A layer's weight `[D_out, K, D_in]` and bias as rows of `quads` vec4: all outputs for each neighbor and each
/// channel of the input's planes, then the bias. Padding is 0.
fn packed(layer: &Layer, k: usize, quads: usize) -> Vec<f32> {
    let (columns, d_in) = (4 * quads, layer.d_in);
    let padded_in = n_planes(d_in) * PLANE_CHANNELS;
    // Transposed: the kernels load four outputs of one input at once.
    let mut rows = vec![0.0; n_rows(layer, k) * columns];
    for (output, weight) in layer.weight.chunks_exact((k * d_in).max(1)).enumerate() {
        for (i, value) in weight.iter().enumerate() {
            // Slot i / d_in, channel i % d_in. The padding of a slot to whole planes stays 0.
            rows[(i / d_in * padded_in + i % d_in) * columns + output] = *value;
        }
    }
    rows[k * padded_in * columns..][..layer.d_out].copy_from_slice(&layer.bias);
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_transposed_and_padded() {
        // [D_out 2, K 2, D_in 9]; each weight spells its indices.
        let weight =
            (0..36).map(|i| (i / 18 * 100 + i / 9 % 2 * 10 + i % 9) as f32 + 0.5).collect::<Vec<_>>();
        let layer = Layer { weight, bias: vec![7.0, 8.0], d_in: 9, d_out: 2 };
        let rows = packed(&layer, 2, 2);
        assert_eq!(rows.len(), (2 * 16 + 1) * 8);
        assert_eq!(rows[..3], [0.5, 100.5, 0.0]);
        assert_eq!(rows[(16 + 8) * 8..][..2], [18.5, 118.5]);
        assert_eq!(rows[9 * 8..16 * 8], [0.0; 56]);
        assert_eq!(rows[32 * 8..], [7.0, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(weight_bytes(&[9, 2, 3], 2), 4 * (33 * 8 + (2 * 8 + 1) * 4));
    }
}
