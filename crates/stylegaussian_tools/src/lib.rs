//! The offline side of StyleGaussian: cameras, embedding and training.

pub mod cameras;
pub mod embed;
pub mod train;
