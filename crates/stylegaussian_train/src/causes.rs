//! The errors of other crates that [`TrainError`] passes on.

use crate::error::TrainError;

/// Converts errors of other crates, so that `?` works on them.
macro_rules! caused_by {
    ($($source:ty),* $(,)?) => {
        $(impl From<$source> for TrainError {
            fn from(source: $source) -> Self {
                Self::Caused(source.into())
            }
        })*
    };
}

caused_by!(
    crate::cameras::CamerasError,
    burn::tensor::TensorReadError,
    safetensors::SafeTensorError,
    stylegaussian::encoder_id::EncoderMismatch,
    stylegaussian::fold::StylizeError,
    stylegaussian_encoder::EncoderError,
    stylegaussian_encoder::ImageError,
    stylegaussian_encoder::chain::ChainError,
    stylegaussian_encoder::weights::WeightsError,
    stylegaussian_files::FileError,
);
