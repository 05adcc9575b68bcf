//! placeholder

pub mod cameras;
pub mod train;
