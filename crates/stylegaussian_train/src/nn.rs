//! Neural networks under training: differentiable operations, parameters, Adam, weight averaging, checkpoints,
//! learning-rate schedules and the VGG-19 loss network.
//!
//! Training runs on burn. The splat render and the KNN convolution are custom operations over the model's own
//! kernels and gradients. VGG and the distilled encoder run through the same KNN convolution: a picture is rows
//! of pixels whose neighborhoods are 3x3. With the feature `gpu`, training and distillation also run on GPUs.
//! There the operations are composed of gathers, products and sums of segments, 64 MiB at a time.

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
