//! The loss network: pictures in, features of several depths out, gradients back.

mod bank;

use std::path::Path;

use rayon::prelude::*;
use stylegaussian::work::{Canceled, Work};
pub(crate) use stylegaussian_encoder::chain::Size;
use stylegaussian_encoder::{
    chain::{Chain, Operation, Values, add},
    vgg::{Layout, N_CONVOLUTIONS, Vgg},
    weights::Weights,
};

use crate::error::BakeError;

/// A value of a chain that the loss looks at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layer {
    chain: usize,
    /// The chain's value, and its channels.
    value: usize,
    pub channels: usize,
    /// Weight of its statistics.
    pub statistics: f32,
    /// Weight of matching its cells with the painting's; 0: they are not matched.
    pub matching: f32,
}

/// A value of a chain, and its weights in the loss: see [`Layer`].
#[derive(Clone, Copy)]
struct Tap {
    value: usize,
    statistics: f32,
    matching: f32,
}

/// A network that compares a picture with a painting.
pub struct LossNetwork {
    chains: Vec<Chain>,
    layers: Vec<Layer>,
}

/// The sizes of each chain's values on pictures of one size.
pub(crate) struct Sizes(Vec<Vec<Size>>);

/// The values of a network on one picture.
pub(crate) struct Features(Vec<Values>);

/// VGG-19's convolutions that the loss looks at: conv1_1, conv2_1 and conv3_1.
const VGG_CONVOLUTIONS: [usize; 3] = [0, 2, 4];

/// Number of sizes at which filters see a picture: full, half, quarter and eighth. The coarser ones see broad
/// strokes and areas.
const FILTER_SIZES: usize = 4;
/// Weight of the filters' statistics. Grain is at full size, where there is no other layer.
const FILTERS_WEIGHT: f32 = 2.0;

impl LossNetwork {
    /// VGG-19 at relu1_1, relu2_1 and relu3_1, from weights in any layout that the encoder takes but the
    /// distilled one.
    ///
    /// # Errors
    /// If the file cannot be read or holds other weights.
    pub fn vgg(path: &Path) -> Result<Self, BakeError> {
        let weights = Weights::open(path)?;
        if Layout::of(&weights) == Some(Layout::Distilled) {
            let found = "a quarter of VGG-19's channels".into();
            return Err(BakeError::Network { name: path.display().to_string(), found });
        }
        let Vgg { chain, values } = Vgg::read(&weights, N_CONVOLUTIONS)?;
        let layers = VGG_CONVOLUTIONS.map(|convolution| Tap {
            value: values[convolution],
            statistics: 1.0,
            // conv1_1 sees 3x3 pixels: too little of a stroke to match.
            matching: if convolution == 0 { 0.0 } else { 1.0 },
        });
        Ok(Self::new(vec![(chain, layers.to_vec())]))
    }

    /// The default network: the inner layers and the output of a distilled encoder beside fixed oriented
    /// filters at full size and down to an eighth, which the encoder lacks.
    ///
    /// `encoder` are the bytes of the encoder's file, `name` is its name in errors.
    ///
    /// # Errors
    /// If the bytes are no network that `stylegaussian distill` writes.
    pub fn distilled(name: &str, encoder: &[u8]) -> Result<Self, BakeError> {
        let invalid = |found| BakeError::Network { name: name.into(), found };
        let chain = Chain::from_bytes(encoder).map_err(invalid)?.chain;
        if chain.channels(0) != 3 {
            return Err(invalid(format!("{} channels of input", chain.channels(0))));
        }
        let layers =
            distilled_layers(&chain).ok_or_else(|| invalid("no layers at half and quarter size".into()))?;
        let filters = |chain: Chain| {
            let last = chain.last();
            (chain, vec![Tap { value: last, statistics: FILTERS_WEIGHT, matching: 0.0 }])
        };
        let mut chains = vec![(chain, layers)];
        chains.extend((0..FILTER_SIZES).map(|halvings| filters(bank::filters_after(halvings))));
        Ok(Self::new(chains))
    }

