//! StyleGaussian on the GPU, in raw wgpu and without an engine: the style pass and the splat pass.
//!
//! The two passes do not know one another. They meet in [`colors::GaussianColors`]: the style pass writes
//! colors when a style changes, and the splat pass reads them every frame. Strokes ([`strokes`]) lie over
//! colors.

mod bindings;
pub mod buffers;
pub mod colors;
pub mod device;
pub mod layers;
pub mod mask;
pub mod needs;
pub mod splat;
pub mod strokes;
pub mod style;
