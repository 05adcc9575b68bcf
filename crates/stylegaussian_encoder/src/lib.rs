//! Image to VGG relu3_1 features and style statistics, through tract or ONNX Runtime.
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
//! Every encoder runs as an ONNX graph: an ONNX file as it is, VGG weights as a graph that [`onnx`] writes. The
//! engine is tract, which is pure Rust and built in. If `ORT_DYLIB_PATH` names a shared library of ONNX Runtime
//! (1.24 or later), that is used instead; see [`runtime`].

pub mod encoder;
mod engine;
pub mod features;
pub mod guard;
pub mod image;
pub mod network;
pub mod onnx;
pub mod runtime;
pub mod style;
pub mod vgg;
pub mod weights;

pub use encoder::{Encoder, EncoderError};
pub use features::FeatureMap;
pub use image::{Image, ImageError};
pub use style::{StyleSize, paint_of, painted_style, style_features, style_statistics};
