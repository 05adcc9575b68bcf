//! The decoder: a CNN over neighborhoods, each Gaussian's K nearest neighbors in place of a window of pixels.

mod activation;
mod knn_conv;
pub mod product;

pub use activation::{Activation, ActivationError};
pub use knn_conv::{
    KnnConvShape, ReverseNeighbors, knn_conv, knn_conv_backward_input, knn_conv_backward_weight,
};

use rayon::prelude::*;

use crate::{
    encoder_id::EncoderId,
    neighbors::Neighbors,
    work::{Canceled, Work},
};
use knn_conv::knn_conv_if_wanted;

/// One KNN convolution: y_p = sum_k W_k x_{n(p,k)} + B.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// W `[D_out, K, D_in]`, row-major.
    pub weight: Vec<f32>,
    /// B `[D_out]`.
    pub bias: Vec<f32>,
    /// D_in, the number of input channels.
    pub d_in: usize,
    /// D_out, the number of output channels.
    pub d_out: usize,
}

/// KNN convolutions with an activation between them, from D + E input channels to RGB.
///
/// The default has no layers, the paper's K and activation, and none of the options that the paper's decoder
/// lacks.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoder {
    /// The layers, first to last.
    pub layers: Vec<Layer>,
    /// K, the size of every neighborhood, the Gaussian itself included.
    pub k: usize,
    /// The activation between layers. There is none after the last.
    pub activation: Activation,
    /// Factor of the base color (SH 0) that is added to the output. At 0 the layers give the color itself, at 1
    /// an offset from the base color. Between them a share of the captured scene shows through.
    pub residual: f32,
    /// Number of noise inputs of the first layer, after the scene's features and extra inputs. Each is one
    /// number per Gaussian that is always the same (see [`noise`](crate::noise)). Features are smooth and
    /// paintings are not, so a decoder needs noise to make strokes.
    pub n_noise: usize,
    /// If true, the last three inputs of the first layer are the base color (SH 0), as
    /// [`BASE_COLOR_SCALE`](Self::BASE_COLOR_SCALE) (c - 0.5). Features are blurred over the cells of a feature
    /// map, and base colors keep the detail.
    pub base_color: bool,
    /// S `[D_out of the first layer, 2 D]`, or empty. S (mean, std) of the transferred features is added to the
    /// first layer's bias, so every color depends on the style as a whole and not on its neighborhood alone. A
    /// change of style costs one more product of a matrix and a vector, and a Gaussian costs nothing.
    pub statistics_weight: Vec<f32>,
    /// Number of smoothing passes over the decoded colors ([`smoothing_pass`]). If neighbors differ in color,
    /// so do views, since each view blends the same Gaussians with other weights. Smoothing makes views
    /// consistent.
    pub smoothing_passes: usize,
    /// The encoder of its input features, or `None` if the file does not name it.
    pub encoder: Option<EncoderId>,
}

impl Default for Decoder {
    fn default() -> Self {
        Self {
            layers: Vec::new(),
            k: Self::K,
            activation: Activation::Sigmoid,
            residual: 0.0,
            n_noise: 0,
            base_color: false,
            statistics_weight: Vec::new(),
            smoothing_passes: 0,
            encoder: None,
        }
    }
}

impl Decoder {
    /// K of the paper's decoder and of the default one: each Gaussian and its 7 nearest neighbors.
    pub const K: usize = 8;

    /// The largest K. Lists of as many neighbors take a kibibyte per Gaussian.
    pub const MAX_K: usize = 256;

    /// The paper's layer widths from D = 256 input channels (plus E extra ones) to RGB.
    pub const WIDTHS: [usize; 5] = [256, 128, 64, 32, 3];

    /// Factor that brings base colors, which deviate from mid-gray by about a quarter, to the deviation of
    /// about 1 of the other inputs.
    pub const BASE_COLOR_SCALE: f32 = 4.0;

    /// Number of procedural inputs, which no scene file holds: noise and the base color.
    pub fn n_procedural(&self) -> usize {
        self.n_noise.saturating_add(if self.base_color { 3 } else { 0 })
    }

    /// Number of neighborhoods through which a color depends on other Gaussians: one per layer and one per
    /// smoothing pass.
    pub fn n_neighborhoods(&self) -> usize {
        self.layers.len() + self.smoothing_passes
    }

    /// Number of inputs of the first layer, D + E and the procedural ones; 0 if there are no layers.
    pub fn n_inputs(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.d_in)
    }
}

impl Layer {
    /// The convolution's shape at K neighbors.
    pub fn shape(&self, k: usize) -> KnnConvShape {
        KnnConvShape { k, d_in: self.d_in, d_out: self.d_out }
    }
}

/// Runs layers over x `[N, D_in of the first]`, with the activation between them and none after the last.
/// Returns `[N, D_out of the last]`.
///
/// Holds the outputs of two consecutive layers at a time, and nothing of width K.
///
/// # Errors
/// If `work` is canceled.
///
/// # Panics
/// If the layers do not chain or the neighbors are not N lists.
pub fn run_layers(
    layers: &[&Layer],
    activation: Activation,
    neighbors: &Neighbors,
    mut x: Vec<f32>,
    work: &Work,
) -> Result<Vec<f32>, Canceled> {
    for (i, layer) in layers.iter().enumerate() {
        let shape = layer.shape(neighbors.k);
        let is_last = i + 1 == layers.len();
        // The activation runs block by block within the convolution, while the block is in the cache.
        let activate = |y: &mut [f32]| {
            if !is_last {
                activation.apply(y);
            }
        };
        let given: [&[f32]; 3] = [&x, &layer.weight, &layer.bias];
        x = knn_conv_if_wanted(shape, given, &neighbors.indices, activate, work);
        // The result of a canceled layer is not whole.
        work.at((i + 1) as f32 / layers.len() as f32)?;
    }
    Ok(x)
}

/// One smoothing pass: the mean color of each Gaussian's neighborhood `[N]`.
pub fn smoothing_pass(colors: &[[f32; 3]], neighbors: &Neighbors) -> Vec<[f32; 3]> {
    // K = 0 has no chunks to divide into, and chunks of no values panic.
    let share = 1.0 / neighbors.k.max(1) as f32;
    let mean = |neighborhood: &[u32]| {
        let mut sum = [0.0; 3];
        for &neighbor in neighborhood {
            sum.iter_mut().zip(colors[neighbor as usize]).for_each(|(sum, channel)| *sum += channel);
        }
        sum.map(|channel| channel * share)
    };
    neighbors.indices.par_chunks_exact(neighbors.k.max(1)).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, OnceLock};

    use super::*;

    #[test]
    fn layers_that_nobody_waits_for_are_not_run() {
        // Each Gaussian alone, doubled and doubled again.
        let layer = Layer { weight: vec![2.0], bias: vec![0.0], d_in: 1, d_out: 1 };
        let neighbors = Neighbors { k: 1, indices: (0..4).collect() };
        let run = |work: &Work| {
            let activation = Activation::LeakyRelu { slope: 1.0 };
            run_layers(&[&layer, &layer], activation, &neighbors, vec![1.0, 2.0, 3.0, 4.0], work)
        };
        assert_eq!(run(&Work::default()), Ok(vec![4.0, 8.0, 12.0, 16.0]));
        let own = Arc::new(OnceLock::<Work>::new());
        let known = Arc::clone(&own);
        let work = own.get_or_init(|| Work::telling(move |_| known.get().unwrap().cancel()));
        assert_eq!(run(work), Err(Canceled));
        assert_eq!(work.done(), 0.5);
    }
}
