//! placeholder

pub mod cameras;
pub mod views;
pub mod train;
