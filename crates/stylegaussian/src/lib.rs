//! The model of StyleGaussian without an engine: scene, statistics and fold, decoder, neighbors, splatting,
//! paint.
//!
//! A [`Scene`] holds Gaussians and, once embedded, latent [`Features`]. [`fold::transfer`] turns the statistics
//! of styles into a map of features, and [`fold::stylize`] decodes the mapped features to one color per
//! Gaussian:
//!
//! ```
//! use std::error::Error;
//!
//! use stylegaussian::{ChannelStatistics, Decoder, Scene, fold};
//!
//! fn recolor(scene: &mut Scene, style: &ChannelStatistics, decoder: &Decoder) -> Result<(), Box<dyn Error>> {
//!     let features = scene.features.as_ref().ok_or("the scene was never embedded")?;
//!     let map = fold::transfer(features, &[(style, 1.0)], 0.0)?;
//!     let colors = fold::stylize(scene, decoder, &map)?;
//!     scene.set_colors(&colors);
//!     Ok(())
//! }
//! ```
//!
//! No file is read or written here: the crate `stylegaussian_files` does both.

pub mod apart;
pub mod axes;
mod bulk;
pub mod camera;
pub mod collision;
pub mod cut;
pub mod decoder;
pub mod encoder_id;
pub mod fold;
pub mod frame;
pub mod layers;
pub mod light;
pub mod look;
pub mod mask;
pub mod merge;
pub mod mesh;
pub mod morton;
pub mod neighbors;
pub mod noise;
pub mod paint;
pub mod palette;
pub mod principal;
pub mod random;
pub mod raycast;
pub mod recolor;
pub mod restyle;
pub mod scene;
pub mod sh;
pub mod slices;
pub mod splat;
pub mod split;
pub mod statistics;
pub mod strokes;
pub mod symmetric;
pub mod views;
pub mod work;

pub use axes::Axes;
pub use camera::Camera;
pub use decoder::{Activation, Decoder, Layer};
pub use encoder_id::{EncoderId, EncoderMismatch};
pub use frame::Frame;
pub use look::{Look, SceneFingerprint};
pub use mask::{Mask, StoredMask};
pub use neighbors::Neighbors;
pub use scene::{Features, Scene};
pub use statistics::ChannelStatistics;
