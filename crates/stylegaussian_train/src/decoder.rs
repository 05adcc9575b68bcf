//! Training of the decoder from embedded scenes and paintings.
//!
//! A [`Trainer`] first teaches the decoder to recolor scenes (the warm start), then minimizes the paper's loss
//! on stylized views, as seen by VGG-19.

mod config;
mod data;
mod loss;
mod network;
mod paintings;
mod report;
mod start;
mod trainer;
mod warm_start;

pub use config::{LossWeights, NewDecoder, Start, TrainConfig};
pub use data::TrainingScene;
pub use loss::Losses;
pub use paintings::Paintings;
pub use report::{write_contact_sheet, write_losses};
pub use start::{DecoderChanges, mean_decoder};
pub use trainer::{CHECKPOINT_STEPS, Trainer, ViewCount};
