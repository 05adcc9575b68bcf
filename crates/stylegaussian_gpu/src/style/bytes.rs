//! Memory that styling a scene takes.

use stylegaussian::{Decoder, Scene, fold::StylizeError};

use super::{
    blocks::Blocks,
    options::{StyleOptions, activation_bytes},
    planes::Planes,
    shape::StyleShape,
    weights::weight_bytes,
};

/// Memory of a scene and a decoder on the GPU, in bytes, known before it is allocated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StyleBytes {
    /// Inputs of the first layer, and base colors if the decoder is residual.
    pub features: u64,
    /// Neighbor lists.
    pub neighbors: u64,
    /// Activations between layers and colors between smoothing passes. They can be released after a change of
    /// style.
    pub activations: u64,
    /// Weights of the decoder.
    pub weights: u64,
}

impl StyleBytes {
    /// Memory of `scene`, decoded with `options`. Finds neighbors if the scene has none and does not fit one
    /// block.
    ///
    /// # Errors
    /// If the scene has no features, or if the decoder does not fit them.
    pub fn of(scene: &Scene, decoder: &Decoder, options: &StyleOptions) -> Result<Self, StylizeError> {
        let shape = StyleShape::of(scene, decoder)?;
        let n = shape.n_gaussians;
        let (capacity, neighbors) = if n <= options.max_rows(&shape) {
            (n, 4 * (shape.k * n) as u64)
        } else {
            let blocks = Blocks::of_scene(scene, &shape, options);
            (blocks.capacity, blocks.bytes(shape.k))
        };
        let inputs = Planes::bytes(shape.widths[0], n, options.precision.input_format());
        Ok(Self {
            features: inputs + shape.base_color_bytes(),
            neighbors,
            activations: activation_bytes(&shape, capacity, options.precision) + shape.color_bytes(),
            weights: weight_bytes(&shape.widths, shape.k),
        })
    }

    /// The sum of all parts.
    pub fn total(&self) -> u64 {
        self.features + self.neighbors + self.activations + self.weights
    }
}
