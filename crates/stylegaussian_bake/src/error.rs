//! Reasons for which nothing can be baked.

use stylegaussian::work::Canceled;
use stylegaussian_encoder::weights::WeightsError;
use stylegaussian_files::FileError;

/// A scene, a painting or a network that cannot be baked with, or a checkpoint that does not fit.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// No view of the scene has a pixel that is covered to nine tenths.
    #[error("the scene of {n_gaussians} Gaussians: no view shows anything opaque to paint on")]
    NothingVisible {
        /// N.
        n_gaussians: usize,
    },
    /// There is no painting, or none with a weight above 0.
    #[error("{found} paintings with a weight above 0, expected at least one")]
    NoPainting {
        /// Paintings with a weight above 0.
        found: usize,
    },
    /// A painting's values do not fit its size, or are not finite.
    #[error(
        "a painting of {width}x{height} has {found}, expected 3 finite values for each of at least one pixel"
    )]
    Painting {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Description of its values.
        found: String,
    },
    /// A network is not one that can be a loss network.
    #[error("{name}: found {found}, expected VGG-19 or an encoder that `stylegaussian distill` wrote")]
    Network {
        /// The network's file.
        name: String,
        /// Description of the network.
        found: String,
    },
    /// VGG-19's weights cannot be read.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// Nobody wants the bake any more.
    #[error(transparent)]
    Canceled(#[from] Canceled),
    /// A checkpoint cannot be written or read, or is of another bake.
    #[error(transparent)]
    File(#[from] FileError),
}
