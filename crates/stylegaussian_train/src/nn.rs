//! Neural networks under training: differentiable operations, parameters, Adam, weight averaging, checkpoints,
//! learning-rate schedules and the VGG-19 loss network.

pub(crate) mod adam;
pub(crate) mod average;
pub(crate) mod checkpoint;
pub(crate) mod coverage;
pub mod loss_network;
pub mod normalize;
pub mod ops;
pub(crate) mod parameter;
mod processor;
pub(crate) mod schedule;
pub mod vgg;

pub use checkpoint::check_checkpoint;
pub use loss_network::LossNetwork;
pub use processor::Processor;
