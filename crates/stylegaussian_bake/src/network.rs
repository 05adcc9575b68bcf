//! The loss network: pictures in, features of several depths out, gradients back.

mod bank;
pub(crate) mod chain;
mod convolution;
mod onnx;

use std::path::Path;

use rayon::prelude::*;
use stylegaussian_encoder::{vgg, weights::Weights};

use crate::error::BakeError;
use chain::{Chain, Operation, Values, add};
pub(crate) use convolution::Size;

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

/// Numbers of operations after which VGG-19's graphs reach relu1_1, relu2_1 and relu3_1, counted from the end:
/// conv3_1 is the last, conv2_1 three operations (conv2_2, max-pool, conv3_1) before it, conv1_1 six.
const VGG_FROM_THE_END: [usize; 3] = [6, 3, 0];

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
        let invalid = |found| BakeError::Network { name: path.display().to_string(), found };
        let chain = onnx::read(&vgg::graph(&Weights::open(path)?)?).map_err(invalid)?;
        let n = chain.operations.len();
        let is_pool = |i: usize| matches!(chain.operations[i], Operation::MaxPool { .. });
        let pools = (0..n).filter(|&i| is_pool(i)).count();
        if n < 7 || pools != 2 || !is_pool(n - 2) || !is_pool(n - 5) {
            return Err(invalid("another network than VGG-19 up to relu3_1".into()));
        }
        let layers = VGG_FROM_THE_END.map(|end| Tap {
            value: n - end,
            statistics: 1.0,
            matching: if end == 6 { 0.0 } else { 1.0 },
        });
        Ok(Self::new(vec![(chain, layers.to_vec())]))
    }

    /// The default network: the inner layers and the output of a distilled encoder beside fixed oriented
    /// filters at full size and down to an eighth, which the encoder lacks.
    ///
    /// `onnx` are the bytes of the encoder's file, `name` is its name in errors.
    ///
    /// # Errors
    /// If the bytes are no graph that `stylegaussian distill` writes.
    pub fn distilled(name: &str, onnx: &[u8]) -> Result<Self, BakeError> {
        let invalid = |found| BakeError::Network { name: name.into(), found };
        let chain = onnx::read(onnx).map_err(invalid)?;
        let layers =
            distilled_layers(&chain).ok_or_else(|| invalid("no layers at half and quarter size".into()))?;
        let filters = |chain: Chain| {
            let last = chain.operations.len();
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
    pub(crate) fn forward(&self, sizes: &Sizes, rgb: &[f32]) -> Features {
        let chains = self.chains.par_iter().zip(&sizes.0);
        Features(chains.map(|(chain, sizes)| chain.forward(sizes, rgb)).collect())
    }

    /// The gradient with respect to the picture `[h * w, 3]`, from one with respect to each layer's rows.
    pub(crate) fn backward(&self, sizes: &Sizes, features: &Features, grads: Vec<Vec<f32>>) -> Vec<f32> {
        let mut of_chains: Vec<Vec<Option<Vec<f32>>>> =
            self.chains.iter().map(|chain| vec![None; chain.operations.len() + 1]).collect();
        for (layer, grad) in self.layers.iter().zip(grads) {
            if !grad.is_empty() {
                of_chains[layer.chain][layer.value] = Some(grad);
            }
        }
        let chains = self.chains.par_iter().zip(&sizes.0).zip(&features.0).zip(of_chains);
        let of_chains: Vec<Option<Vec<f32>>> =
            chains.map(|(((chain, sizes), values), grads)| chain.backward(sizes, values, grads)).collect();
        // In order, so that the sum is the same for any number of threads.
        let mut of_chains = of_chains.into_iter().flatten();
        let n_values = features.0.first().map_or(0, |values| values.0[0].len());
        let mut grad_rgb = of_chains.next().unwrap_or_else(|| vec![0.0; n_values]);
        for grad in of_chains {
            add(&mut grad_rgb, &grad);
        }
        grad_rgb
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
        &self.0[layer.chain].0[layer.value]
    }
}

/// The layers of a distilled encoder: the first and the last value at half size, the last at quarter size
/// before the output, and the output.
fn distilled_layers(chain: &Chain) -> Option<Vec<Tap>> {
    let n = chain.operations.len();
    let strided = |operation: &Operation| match operation {
        Operation::Convolution(convolution) => convolution.stride == 2,
        Operation::MaxPool { .. } => true,
        Operation::Add(_) | Operation::BothSigns => false,
    };
    let halvings: Vec<usize> = (0..n).filter(|&i| strided(&chain.operations[i])).map(|i| i + 1).collect();
    let [half, quarter] = halvings[..] else { return None };
    (quarter > half && quarter + 1 < n).then(|| {
        // Matched are the last values of each size, which see most of the picture.
        let tap = |value, matching| Tap { value, statistics: 1.0, matching };
        vec![tap(half, 0.0), tap(quarter - 1, 1.0), tap(n - 1, 0.0), tap(n, 1.0)]
    })
}

#[cfg(test)]
mod tests;
