//! Embedding, training, distillation and evaluation for StyleGaussian scenes.
//!
//! This example embeds a scene, takes ten training steps and writes the decoder:
//!
//! ```no_run
//! use std::path::Path;
//!
//! use glam::UVec2;
//! use stylegaussian::views::choose_views;
//! use stylegaussian_encoder::Encoder;
//! use stylegaussian_files::{Precision, read_scene, write_decoder};
//! use stylegaussian_train::{
//!     Watch,
//!     decoder::{Paintings, TrainConfig, Trainer, TrainingScene},
//!     embed::{EmbedOptions, TrainingView, embed},
//!     nn::{LossNetwork, Processor},
//! };
//!
//! // The same VGG-19 weights serve as the encoder and as the loss network.
//! let vgg = Path::new("vgg19.safetensors");
//! let encoder = Encoder::open(vgg)?;
//!
//! let mut scene = read_scene("garden.ply".as_ref())?.scene;
//! let cameras = choose_views(&scene, 24, UVec2::splat(256));
//! let rendered = |(i, camera)| TrainingView::rendered(format!("view {i}"), camera, 256);
//! let views: Vec<TrainingView> = cameras.iter().enumerate().map(rendered).collect();
//! embed(&mut scene, &views, &encoder, &EmbedOptions::default(), Watch::default())?;
//!
//! let loss_network = LossNetwork::open(vgg, None, Processor::Cpu)?;
//! let paintings = Paintings::new(vec!["starry_night.jpg".into()], &encoder, loss_network);
//! let scenes = [TrainingScene::new("garden", &scene, &cameras, &[256])];
//! let mut trainer = Trainer::new(TrainConfig::default(), &scenes, paintings)?;
//! for step in 0..10 {
//!     let losses = trainer.step()?;
//!     println!("{step}: content {:.3}, style {:.3}", losses.content, losses.style);
//! }
//! write_decoder("garden.decoder.safetensors".as_ref(), &trainer.decoder()?, Precision::F16)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Embedding needs no training framework, and is all that is left without the feature `training`.
//!
//! Nothing here prints, parses arguments, reads the environment or handles signals. Long computations report to
//! a [`Watch`], which can also interrupt them.

pub mod cameras;
#[cfg(feature = "training")]
mod causes;
#[cfg(feature = "training")]
pub mod contact_sheet;
#[cfg(feature = "training")]
pub mod decoder;
pub mod embed;
#[cfg(feature = "training")]
pub mod encoder;
#[cfg(feature = "training")]
mod error;
#[cfg(feature = "training")]
pub mod eval;
#[cfg(feature = "training")]
pub mod images;
#[cfg(feature = "training")]
pub mod nn;
#[cfg(feature = "training")]
pub mod picture;
mod watch;

#[cfg(feature = "training")]
pub use error::TrainError;
pub use watch::{Progress, Stage, Watch};
