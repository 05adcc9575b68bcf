//! VGG-19's weights up to conv4_1: reading torchvision's files and writing ours.

use std::path::Path;

use safetensors::{Dtype, tensor::TensorView};
use stylegaussian_encoder::{
    chain::Kernel,
    vgg::{CONVOLUTIONS, VggConvolution, imagenet_input},
    weights::Weights,
};
use stylegaussian_files::write_atomically;

use crate::error::TrainError;

/// Reads torchvision's VGG-19 up to conv4_1 under the names of [`CONVOLUTIONS`]. The first convolution,
/// `conv0`, is the 1x1 one that takes RGB 0..1 to the input that VGG-19 expects.
///
/// # Errors
/// If the file cannot be read or a tensor is missing or has another shape.
pub fn read_torchvision(path: &Path) -> Result<Vec<(&'static str, Kernel)>, TrainError> {
    let weights = Weights::open(path)?;
    let mut convolutions = vec![("conv0", imagenet_input())];
    let mut d_in = 3;
    for VggConvolution { name, module, n_channels, .. } in CONVOLUTIONS {
        let convolution = weights.kernel(&format!("features.{module}"), [n_channels, d_in, 3, 3])?;
        convolutions.push((name, convolution));
        d_in = n_channels;
    }
    Ok(convolutions)
}

/// Writes convolutions as safetensors, as `NAME.weight` and `NAME.bias`.
///
/// # Errors
/// If the file cannot be written.
pub fn write_weights(path: &Path, convolutions: &[(&str, Kernel)]) -> Result<(), TrainError> {
    let mut views = Vec::new();
    for (name, Kernel { shape, weight, bias }) in convolutions {
        let view = |values, shape| TensorView::new(Dtype::F32, shape, bytemuck::cast_slice(values));
        views.push((format!("{name}.weight"), view(weight, shape.to_vec())?));
        views.push((format!("{name}.bias"), view(bias, vec![shape[0]])?));
    }
    let bytes = safetensors::serialize(views, None)?;
    Ok(write_atomically(path, |out| out.write_all(&bytes))?)
}
