//! The part of a scene that folding needs, computed once.

use std::future::Future;

use stylegaussian::{
    ChannelStatistics, Features,
    fold::{self, ChannelMap, StylizeError},
    statistics::{ContentStatistics, mean_latent},
};

/// The part of a scene that a change of style needs on the CPU: its basis and statistics, and nothing for each
/// Gaussian. The statistics cost a pass over the features and are therefore computed once. Every change is then
/// [`transfer`](Self::transfer) and [`FoldedLayers::new`](super::FoldedLayers::new), which cost the same for
/// any number of Gaussians.
#[derive(Clone, Debug)]
pub struct ContentFold {
    /// Basis, offset and encoder, without rows. `n_extra` counts the decoder's procedural inputs, too.
    pub(super) basis: Features,
    /// mean(f') `[L]`.
    pub(super) mean_latent: Vec<f64>,
    pub(super) statistics: ContentStatistics,
    /// The factors of the stored inputs `[L + E]`.
    pub(super) input_scales: Vec<f32>,
}

impl ContentFold {
    /// The fold of `inputs`, which are the scene's features and the decoder's procedural inputs
    /// ([`fold::inputs_of`]). `input_scales` are the factors that their centered values are stored with.
    pub(super) async fn new<P: Future<Output = ()>>(
        inputs: &Features,
        mean_latent: Vec<f64>,
        input_scales: Vec<f32>,
        pause: &mut impl FnMut() -> P,
    ) -> Self {
        let basis = Features {
            values: Vec::new(),
            extra: Vec::new(),
            basis: inputs.basis.clone(),
            offset: inputs.offset.clone(),
            encoder: inputs.encoder.clone(),
            ..*inputs
        };
        let statistics = ContentStatistics::of_in_slices(inputs, pause).await;
        Self { basis, mean_latent, statistics, input_scales }
    }

    /// The channel map of a mix of styles: c f + (1 - c) sum_j w_j AdaIN_j.
    ///
    /// # Errors
    /// If there is no style, if weights or content are out of range, or if channels or encoders differ.
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

/// mean(f') of the inputs in f64, and their centered values `[N, L + E]`.
pub(super) async fn centered<P: Future<Output = ()>>(
    inputs: &Features,
    pause: &mut impl FnMut() -> P,
) -> (Vec<f64>, Vec<f32>) {
    let mean = mean_latent(inputs);
    let values = fold::centered_inputs_in_slices(inputs, &mean, pause).await;
    (mean, values)
}
