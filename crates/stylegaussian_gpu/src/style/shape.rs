//! The shape of a decoder on a scene: the numbers that buffers and dispatches follow from.

use stylegaussian::{
    Decoder, Scene,
    fold::{self, StylizeError},
};

use crate::colors::GaussianColors;

/// The shape of a decoder on a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct StyleShape {
    /// N.
    pub n_gaussians: usize,
    /// K.
    pub k: usize,
    /// Inputs of the first layer, L + E, then outputs of each layer; the last ones are 3.
    pub widths: Vec<usize>,
    /// Whether base colors are added.
    pub residual: bool,
    /// Smoothing passes behind the layers.
    pub smoothing_passes: usize,
}

impl StyleShape {
    /// The shape of `decoder` on `scene`.
    ///
    /// # Errors
    /// If there are no features, or if the decoder does not fit them.
    pub fn of(scene: &Scene, decoder: &Decoder) -> Result<Self, StylizeError> {
        let features = fold::check_decoder(scene, decoder)?;
        let n_inputs = features.n_latent + features.n_extra + decoder.n_procedural();
        let outputs = decoder.layers.iter().map(|layer| layer.d_out);
        Ok(Self {
            n_gaussians: scene.len(),
            k: decoder.k,
            widths: std::iter::once(n_inputs).chain(outputs).collect(),
            residual: decoder.residual != 0.0,
            smoothing_passes: decoder.smoothing_passes,
        })
    }

    /// The number of layers.
    pub fn n_layers(&self) -> usize {
        self.widths.len() - 1
    }

    /// Width of the first (0) or second (1) scratch buffer. Hidden layers write to them in turns, so it is the
    /// largest width of every second hidden layer.
    pub fn scratch_width(&self, which: usize) -> usize {
        let hidden = &self.widths[1..self.widths.len() - 1];
        hidden.iter().skip(which).step_by(2).copied().max().unwrap_or(0)
    }

    /// Bytes of the base colors: 4 f16 for each Gaussian, if they are added.
    pub fn base_color_bytes(&self) -> u64 {
        if self.residual { 8 * self.n_gaussians as u64 } else { 0 }
    }

    /// Bytes of the colors between smoothing passes, if there are any.
    pub fn color_bytes(&self) -> u64 {
        if self.smoothing_passes > 0 { GaussianColors::bytes(self.n_gaussians) } else { 0 }
    }
}
