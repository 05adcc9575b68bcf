//! The engine that runs ONNX graphs: tract, or ONNX Runtime if the user names its library.
//!
//! tract is pure Rust, built in, and keeps no state in the process. If the environment variable
//! `ORT_DYLIB_PATH` names a shared library of ONNX Runtime 1.24 or later, that is loaded instead, once per
//! process and at the first use. If it cannot be used, tract takes over and [`Runtime::warning`] says why. Both
//! give the same features to about 2e-5; ONNX Runtime is three to four times faster.

use std::{
    env,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use super::{
    onnx_runtime::{self, Environment},
    tract,
};

/// The environment variable that names a shared library of ONNX Runtime.
pub const DYLIB_VARIABLE: &str = "ORT_DYLIB_PATH";

/// The engine of this process.
pub struct Runtime {
    /// ONNX Runtime's environment, or `None` if tract runs the graphs.
    environment: Option<Environment>,
    name: String,
    warning: Option<String>,
}

impl Runtime {
    /// The engine of this process, chosen at the first call.
    pub fn get() -> &'static Self {
        // Once per process, since ort allows one environment in it.
        static RUNTIME: OnceLock<Runtime> = OnceLock::new();
        RUNTIME.get_or_init(|| {
            let library = env::var_os(DYLIB_VARIABLE).filter(|path| !path.is_empty());
            library.map_or_else(|| Self::tract(None), |path| Self::onnx_runtime(&PathBuf::from(path)))
        })
    }

    /// Name and version for people: `tract 0.23`, or `ONNX Runtime 1.24.1, /path/libonnxruntime.so`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The reason why the library named by `ORT_DYLIB_PATH` is not used; `None` if it is used, or if none is
    /// named.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// Whether tract runs the graphs.
    pub(crate) fn is_tract(&self) -> bool {
        self.environment.is_none()
    }

    pub(crate) fn environment(&self) -> Option<&Environment> {
        self.environment.as_ref()
    }

    fn tract(warning: Option<String>) -> Self {
        Self { environment: None, name: format!("tract {}", tract::VERSION), warning }
    }

    fn onnx_runtime(path: &Path) -> Self {
        match onnx_runtime::start(path) {
            Ok((environment, name)) => Self { environment: Some(environment), name, warning: None },
            Err(warning) => Self::tract(Some(warning)),
        }
    }
}
