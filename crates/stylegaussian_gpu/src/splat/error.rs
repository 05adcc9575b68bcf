//! Errors of the splat pass.

use crate::buffers::TooLarge;

/// A view cannot be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SplatError {
    /// The clouds of a view have too many Gaussians.
    #[error("a view of {n_gaussians} Gaussians: {too_large}; show fewer or smaller clouds at once")]
    TooManyGaussians {
        /// Gaussians of all clouds together.
        n_gaussians: usize,
        /// The buffer that exceeds the device's limits.
        too_large: TooLarge,
    },
    /// The colors belong to another scene.
    #[error("cloud {cloud}: found colors of {found} Gaussians, expected {expected}")]
    Colors {
        /// Index of the cloud.
        cloud: usize,
        /// Gaussians that the colors belong to.
        found: usize,
        /// Gaussians of the cloud's scene.
        expected: usize,
    },
    /// The strokes belong to another scene.
    #[error("cloud {cloud}: found strokes of {found} Gaussians, expected {expected}")]
    Strokes {
        /// Index of the cloud.
        cloud: usize,
        /// Gaussians that the strokes belong to.
        found: usize,
        /// Gaussians of the cloud's scene.
        expected: usize,
    },
    /// The mask belongs to another scene.
    #[error("cloud {cloud}: found a mask of {found} Gaussians, expected {expected}")]
    Mask {
        /// Index of the cloud.
        cloud: usize,
        /// Gaussians that the mask belongs to.
        found: usize,
        /// Gaussians of the cloud's scene.
        expected: usize,
    },
}
