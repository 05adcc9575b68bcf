//! StyleGaussian on the GPU, in raw wgpu and without an engine: the style pass and the splat pass.
//!
//! The two passes know nothing of one another. They meet in [`colors::GaussianColors`]: the style pass writes it, on
//! change; the splat pass reads it, every frame.

pub mod colors;
pub mod device;
pub mod splat;
pub mod style;
