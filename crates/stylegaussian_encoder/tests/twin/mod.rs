#![allow(dead_code, reason = "each test binary uses a part of the twin")]
//! VGG up to relu3_1 as nested loops: slow, and without a second way to be wrong.

use stylegaussian_encoder::Image;

/// Values beyond the border of a feature.
#[derive(Clone, Copy, PartialEq)]
pub enum Border {
    Zero,
    Reflect,
}

/// Planes `[channels, height, width]`.
pub struct Feature {
    pub channels: usize,
    pub height: usize,
    pub width: usize,
    pub values: Vec<f32>,
}

/// A tensor of the weights file: name, shape, values.
pub type Tensor = (String, Vec<usize>, Vec<f32>);

pub struct Vgg {
    /// 3x3 matrix and shift of a color.
    input: Option<(Vec<f32>, Vec<f32>)>,
    /// Kernel `[out, in, 3, 3]` and bias.
    layers: Vec<(Vec<f32>, Vec<f32>)>,
    border: Border,
    ceil: bool,
}

impl Vgg {
    pub fn new(
        tensors: &[Tensor],
        names: [&str; 5],
        input: Option<(Vec<f32>, Vec<f32>)>,
        border: Border,
        ceil: bool,
    ) -> Self {
        let find = |name: String| tensors.iter().find(|tensor| tensor.0 == name).unwrap().2.clone();
        let layers =
            names.iter().map(|name| (find(format!("{name}.weight")), find(format!("{name}.bias")))).collect();
        Self { input, layers, border, ceil }
    }

    pub fn encode(&self, image: &Feature) -> Feature {
        let mut feature = match &self.input {
            None => Feature { values: image.values.clone(), ..*image },
            Some((matrix, shift)) => recolored(image, matrix, shift),
        };
        for (layer, (weight, bias)) in self.layers.iter().enumerate() {
            feature = convolved(&feature, weight, bias, self.border);
            if layer == 1 || layer == 3 {
                feature = pooled(&feature, self.ceil);
            }
        }
        feature
    }
}

impl From<&Image> for Feature {
    fn from(image: &Image) -> Self {
        let n_pixels = (image.width * image.height) as usize;
        let values = (0..3 * n_pixels).map(|i| image.rgb[i % n_pixels * 3 + i / n_pixels]).collect();
        Self { channels: 3, height: image.height as usize, width: image.width as usize, values }
    }
}

fn recolored(image: &Feature, matrix: &[f32], shift: &[f32]) -> Feature {
    let n_pixels = image.width * image.height;
    let color = |out: usize, pixel: usize| {
        (0..3).map(|i| matrix[out * 3 + i] * image.values[i * n_pixels + pixel]).sum::<f32>() + shift[out]
    };
    Feature { values: (0..3 * n_pixels).map(|i| color(i / n_pixels, i % n_pixels)).collect(), ..*image }
}

/// The index that a position stands for, or `None` if it stands for a zero.
fn source(position: isize, size: usize, border: Border) -> Option<usize> {
    let last = size as isize - 1;
    match border {
        _ if (0..=last).contains(&position) => Some(position as usize),
        Border::Zero => None,
        Border::Reflect if position < 0 => Some(-position as usize),
        Border::Reflect => Some((2 * last - position) as usize),
    }
}

/// 3x3 convolution and ReLU, summed in f64.
fn convolved(feature: &Feature, weight: &[f32], bias: &[f32], border: Border) -> Feature {
    let (width, height) = (feature.width, feature.height);
    let mut values = Vec::with_capacity(bias.len() * width * height);
    for (out, &bias) in bias.iter().enumerate() {
        for y in 0..height {
            for x in 0..width {
                let mut sum = f64::from(bias);
                for tap in 0..9 {
                    let row = source(y as isize + tap as isize / 3 - 1, height, border);
                    let column = source(x as isize + tap as isize % 3 - 1, width, border);
                    let (Some(row), Some(column)) = (row, column) else { continue };
                    for channel in 0..feature.channels {
                        let kernel = weight[(out * feature.channels + channel) * 9 + tap];
                        let value = feature.values[(channel * height + row) * width + column];
                        sum += f64::from(kernel) * f64::from(value);
                    }
                }
                values.push(sum.max(0.0) as f32);
            }
        }
    }
    Feature { channels: bias.len(), height, width, values }
}

fn pooled(feature: &Feature, ceil: bool) -> Feature {
    let half = |size: usize| if ceil { size.div_ceil(2) } else { size / 2 };
    let (width, height) = (half(feature.width), half(feature.height));
    let mut values = Vec::with_capacity(feature.channels * width * height);
    for channel in 0..feature.channels {
        for y in 0..height {
            for x in 0..width {
                let mut largest = f32::NEG_INFINITY;
                for row in 2 * y..(2 * y + 2).min(feature.height) {
                    for column in 2 * x..(2 * x + 2).min(feature.width) {
                        largest = largest
                            .max(feature.values[(channel * feature.height + row) * feature.width + column]);
                    }
                }
                values.push(largest);
            }
        }
    }
    Feature { channels: feature.channels, height, width, values }
}

/// -1..1, the same for the same seed (SplitMix64).
pub fn random_values(n: usize, seed: u64) -> Vec<f32> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ (mixed >> 31)) >> 40) as f32 / (1_u32 << 23) as f32 - 1.0
    };
    (0..n).map(|_| next()).collect()
}

pub fn random_image(width: u32, height: u32) -> Image {
    let rgb =
        random_values((width * height * 3) as usize, 99).iter().map(|value| value * 0.5 + 0.5).collect();
    Image { width, height, rgb, alpha: None }
}
