//! Errors of the style pass.

use stylegaussian::fold::StylizeError;

use crate::buffers::TooLarge;

/// A scene could not be brought to the GPU, or could not be decoded there.
#[derive(Debug, thiserror::Error)]
pub enum StyleSceneError {
    /// The decoder does not fit the scene.
    #[error(transparent)]
    Stylize(#[from] StylizeError),
    /// The device's limits are too small.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    /// The weights or the colors belong to another scene or decoder.
    #[error("the style pass was given {what} of {found}, the scene has {expected}")]
    Mismatch {
        /// The thing that was given.
        what: &'static str,
        /// Its shape.
        found: String,
        /// The shape that the scene needs.
        expected: String,
    },
}
