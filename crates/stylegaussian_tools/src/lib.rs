//! The offline side of StyleGaussian: embedding and training.

pub mod embed;
pub mod train;
