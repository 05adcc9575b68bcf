//! Image to VGG relu3_1 features and style statistics.
//!
//! ```no_run
//! use stylegaussian_encoder::{Encoder, Image, StyleSize, style_statistics};
//!
//! let encoder = Encoder::open("vgg19_normalised_relu3_1.safetensors".as_ref())?;
//! let image = Image::open("starry_night.jpg".as_ref())?;
//! let statistics = style_statistics(&encoder, &image, StyleSize::default())?;
//! assert_eq!(statistics.mean.len(), encoder.n_channels());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Networks of this project and VGG weights run as a [`chain`] of convolutions. With the feature `onnx`, ONNX
//! files of others run by tract or ONNX Runtime. In browsers the feature does nothing.

pub mod chain;
pub mod encoder;
pub mod features;
pub mod guard;
pub mod image;
#[cfg(all(feature = "onnx", not(target_family = "wasm")))]
pub mod onnx;
pub mod style;
pub mod vgg;
pub mod weights;

pub use encoder::{Encoder, EncoderError};
pub use features::FeatureMap;
pub use image::{Image, ImageError};
pub use style::{
    StyleSize, paint_of, paint_of_if_wanted, painted_style, style_features, style_statistics,
    style_statistics_if_wanted,
};
