//! The game's side of styling: sources, assets, settings, events.

pub(crate) mod applied;
pub(crate) mod asset;
pub(crate) mod decoder;
#[cfg(feature = "images")]
pub(crate) mod encoder;
pub(crate) mod error;
pub(crate) mod event;
pub(crate) mod hand;
pub(crate) mod living;
pub(crate) mod motion;
pub(crate) mod relief;
pub(crate) mod settings;
pub(crate) mod source;
pub(crate) mod strokes;
