//! The decoder of the paper, which some styles take instead of paint: its assets, and its settings as resources
//! and a component.
//!
//! [`StyleMethod::Decoder`](super::StyleMethod::Decoder) selects it, and a [`StyleDecoder`] on an entity does.
//! [`StyleBackend`] says where it runs, and [`StyleBudget`] how long in a frame. With the feature `images`, an
//! encoder reads its images: `StyleEncoder` names the `ImageEncoder`.

#[cfg(feature = "images")]
pub use super::wish::encoder::{ImageEncoder, StyleEncoder};
pub use super::wish::{
    asset::GaussianDecoder,
    settings::{StyleBackend, StyleBudget},
    source::StyleDecoder,
};
