//! VGG-19 up to relu3_1, from weights to an ONNX graph.
//!
//! Three layouts of weights are known, told apart by the names of their tensors. They differ in more than names: an
//! encoder is only the same one with the padding and pooling it was made for.
//!
//! | layout | tensors | input | padding | pooling |
//! | --- | --- | --- | --- | --- |
//! | [`Layout::Normalized`] | `conv1_1.weight` ... `conv3_1.weight` | `conv1_1_rgb01`, or `conv0` before `conv1_1` | reflection | ceil |
//! | [`Layout::Torchvision`] | `features.0.weight` ... `features.10.weight` | ImageNet mean and deviation | zero | floor |
//! | [`Layout::Distilled`] | a quarter of the channels, and `conv3_1_aux` | `conv0` before `conv1_1` | reflection | floor |

use crate::{
    onnx::{ChainWriter, Convolution},
    weights::{Weights, WeightsError},
};

/// Channels at relu3_1.
pub const N_CHANNELS: usize = 256;

/// Mean and standard deviation of ImageNet's RGB 0..1, as torchvision's models expect their input normalized.
const IMAGENET_MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const IMAGENET_STD_DEV: [f32; 3] = [0.229, 0.224, 0.225];

/// Which family a weights file belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// The rescaled Caffe weights of AdaIN and WCT, whose mean activations are about 1.
    Normalized,
    /// torchvision's VGG-19, which the original StyleGaussian uses.
    Torchvision,
    /// Collaborative Distillation's VGG-19 of a quarter of the channels, with a 1x1 convolution up to 256 at the end.
    Distilled,
}

impl Layout {
    /// Tells the layout by the tensors' names; `None` when it is none of the known ones.
    pub fn of(weights: &Weights) -> Option<Self> {
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

    /// Names of the five 3x3 convolutions.
    fn names(self) -> [&'static str; 5] {
        match self {
            Self::Torchvision => ["features.0", "features.2", "features.5", "features.7", "features.10"],
            Self::Normalized | Self::Distilled => ["conv1_1", "conv1_2", "conv2_1", "conv2_2", "conv3_1"],
        }
    }

    /// Channels before, between and after the five 3x3 convolutions.
    fn channels(self) -> [usize; 6] {
        match self {
            Self::Normalized | Self::Torchvision => [3, 64, 64, 128, 128, N_CHANNELS],
            Self::Distilled => [3, 16, 16, 32, 32, 64],
        }
    }
}

/// The ONNX graph of an encoder: RGB 0..1 `[1, 3, H, W]` to relu3_1 `[1, 256, h, w]`, a quarter of the size.
///
/// # Errors
/// When a tensor is missing or is not what the layout needs; a file of no known layout misses `conv1_1.weight`.
pub fn graph(weights: &Weights) -> Result<Vec<u8>, WeightsError> {
    let layout =
        Layout::of(weights).ok_or_else(|| weights.missing("conv1_1.weight` or `features.0.weight"))?;
    if layout == Layout::Torchvision && weights.contains("features.17.weight") {
        // Same first layers, other numbers: in VGG-19 the 17th module is a ReLU, in VGG-16 it is conv4_1.
        return Err(
            weights.missing("features.16.weight` (this is VGG-16; VGG-19 is needed): `features.19.weight")
        );
    }
    let mut chain = ChainWriter::new(3);
    let mut names = layout.names();
    if weights.contains("conv1_1_rgb01.weight") {
        names[0] = "conv1_1_rgb01";
    } else {
        chain = chain.convolution(&input_transform(weights, layout)?, 0);
    }
    let channels = layout.channels();
    for (layer, name) in names.into_iter().enumerate() {
        let convolution = weights.convolution(name, [channels[layer + 1], channels[layer], 3, 3])?;
        chain = match layout {
            Layout::Torchvision => chain.convolution(&convolution, 1),
            Layout::Normalized | Layout::Distilled => chain.reflect().convolution(&convolution, 0),
        };
        chain = chain.relu();
        if layer == 1 || layer == 3 {
            chain = chain.max_pool(layout == Layout::Normalized);
        }
    }
    if layout == Layout::Distilled {
        let up = weights.convolution("conv3_1_aux", [N_CHANNELS, channels[5], 1, 1])?;
        chain = chain.convolution(&up, 0).relu();
    }
    Ok(chain.finish())
}

/// From RGB 0..1 to what conv1_1 expects.
fn input_transform(weights: &Weights, layout: Layout) -> Result<Convolution, WeightsError> {
    match layout {
        Layout::Torchvision => Ok(imagenet_input()),
        Layout::Normalized | Layout::Distilled => weights.convolution("conv0", [3, 3, 1, 1]),
    }
}

/// From RGB 0..1 to what torchvision's models expect, as a 1x1 convolution `[3, 3, 1, 1]`.
///
/// It is not folded into conv1_1, which pads with zeros *after* normalizing, the mean color and not black: a folded
/// convolution would differ along the borders.
pub fn imagenet_input() -> Convolution {
    let mut weight = vec![0.0; 9];
    let mut bias = vec![0.0; 3];
    for channel in 0..3 {
        weight[channel * 4] = 1.0 / IMAGENET_STD_DEV[channel];
        bias[channel] = -IMAGENET_MEAN[channel] / IMAGENET_STD_DEV[channel];
    }
    Convolution { shape: [3, 3, 1, 1], weight, bias }
}
