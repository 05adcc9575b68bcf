//! Stand-in for ONNX Runtime where no shared library can be opened: nothing of it can exist.

use std::{convert::Infallible, path::Path};

use super::{Planes, Signature};

/// As of ONNX Runtime.
pub(crate) struct Environment(Infallible);

/// As of ONNX Runtime.
pub(crate) struct Graph(Infallible);

/// Refuses.
///
/// # Errors
/// Always.
pub(crate) fn start(path: &Path) -> Result<(Environment, String), String> {
    Err(format!("ONNX Runtime ({}) cannot be opened in a browser, so tract is used", path.display()))
}

impl Graph {
    /// Cannot be called.
    pub(crate) fn load(environment: &Environment, _onnx: &[u8]) -> Result<(Self, Signature), String> {
        match environment.0 {}
    }

    /// Cannot be called.
    pub(crate) fn run(&self, _input: &Planes) -> Result<(Vec<usize>, Vec<f32>), String> {
        match self.0 {}
    }
}
