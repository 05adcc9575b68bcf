//! Baking: the colors of a scene's Gaussians, optimized for the brush strokes that are drawn over them.
//!
//! Instant paint lays a painting's strokes on base colors by lookup. Baking looks at pictures: it renders small
//! views of the scene with its strokes from random cameras, compares them with the painting through a loss
//! network, and moves the colors under the strokes along the gradient. The strokes stay as they are. Colors
//! belong to Gaussians, so views agree by construction. A step depends on the seed and its number alone, so a
//! bake can be stopped anywhere and continued.
//!
//! The stages, one module each: `start` (instant paint, and how far its colors may go), `cameras` (random
//! cameras), `picture` (a crop of the scene), `target` (the paintings as the network sees them), `network` (the
//! loss network and its gradient), `loss` (matching, statistics, large shapes, range), `luminance` (every other
//! step compares luminance alone), `adam` (one second moment per Gaussian), `baker` and `config` (the steps and
//! their settings), `checkpoint` (the state as a file).
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use stylegaussian::work::Work;
//! use stylegaussian_bake::{BakeConfig, Baker, LossNetwork};
//! use stylegaussian_encoder::Image;
//!
//! let scene = stylegaussian_files::read_scene("scene.sgs".as_ref())?.scene;
//! let painting = Image::open("irises.jpg".as_ref())?;
//! let network = LossNetwork::vgg("vgg19.safetensors".as_ref())?;
//! let (config, work) = (BakeConfig::default(), Work::default());
//! let mut baker = Baker::new(config, &scene, &[], &[(painting, 1.0)], network, &work)?;
//! while !baker.is_complete() {
//!     baker.step(&scene);
//! }
//! # let colors: &[[f32; 3]] = baker.colors();
//! # let strokes: &stylegaussian::strokes::Strokes = baker.strokes();
//! # Ok(())
//! # }
//! ```

mod adam;
mod baker;
mod cameras;
mod checkpoint;
mod config;
mod error;
mod loss;
mod luminance;
pub mod network;
mod picture;
mod start;
mod target;

pub use baker::Baker;
pub use config::{BakeConfig, LossWeights};
pub use error::BakeError;
pub use loss::Losses;
pub use network::LossNetwork;
