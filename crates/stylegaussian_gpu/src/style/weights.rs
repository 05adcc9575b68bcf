//! A folded decoder on the GPU.

use stylegaussian::{Activation, Layer};

use super::{
    content::FoldedLayers,
    features::PLANE_CHANNELS,
    planes::{largest_binding, n_planes},
    scene::StyleSceneError,
};

/// The weights of a folded decoder, f32: one buffer for each layer, `[K * planes * 8 + 1, columns]`, the bias last.
///
/// f32 and not f16, because a folded first layer multiplies the basis with gains of any size; 1.3 MB for the paper's
/// layers on 32 low channels.
#[derive(Debug)]
pub struct GpuDecoder {
    layers: Vec<wgpu::Buffer>,
    pub(super) k: usize,
    /// Inputs of the first layer, then the outputs of each.
    pub(super) widths: Vec<usize>,
    pub(super) activation: Activation,
    pub(super) residual: f32,
    pub(super) smoothing_passes: usize,
}

impl GpuDecoder {
    /// Uploads folded layers.
    ///
    /// # Errors
    /// When a layer is larger than the device can bind.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        folded: &FoldedLayers,
    ) -> Result<Self, StyleSceneError> {
        let limit = largest_binding(&device.limits());
        let mut layers = Vec::with_capacity(folded.layers.len());
        for (layer, is_last) in with_last(&folded.layers) {
            let size = 16 * (n_rows(layer, folded.k) * quads(layer, is_last)) as u64;
            if size > limit {
                return Err(StyleSceneError::TooLarge { what: "style_weights", found: size, limit });
            }
            layers.push(device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("style_weights"),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }));
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

    /// Replaces the weights by those of another style of the same decoder and scene; allocates nothing. `false`, and
    /// nothing done, where the layers have other shapes: make a new one then.
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
            queue.write_buffer(
                buffer,
                0,
                bytemuck::cast_slice(&packed(layer, folded.k, quads(layer, is_last))),
            );
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

/// vec4 in a row of weights: whole planes of a hidden layer, one color of the last.
pub(super) fn stride(d_out: usize, is_last: bool) -> usize {
    if is_last { 1 } else { n_planes(d_out) * 2 }
}

fn quads(layer: &Layer, is_last: bool) -> usize {
    stride(layer.d_out, is_last)
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

/// A layer's weight `[D_out, K, D_in]` and bias as rows of `quads` vec4: for each neighbor and each channel of the
/// input's planes all outputs, then the bias. What has no channel is 0.
fn packed(layer: &Layer, k: usize, quads: usize) -> Vec<f32> {
    let (columns, d_in) = (4 * quads, layer.d_in);
    let padded_in = n_planes(d_in) * PLANE_CHANNELS;
    let mut rows = vec![0.0; n_rows(layer, k) * columns];
    for (output, weight) in layer.weight.chunks_exact((k * d_in).max(1)).enumerate() {
        for (i, value) in weight.iter().enumerate() {
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
        // [D_out 2, K 2, D_in 9], each weight telling where it is.
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
