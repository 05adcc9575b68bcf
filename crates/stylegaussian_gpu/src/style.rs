//! The style pass: computes one color for each Gaussian from a scene's features and a folded decoder.
//!
//! It runs only if something changes. [`StyleInputs`] packs a scene on the CPU and [`StyleScene`] uploads it,
//! once. A change of style folds the decoder's first layer ([`FoldedLayers`], at a cost independent of N),
//! uploads the weights ([`GpuDecoder`]) and encodes the layers ([`StylePass::encode`]). The result equals
//! [`stylegaussian::fold::stylize`] up to the rounding of activations to f16.
//!
//! A scene is decoded block by block (`blocks`), so that the data between layers takes at most 64 MiB. Scenes
//! that fit are one block; scenes whose neighbor lists are not local are decoded whole, in memory that grows
//! with N. A change is a list of dispatches (`plan`) that can be cut at any multiple of 128 rows
//! ([`StylePass::encode_some`]), which spreads it over frames. [`WorkMeter`] measures by timestamps how many
//! operations a millisecond is worth. Activations are f16, or f32 or bytes on request ([`Precision`]).
//!
//! ```no_run
//! use stylegaussian_gpu::{colors::GaussianColors, device::{DeviceOptions, HeadlessDevice}, style::*};
//! # fn f(
//! #     scene: &stylegaussian::Scene,
//! #     decoder: &stylegaussian::Decoder,
//! #     style: &stylegaussian::ChannelStatistics,
//! # ) -> Result<(), Box<dyn std::error::Error>> {
//! let gpu = pollster::block_on(HeadlessDevice::request(DeviceOptions::default()))?;
//! let HeadlessDevice { device, queue, .. } = gpu;
//! let pass = StylePass::new(&device);
//! let gpu_scene = StyleScene::new(&device, &queue, scene, decoder)?;
//! let colors = GaussianColors::new(&device, scene.len())?;
//! let map = gpu_scene.content().transfer(&[(style, 1.0)], 0.0)?;
//! let weights = GpuDecoder::new(&device, &queue, &FoldedLayers::new(gpu_scene.content(), decoder, &map)?)?;
//! let mut encoder = device.create_command_encoder(&Default::default());
//! pass.encode(&device, &mut encoder, &gpu_scene, &weights, &colors)?;
//! queue.submit([encoder.finish()]);
//! # Ok(()) }
//! ```

mod blocks;
mod bytes;
mod content;
mod error;
mod folded_layers;
mod inputs;
mod options;
mod pass;
mod pipelines;
mod plan;
mod planes;
mod scene;
mod scratch;
mod shape;
mod stylize;
mod timer;
mod weights;
mod work_meter;

pub use bytes::StyleBytes;
pub use content::ContentFold;
pub use error::StyleSceneError;
pub use folded_layers::FoldedLayers;
pub use inputs::StyleInputs;
pub use options::{Precision, StyleOptions};
pub use pass::StylePass;
pub use scene::StyleScene;
pub use stylize::{StylizeOnGpuError, stylize};
pub use weights::GpuDecoder;
pub use work_meter::{StyleProgress, WorkMeter};
