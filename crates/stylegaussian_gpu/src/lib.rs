//! StyleGaussian on the GPU, in raw wgpu and without an engine: the style pass and the splat pass.
//!
//! The two passes do not know one another. They meet in [`colors::GaussianColors`]: the style pass writes
//! colors when a style changes, and the splat pass reads them every frame. Strokes ([`strokes`]) lie over
//! colors.
//!
//! # Memory
//!
//! Bytes on the GPU per Gaussian, for SH of degree 0, 32 latent features and 8 neighbors:
//!
//! | | bytes |
//! | --- | --- |
//! | geometry | 32 |
//! | captured color | 12 |
//! | styled color | 8 |
//! | strokes | 4 |
//! | painted mask | 4 |
//! | features, for the decoder | 64 |
//! | neighbor lists with halos, for the decoder | about 40 |
//! | base colors, if the decoder takes or adds them | 24 |
//! | records of each view that shows it | 48.5 |
//! | the same with strokes | 64.5 |
//! | records and tile lists of each view on a software adapter | 312 |
//!
//! Paintings that change in a frame share 30 MB more, as long as there are any. A shadow map that splats cast
//! into takes 4 bytes more per texel. The cores of the map that changes take 24 bytes per Gaussian, and 24 MiB
//! at most; all maps share them.
//!
//! 3 million Gaussians take 0.6 to 0.7 GB with one view, and 64 MiB more during a change of style by the
//! decoder. Under WebGPU's default limit of 128 MiB per binding, features fit up to 8.4 million Gaussians,
//! colors up to 16.7 million, and the records of a view up to 8.4 million. Geometry and SH are cut into chunks
//! of any number. Adapters with larger bindings take more.

mod bindings;
pub mod buffers;
pub mod colors;
pub mod device;
mod drawing;
pub mod layers;
pub mod mask;
pub mod needs;
mod regions;
pub mod splat;
pub mod strokes;
pub mod style;
