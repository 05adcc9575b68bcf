//! What folding needs of a scene, found once, and the layers folded for one style.

use stylegaussian::{
    Activation, ChannelStatistics, Decoder, Features, Layer, Scene,
    fold::{self, ChannelMap, StylizeError},
    statistics::{ContentStatistics, mean_latent},
};

/// The part of a scene that a change of style needs on the CPU: its basis and statistics, and nothing for each
/// Gaussian. The statistics cost a pass over the features, so they are found once, and every change is then
/// [`transfer`](Self::transfer) and [`FoldedLayers::new`], whose cost does not depend on the number of Gaussians.
#[derive(Clone, Debug)]
pub struct ContentFold {
    /// Basis, offset and encoder; without rows. `n_extra` counts what the decoder takes beside the scene's own.
    basis: Features,
    mean_latent: Vec<f64>,
    statistics: ContentStatistics,
    input_scales: Vec<f32>,
}

impl ContentFold {
    /// Of `inputs`, the scene's features with all that the decoder takes beside them
    /// ([`fold::inputs_of`]), and the scales that their centered values `[L + E]` are stored with.
    pub(super) fn new(inputs: &Features, mean_latent: Vec<f64>, input_scales: Vec<f32>) -> Self {
        let basis = Features {
            values: Vec::new(),
            extra: Vec::new(),
            basis: inputs.basis.clone(),
            offset: inputs.offset.clone(),
            encoder: inputs.encoder.clone(),
            ..*inputs
        };
        Self { basis, mean_latent, statistics: ContentStatistics::of(inputs), input_scales }
    }

    /// The channel map of a mix of styles: c f + (1 - c) sum_j w_j AdaIN_j.
    ///
    /// # Errors
    /// No style, weights or content out of range, channels or encoders that differ.
    pub fn transfer(
        &self,
        styles: &[(&ChannelStatistics, f64)],
        content: f64,
    ) -> Result<ChannelMap, StylizeError> {
        fold::transfer_from(&self.statistics, self.basis.encoder.as_ref(), styles, content)
    }

    /// Mean and standard deviation of the scene's features in the encoder's D channels.
    pub fn statistics(&self) -> &ContentStatistics {
        &self.statistics
    }
}

/// A decoder whose first layer is folded for one scene and one style: what the GPU runs.
#[derive(Clone, Debug)]
pub struct FoldedLayers {
    pub(super) layers: Vec<Layer>,
    pub(super) k: usize,
    pub(super) activation: Activation,
    pub(super) residual: f32,
    /// How many times colors are averaged behind the layers.
    pub(super) smoothing_passes: usize,
}

impl FoldedLayers {
    /// Folds the basis, the offset, `map` and the decoder's view of the style's statistics into its first layer.
    ///
    /// # Errors
    /// When the map or the decoder has other channels than the scene.
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
        // Inputs are stored times their scale.
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

/// The layers of a decoder run on a scene: what buffers and dispatches follow from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct StyleShape {
    /// N.
    pub n_gaussians: usize,
    /// K.
    pub k: usize,
    /// L + E, then the outputs of each layer, 3 in the end.
    pub widths: Vec<usize>,
    /// Whether the Gaussians' own colors are added.
    pub residual: bool,
    /// How many times colors are averaged behind the layers.
    pub smoothing_passes: usize,
}

impl StyleShape {
    /// Of `decoder` on `scene`.
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

    /// How many layers there are.
    pub fn n_layers(&self) -> usize {
        self.widths.len() - 1
    }

    /// The widest of the activations that are written to the first (0) or second (1) scratch buffer: hidden layers take
    /// turns.
    pub fn scratch_width(&self, which: usize) -> usize {
        let hidden = &self.widths[1..self.widths.len() - 1];
        hidden.iter().skip(which).step_by(2).copied().max().unwrap_or(0)
    }
}

/// mean(f') of the inputs in f64, and their centered values `[N, L + E]`.
pub(super) fn centered(inputs: &Features) -> (Vec<f64>, Vec<f32>) {
    let mean = mean_latent(inputs);
    let values = fold::centered_inputs(inputs, &mean);
    (mean, values)
}
