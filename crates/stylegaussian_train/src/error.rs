//! The error of training, distillation and evaluation.

use std::error::Error;

/// Training, distillation or evaluation failed.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file, a scene or a setting is not as required. The message names it, and says the found and the
    /// expected value.
    #[error("{0}")]
    Invalid(String),
    /// An operation failed for a reason of its own.
    #[error("{operation}")]
    Failed {
        /// The file or the operation.
        operation: String,
        /// The reason.
        source: Box<dyn Error + Send + Sync>,
    },
    /// Reading an image, encoding it, writing a file or reading a tensor failed. The inner error names the
    /// cause.
    #[error(transparent)]
    Caused(Box<dyn Error + Send + Sync>),
    /// The caller asked to stop, and there is no partial result to keep.
    #[error("interrupted")]
    Interrupted,
}

/// Adds the name of a file or an operation to an error.
pub(crate) trait Context<T> {
    /// Turns the error into [`TrainError::Failed`] with this description.
    fn context<S: Into<String>>(self, operation: impl FnOnce() -> S) -> Result<T, TrainError>;
}

impl<T, E: Into<Box<dyn Error + Send + Sync>>> Context<T> for Result<T, E> {
    fn context<S: Into<String>>(self, operation: impl FnOnce() -> S) -> Result<T, TrainError> {
        self.map_err(|source| TrainError::Failed { operation: operation().into(), source: source.into() })
    }
}

/// Returns [`TrainError::Invalid`] with a formatted message if a condition does not hold.
macro_rules! ensure {
    ($condition:expr, $($message:tt)+) => {
        let holds: bool = $condition;
        if !holds {
            return Err($crate::TrainError::Invalid(format!($($message)+)));
        }
    };
}

pub(crate) use ensure;
