//! A 2D decoder from relu3_1 features back to an image, for the 2D baseline.
//!
//! The reconstruction decoder of "Universal Style Transfer via Feature Transforms" (Li et al. 2017) mirrors
//! VGG-19 from relu3_1 down: it was trained to invert the features, and with transferred features it paints the
//! style.

use std::path::Path;

use stylegaussian_encoder::{
    FeatureMap, Image,
    chain::{Chain, Convolution, Operation, Padding, Size},
    weights::Weights,
};

use crate::error::{TrainError, ensure};

/// Channels of relu3_1.
const N_CHANNELS: usize = 256;

/// The layers in order: name, channels out, channels in, and whether the image doubles after it.
const LAYERS: [(&str, usize, usize, bool); 5] = [
    ("conv3_1", 128, N_CHANNELS, true),
    ("conv2_2", 128, 128, false),
    ("conv2_1", 64, 128, true),
    ("conv1_2", 64, 64, false),
    ("conv1_1", 3, 64, false),
];

/// A 2D decoder. Can be shared by reference between threads.
pub struct ImageDecoder {
    chain: Chain,
}

impl ImageDecoder {
    /// Opens weights (`conv3_1.weight` ... `conv1_1.bias`, f32) as safetensors or a PyTorch state dict.
    ///
    /// # Errors
    /// If the file cannot be read, or a tensor is missing, has another shape or is not finite.
    pub fn open(path: &Path) -> Result<Self, TrainError> {
        let weights = Weights::open(path)?;
        let mut operations = Vec::new();
        for (layer, (name, outputs, inputs, doubles)) in LAYERS.into_iter().enumerate() {
            let kernel = weights.kernel(name, [outputs, inputs, 3, 3])?;
            let convolution = Convolution::new(&kernel, Padding::Reflect([1, 1]))
                .map_err(|found| TrainError::Invalid(format!("{}: `{name}` is {found}", path.display())))?;
            // The last layer gives colors, which a ReLU would cut at 0 and leave open above. `decode` clamps
            // both.
            let is_last = layer + 1 == LAYERS.len();
            operations.push(Operation::Convolution(if is_last {
                convolution
            } else {
                convolution.rectified()
            }));
            if doubles {
                operations.push(Operation::Double);
            }
        }
        Ok(Self { chain: Chain::new(N_CHANNELS, operations)? })
    }

    /// The image of features: four times as wide and high, clamped to 0..1.
    ///
    /// # Errors
    /// If the features are not 256 channels of at least 2x2 cells: the padding reflects.
    pub fn decode(&self, features: &FeatureMap) -> Result<Image, TrainError> {
        let (width, height) = (features.width, features.height);
        ensure!(
            features.n_channels == N_CHANNELS && width >= 2 && height >= 2,
            "the 2D decoder takes {N_CHANNELS} channels of at least 2x2 cells, found {} of {width}x{height}",
            features.n_channels
        );
        let sizes = self.chain.sizes(Size { width: width as usize, height: height as usize });
        let mut rgb = self.chain.output(&sizes, features.values.clone());
        rgb.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        let Size { width, height } = sizes[self.chain.last()];
        Ok(Image { width: width as u32, height: height as u32, rgb, alpha: None })
    }
}
