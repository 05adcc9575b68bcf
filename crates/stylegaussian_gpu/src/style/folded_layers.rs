//! The layers of a decoder, folded for one scene and one style.

use stylegaussian::{
    Activation, Decoder, Layer,
    fold::{self, ChannelMap, StylizeError},
};

use super::content::ContentFold;

/// A decoder with its first layer folded for one scene and one style. The GPU runs these layers.
#[derive(Clone, Debug)]
pub struct FoldedLayers {
    pub(super) layers: Vec<Layer>,
    pub(super) k: usize,
    pub(super) activation: Activation,
    pub(super) residual: f32,
    /// Smoothing passes behind the layers.
    pub(super) smoothing_passes: usize,
}

impl FoldedLayers {
    /// Folds the basis, the offset, `map` and the decoder's view of the style's statistics into its first
    /// layer.
    ///
    /// # Errors
    /// If the map or the decoder has other channels than the scene.
    pub fn new(content: &ContentFold, decoder: &Decoder, map: &ChannelMap) -> Result<Self, StylizeError> {
        let (n_channels, n_extra) = (content.basis.n_channels(), content.basis.n_extra);
        if decoder.n_inputs() != n_channels + n_extra {
            let (found, expected) = (decoder.n_inputs(), n_channels + n_extra);
            return Err(StylizeError::DecoderChannels { found, expected });
        }
        if map.gain.len() != n_channels || map.shift.len() != n_channels {
            return Err(StylizeError::StyleChannels { found: map.gain.len(), expected: n_channels });
        }
        let mut first =
            fold::fold_layer(&decoder.layers[0], decoder.k, &content.basis, map, &content.mean_latent);
        fold::fold_statistics(&mut first, decoder, map, &content.statistics);
        // Inputs are stored times their scale, so the weights are divided by it.
        for row in first.weight.chunks_exact_mut(first.d_in) {
            row.iter_mut().zip(&content.input_scales).for_each(|(weight, scale)| *weight /= scale);
        }
        let layers = std::iter::once(first).chain(decoder.layers[1..].iter().cloned());
        Ok(Self {
            layers: layers.collect(),
            k: decoder.k,
            activation: decoder.activation,
            residual: decoder.residual,
            smoothing_passes: decoder.smoothing_passes,
        })
    }
}