    fn new(chains: Vec<(Chain, Vec<Tap>)>) -> Self {
        let mut network = Self { chains: Vec::new(), layers: Vec::new() };
        for (chain, layers) in chains {
            let layers = layers.into_iter().map(|Tap { value, statistics, matching }| Layer {
                chain: network.chains.len(),
                value,
                channels: chain.channels(value),
                statistics,
                matching,
            });
            network.layers.extend(layers);
            network.chains.push(chain);
        }
        network
    }

    /// The layers that the loss looks at.
    pub(crate) fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// The sizes of all values on pictures of `size`.
    pub(crate) fn sizes(&self, size: Size) -> Sizes {
        Sizes(self.chains.iter().map(|chain| chain.sizes(size)).collect())
    }

    /// Features of a picture RGB 0..1 `[h * w, 3]`.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub(crate) fn forward(&self, sizes: &Sizes, rgb: &[f32], work: &Work) -> Result<Features, Canceled> {
        let chains = self.chains.par_iter().zip(&sizes.0);
        let features = chains.map(|(chain, sizes)| chain.forward_if_wanted(sizes, rgb, work));
        Ok(Features(features.collect::<Result<_, Canceled>>()?))
    }

    /// The gradient with respect to the picture `[h * w, 3]`, from one with respect to each layer's rows.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub(crate) fn backward(
        &self,
        sizes: &Sizes,
        features: &Features,
        grads: Vec<Vec<f32>>,
        work: &Work,
    ) -> Result<Vec<f32>, Canceled> {
        let mut of_chains: Vec<Vec<Option<Vec<f32>>>> =
            self.chains.iter().map(|chain| vec![None; chain.last() + 1]).collect();
        for (layer, grad) in self.layers.iter().zip(grads) {
            if !grad.is_empty() {
                of_chains[layer.chain][layer.value] = Some(grad);
            }
        }
        let chains = self.chains.par_iter().zip(&sizes.0).zip(&features.0).zip(of_chains);
        let of_chains = chains
            .map(|(((chain, sizes), values), grads)| chain.backward_if_wanted(sizes, values, grads, work));
        let of_chains: Vec<Option<Vec<f32>>> = of_chains.collect::<Result<_, Canceled>>()?;
        // In order, so that the sum is the same for any number of threads.
        let mut of_chains = of_chains.into_iter().flatten();
        let n_values = features.0.first().map_or(0, |values| values.rows(0).len());
        let mut grad_rgb = of_chains.next().unwrap_or_else(|| vec![0.0; n_values]);
        for grad in of_chains {
            add(&mut grad_rgb, &grad);
        }
        Ok(grad_rgb)
    }
}

impl Sizes {
    /// The size of a layer's picture.
    pub(crate) fn size(&self, layer: &Layer) -> Size {
        self.0[layer.chain][layer.value]
    }
}

impl Features {
    /// A layer's rows `[h * w, C]`.
    pub(crate) fn rows(&self, layer: &Layer) -> &[f32] {
        self.0[layer.chain].rows(layer.value)
    }
}

/// The layers of a distilled encoder: the first and the last value at half size, the last at quarter size
/// before the output, and the output.
fn distilled_layers(chain: &Chain) -> Option<Vec<Tap>> {
    let n = chain.last();
    let strided = |operation: &Operation| match operation {
        Operation::Convolution(convolution) => convolution.stride() == 2,
        Operation::MaxPool { .. } => true,
        Operation::Add(_) | Operation::BothSigns | Operation::Double => false,
    };
    let halvings: Vec<usize> = (0..n).filter(|&i| strided(&chain.operations()[i])).map(|i| i + 1).collect();
    let [half, quarter] = halvings[..] else { return None };
    (quarter > half && quarter + 1 < n).then(|| {
        // Matched are the last values of each size, which see most of the picture.
        let tap = |value, matching| Tap { value, statistics: 1.0, matching };
        vec![tap(half, 0.0), tap(quarter - 1, 1.0), tap(n - 1, 0.0), tap(n, 1.0)]
    })
}

#[cfg(test)]
mod tests;
