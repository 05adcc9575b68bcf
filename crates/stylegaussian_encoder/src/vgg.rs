//! VGG-19 up to relu3_1 or relu4_1, from weights to a chain.
//!
//! Three layouts of weights are known, recognized by the names of their tensors. They differ in more than
//! names: the same weights give other features with another padding or pooling than they were made for. `conv0`
//! comes before `conv1_1`.
//!
//! | layout | tensors | input | padding | pooling |
//! | --- | --- | --- | --- | --- |
//! | [`Layout::Normalized`] | `conv1_1.weight` and on | `conv1_1_rgb01`, or `conv0` | reflection | ceil |
//! | [`Layout::Torchvision`] | `features.0.weight` and on | ImageNet mean and deviation | zero | floor |
//! | [`Layout::Distilled`] | a quarter of the channels, and `conv3_1_aux` | `conv0` | reflection | floor |

use crate::{
    chain::{Chain, Convolution, Kernel, Operation, Padding},
    weights::{Weights, WeightsError},
};

/// Channels at relu3_1.
pub const N_CHANNELS: usize = CONVOLUTIONS[N_CONVOLUTIONS - 1].n_channels;

/// One of VGG-19's 3x3 convolutions, which a ReLU follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VggConvolution {
    /// Name in the paper's scheme, `conv{block}_{layer}`.
    pub name: &'static str,
    /// Index among torchvision's `features`, whose tensors are `features.{module}.weight` and `.bias`.
    pub module: usize,
    /// Output channels.
    pub n_channels: usize,
    /// Whether a 2x2 max-pool comes before it.
    pub pools_before: bool,
}

/// VGG-19 up to conv4_1, the deepest layer that anything here looks at.
pub const CONVOLUTIONS: [VggConvolution; 9] = {
    const fn layer(
        name: &'static str,
        module: usize,
        n_channels: usize,
        pools_before: bool,
    ) -> VggConvolution {
        VggConvolution { name, module, n_channels, pools_before }
    }
    [
        layer("conv1_1", 0, 64, false),
        layer("conv1_2", 2, 64, false),
        layer("conv2_1", 5, 128, true),
        layer("conv2_2", 7, 128, false),
        layer("conv3_1", 10, 256, true),
        layer("conv3_2", 12, 256, false),
        layer("conv3_3", 14, 256, false),
        layer("conv3_4", 16, 256, false),
        layer("conv4_1", 19, 512, true),
    ]
};

/// Number of [`CONVOLUTIONS`] in an encoder, which ends with conv3_1.
pub const N_CONVOLUTIONS: usize = 5;

/// The distilled network has a quarter of VGG's channels in every layer but the last.
const DISTILLED_SHARE: usize = 4;

/// Mean and standard deviation of ImageNet's RGB 0..1. torchvision's models expect input that these normalize.
const IMAGENET_MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const IMAGENET_STD_DEV: [f32; 3] = [0.229, 0.224, 0.225];

/// The family of a weights file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// The rescaled Caffe weights of AdaIN and WCT, with mean activations of about 1.
    Normalized,
    /// torchvision's VGG-19, which the original StyleGaussian uses.
    Torchvision,
    /// Collaborative Distillation's VGG-19 of a quarter of the channels, with a 1x1 convolution up to 256 at
    /// the end.
    Distilled,
}

impl Layout {
    /// Recognizes the layout by the tensors' names; `None` if it is unknown.
    pub fn of(weights: &Weights) -> Option<Self> {
        // The distilled layout first: it has the names of the normalized one as well.
        if weights.contains("conv3_1_aux.weight") {
            Some(Self::Distilled)
        } else if weights.contains("features.0.weight") {
            Some(Self::Torchvision)
        } else if weights.contains("conv1_1.weight") || weights.contains("conv1_1_rgb01.weight") {
            Some(Self::Normalized)
        } else {
            None
        }
    }

    /// Name of a convolution's tensors, without `.weight` and `.bias`.
    fn name(self, convolution: &VggConvolution) -> String {
        match self {
            Self::Torchvision => format!("features.{}", convolution.module),
            Self::Normalized | Self::Distilled => convolution.name.into(),
        }
    }

    /// Output channels of a 3x3 convolution.
    fn n_channels(self, convolution: &VggConvolution) -> usize {
        match self {
            Self::Normalized | Self::Torchvision => convolution.n_channels,
            Self::Distilled => convolution.n_channels / DISTILLED_SHARE,
        }
    }
}

