//! The offline side of StyleGaussian, and the command line `stylegaussian` over it.

pub mod cli;
pub mod contact_sheet;
pub mod picture;
pub mod train;
