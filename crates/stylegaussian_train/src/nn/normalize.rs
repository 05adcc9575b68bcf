//! Scaling of a network of convolutions and ReLUs so that every channel has mean 1. The scaled network
//! distinguishes the same inputs: ReLU(s x) = s ReLU(x) for s > 0, and the next layer divides by s again.

use std::{path::Path, sync::Arc};

use burn::tensor::{Device, Tensor, TensorData};
use image::{DynamicImage, RgbImage};
use stylegaussian_encoder::{
    Image,
    chain::Kernel,
    vgg::{CONVOLUTIONS, VggConvolution},
};

use super::{
    loss_network::{behind, kernel},
    ops::{Windows, max_pool, windows_conv_relu},
    parameter::to_vec,
};
use crate::{error::TrainError, images::list_images};

/// Width and height to which images are resized, in pixels. relu4_1 has an eighth of it.
const SIDE: u32 = 256;

/// A channel with a smaller mean is dead and is not scaled.
const LEAST_MEAN: f32 = 1e-6;

/// Scales the convolutions of [`read_torchvision`](super::vgg::read_torchvision) so that over the images in
/// `folder` the mean of every channel is 1. The first one, which maps RGB 0..1 to VGG's input, is left as it
/// is.
///
/// # Errors
/// If the folder holds no image or one cannot be read.
pub fn normalize(convolutions: &mut [(&str, Kernel)], folder: &Path) -> Result<(), TrainError> {
    let device = Device::flex();
    let mut pictures =
        list_images(folder)?.iter().map(|path| open(path, &device)).collect::<Result<Vec<_>, _>>()?;
    let Some((input, rest)) = convolutions.split_first_mut() else { return Ok(()) };
    let mut size = [SIDE as usize; 2];
    let mut means: Vec<f32> = Vec::new();
    for (i, ((_, convolution), VggConvolution { pools_before, .. })) in
        rest.iter_mut().zip(CONVOLUTIONS).enumerate()
    {
        if pools_before {
            pictures = pictures.into_iter().map(|x| max_pool(x, size)).collect();
            size = size.map(|side| side.div_ceil(2));
        }
        // The pictures are scaled already, so this layer must first take them as they are now. Biases add to
        // sums over inputs and need no change.
        multiply_inputs(convolution, &means);
        // The first convolution sees pictures through conv0, which keeps its own place in the file.
        let seen = if i == 0 { behind(&input.1, convolution.clone()) } else { convolution.clone() };
        let (weight, bias) = kernel(&seen, &device);
        let windows = Arc::new(Windows::of_pictures(size, 1, 3, 1));
        let conv = |x| windows_conv_relu(x, weight.clone(), bias.clone(), &windows);
        pictures = pictures.into_iter().map(conv).collect();
        means = mean_of_channels(&pictures)?;
        divide_outputs(convolution, &means);
        // Dividing the features gives the scaled layer's result, without another convolution.
        let inverse: Vec<f32> = means.iter().map(|mean| 1.0 / mean).collect();
        let inverse = Tensor::<1>::from_data(TensorData::from(&inverse[..]), &device).unsqueeze::<2>();
        pictures = pictures.into_iter().map(|x| x * inverse.clone()).collect();
    }
    Ok(())
}

/// Rows of pixels `[SIDE * SIDE, 3]`, RGB 0..1.
fn open(path: &Path, device: &Device) -> Result<Tensor<2>, TrainError> {
    let image = DynamicImage::from(RgbImage::from(&Image::open(path)?));
    let image = image.resize_exact(SIDE, SIDE, image::imageops::FilterType::Triangle).into_rgb32f();
    Ok(Tensor::from_data(TensorData::new(image.into_raw(), [(SIDE * SIDE) as usize, 3]), device))
}

/// The mean of each channel over all pixels of all pictures, or 1 if the channel is dead.
fn mean_of_channels(pictures: &[Tensor<2>]) -> Result<Vec<f32>, TrainError> {
    let share = 1.0 / pictures.len() as f32;
    let mut means: Vec<f32> = Vec::new();
    for picture in pictures {
        let found = to_vec(&picture.clone().mean_dim(0))?;
        means.resize(found.len(), 0.0);
        means.iter_mut().zip(found).for_each(|(mean, found)| *mean += share * found);
    }
    Ok(means.into_iter().map(|mean| if mean < LEAST_MEAN { 1.0 } else { mean }).collect())
}

/// Undoes the division of the layer before.
fn multiply_inputs(convolution: &mut Kernel, factors: &[f32]) {
    let [_, d_in, height, width] = convolution.shape;
    for (i, plane) in convolution.weight.chunks_exact_mut(height * width).enumerate() {
        let factor = factors.get(i % d_in).copied().unwrap_or(1.0);
        plane.iter_mut().for_each(|weight| *weight *= factor);
    }
}

fn divide_outputs(convolution: &mut Kernel, divisors: &[f32]) {
    let n = convolution.weight.len() / divisors.len();
    for (weights, divisor) in convolution.weight.chunks_exact_mut(n).zip(divisors) {
        weights.iter_mut().for_each(|weight| *weight /= divisor);
    }
    convolution.bias.iter_mut().zip(divisors).for_each(|(bias, divisor)| *bias /= divisor);
}
