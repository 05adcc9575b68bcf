//! The model of StyleGaussian without an engine: scene, statistics and fold, decoder, neighbors, splatting, files.

pub mod camera;
pub mod decoder;
pub mod encoder_id;
pub mod file;
pub mod fold;
pub mod morton;
pub mod neighbors;
pub mod noise;
pub mod scene;
pub mod sh;
pub mod splat;
pub mod statistics;
pub mod twin;

pub use camera::Camera;
pub use decoder::{Activation, Decoder, Layer};
pub use encoder_id::EncoderId;
pub use neighbors::Neighbors;
pub use scene::{Features, Scene};
pub use statistics::ChannelStatistics;