/// VGG-19 as a chain, RGB 0..1 `[H * W, 3]` in.
pub struct Vgg {
    /// The chain. Its last value is that of the last convolution's ReLU; in the distilled layout, of the ReLU
    /// behind the 1x1 convolution that widens it.
    pub chain: Chain,
    /// The chain's value behind the ReLU of each of [`CONVOLUTIONS`].
    pub values: Vec<usize>,
}

/// The encoder, [`N_CONVOLUTIONS`] of VGG-19: RGB 0..1 to relu3_1, 256 channels at a quarter of the size.
///
/// # Errors
/// If a tensor is missing or has another shape than the layout needs. A file of unknown layout lacks
/// `conv1_1.weight`.
pub fn encoder(weights: &Weights) -> Result<Chain, WeightsError> {
    Ok(Vgg::read(weights, N_CONVOLUTIONS)?.chain)
}

impl Vgg {
    /// The first `n_convolutions` of [`CONVOLUTIONS`].
    ///
    /// # Errors
    /// As [`encoder`].
    pub fn read(weights: &Weights, n_convolutions: usize) -> Result<Self, WeightsError> {
        let layout =
            Layout::of(weights).ok_or_else(|| weights.missing("conv1_1.weight` or `features.0.weight"))?;
        if layout == Layout::Torchvision && weights.contains("features.17.weight") {
            // Same first layers, other numbers: in VGG-19 the 17th module is a ReLU, in VGG-16 it is conv4_1.
            return Err(weights
                .missing("features.16.weight` (this is VGG-16; VGG-19 is needed): `features.19.weight"));
        }
        let border = match layout {
            Layout::Torchvision => Padding::Zeros(1),
            Layout::Normalized | Layout::Distilled => Padding::Reflect([1, 1]),
        };
        let convolution = |name: &str, shape, border| {
            let convolution = Convolution::new(&weights.kernel(name, shape)?, border);
            let convolution =
                convolution.expect("a kernel read from weights has its shape and finite numbers");
            Ok::<_, WeightsError>(convolution)
        };
        let (mut operations, mut values) = (Vec::new(), Vec::new());
        // Some files have preprocessing folded into the first layer, under a name of its own.
        let folded_input = weights.contains("conv1_1_rgb01.weight").then_some("conv1_1_rgb01");
        if folded_input.is_none() {
            operations.push(Operation::Convolution(match layout {
                Layout::Torchvision => {
                    Convolution::new(&imagenet_input(), Padding::Zeros(0)).expect("it is finite")
                }
                Layout::Normalized | Layout::Distilled => {
                    convolution("conv0", [3, 3, 1, 1], Padding::Zeros(0))?
                }
            }));
        }
        let mut n_inputs = 3;
        let mut last = "";
        for (index, vgg) in CONVOLUTIONS.iter().take(n_convolutions).enumerate() {
            if vgg.pools_before {
                // AdaIN's Torch model pools with `ceil_mode`, torchvision and the distillation do not.
                operations.push(Operation::MaxPool { ceil: layout == Layout::Normalized });
            }
            let name = match folded_input {
                Some(name) if index == 0 => name.into(),
                _ => layout.name(vgg),
            };
            let n_outputs = layout.n_channels(vgg);
            let convolution = convolution(&name, [n_outputs, n_inputs, 3, 3], border)?;
            operations.push(Operation::Convolution(convolution.rectified()));
            values.push(operations.len());
            (n_inputs, last) = (n_outputs, vgg.name);
        }
        if layout == Layout::Distilled {
            let shape = [DISTILLED_SHARE * n_inputs, n_inputs, 1, 1];
            let up = convolution(&format!("{last}_aux"), shape, Padding::Zeros(0))?;
            operations.push(Operation::Convolution(up.rectified()));
        }
        let chain = Chain::new(3, operations)
            .map_err(|source| WeightsError::Chain { path: weights.path().into(), source })?;
        Ok(Self { chain, values })
    }
}

/// The 1x1 convolution `[3, 3, 1, 1]` from RGB 0..1 to the colors that torchvision's models expect.
///
/// It is not folded into conv1_1, which pads with zeros *after* normalizing, that is, with the mean color and
/// not with black. A folded convolution would differ along the borders.
pub fn imagenet_input() -> Kernel {
    let mut weight = vec![0.0; 9];
    let mut bias = vec![0.0; 3];
    for channel in 0..3 {
        weight[channel * 4] = 1.0 / IMAGENET_STD_DEV[channel];
        bias[channel] = -IMAGENET_MEAN[channel] / IMAGENET_STD_DEV[channel];
    }
    Kernel { shape: [3, 3, 1, 1], weight, bias }
}
