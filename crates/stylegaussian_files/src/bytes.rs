//! Whole files in memory.

use std::path::Path;

use super::error::FileError;

/// Reads a file.
///
/// # Errors
/// If the file cannot be read.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    std::fs::read(path).map_err(|source| FileError::Io { path: path.into(), source })
}
