//! Image to VGG relu3_1 features and style statistics, through ONNX Runtime or tract.
//!
//! ```no_run
//! use stylegaussian_encoder::{Image, StyleSize, resolve, style_statistics};
//!
//! let encoder = resolve(Some("vgg19_normalised_relu3_1.safetensors".as_ref()), None)?;
//! let image = Image::open("starry_night.jpg".as_ref())?;
//! let statistics = style_statistics(&encoder, &image, StyleSize::default())?;
//! assert_eq!(statistics.mean.len(), encoder.n_channels());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Every encoder runs as an ONNX graph: an ONNX file as it is, VGG weights as a graph that [`onnx`] writes. The
//! runtime is the shared library named by `ORT_DYLIB_PATH` (ONNX Runtime 1.24 or later), otherwise tract, which is
//! pure Rust and built in; see [`runtime`].

pub mod encoder;
pub mod features;
pub mod image;
pub mod network;
pub mod onnx;
mod rehearsal;
pub mod runtime;
pub mod style;
pub mod vgg;
pub mod weights;

pub use encoder::{Encoder, EncoderError, resolve};
pub use features::FeatureMap;
pub use image::{Image, ImageError};
pub use style::{StyleSize, style_features, style_statistics};
