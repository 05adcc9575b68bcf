//! The offline side of StyleGaussian, and the command line `stylegaussian` over it.

pub mod cameras;
pub mod cli;
pub mod contact_sheet;
pub mod distill;
pub mod embed;
pub mod encoder;
pub mod eval;
pub mod fetch_vgg;
pub mod picture;
pub mod random;
mod recolor;
pub mod teacher;
pub mod train;
pub mod views;
