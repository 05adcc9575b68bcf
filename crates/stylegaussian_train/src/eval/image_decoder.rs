//! A 2D decoder from relu3_1 features back to an image, for the 2D baseline.
//!
//! The reconstruction decoder of "Universal Style Transfer via Feature Transforms" (Li et al. 2017) mirrors
//! VGG-19 from relu3_1 down: it was trained to invert the features, and with transferred features it paints the
//! style.

use std::path::Path;

use stylegaussian_encoder::{
    FeatureMap, Image,
    features::transposed,
    network::{Network, Planes},
    onnx::ChainWriter,
    weights::Weights,
};

use crate::error::{Context, TrainError, ensure};

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
    network: Network,
}

impl ImageDecoder {
    /// Opens weights (`conv3_1.weight` ... `conv1_1.bias`, f32) as safetensors or a PyTorch state dict.
    ///
    /// # Errors
    /// If the file cannot be read, a tensor is missing, has another shape or is not finite, or no engine runs
    /// it.
    pub fn open(path: &Path) -> Result<Self, TrainError> {
        let weights = Weights::open(path)?;
        let mut chain = ChainWriter::new(N_CHANNELS);
        for (layer, (name, outputs, inputs, doubles)) in LAYERS.into_iter().enumerate() {
            let convolution = weights.convolution(name, [outputs, inputs, 3, 3])?;
            chain = chain.reflect().convolution(&convolution, 0);
            // The last layer gives colors, which a ReLU would cut at 0 and leave open above. `decode` clamps
            // both.
            if layer + 1 < LAYERS.len() {
                chain = chain.relu();
            }
            if doubles {
                chain = chain.upsample();
            }
        }
        Ok(Self { network: Network::load(path.display().to_string(), chain.finish())? })
    }

    /// The image of features: four times as wide and high, clamped to 0..1.
    ///
    /// # Errors
    /// If the features are not 256 channels of at least 2x2 cells (the padding reflects), or the engine fails.
    pub fn decode(&self, features: &FeatureMap) -> Result<Image, TrainError> {
        let (width, height) = (features.width, features.height);
        ensure!(
            features.n_channels == N_CHANNELS && width >= 2 && height >= 2,
            "the 2D decoder takes {N_CHANNELS} channels of at least 2x2 cells, found {} of {width}x{height}",
            features.n_channels
        );
        let planes = self.network.run(&Planes::from(features)).context(|| "decoding features to an image")?;
        let mut rgb = transposed(&planes.values, 3, planes.width * planes.height);
        rgb.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        Ok(Image { width: planes.width as u32, height: planes.height as u32, rgb })
    }
}
