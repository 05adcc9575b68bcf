//! Which engine runs the graphs: ONNX Runtime when the user has it, otherwise tract.
//!
//! The choice is made once per process, at the first use. `ORT_DYLIB_PATH` names a shared library of ONNX Runtime
//! 1.24 or later; when it cannot be loaded, tract takes over and [`Runtime::warning`] says why. Both give the same
//! features to about 2e-5; ONNX Runtime is three to four times faster.

use std::{path::Path, sync::OnceLock};

use ort::environment::{Environment, EnvironmentBuilder};

/// The environment variable that names a shared library of ONNX Runtime.
pub const DYLIB_VARIABLE: &str = "ORT_DYLIB_PATH";

/// The engine of this process.
pub struct Runtime {
    pub(crate) environment: Environment,
    pub(crate) engine: Engine,
    name: String,
    warning: Option<String>,
}

/// What differs in use between the two engines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Engine {
    /// Runs each graph on all cores by itself, so one session is shared.
    OnnxRuntime,
    /// Runs each graph on the caller's thread, so every thread gets a session.
    Tract,
}

/// No engine could be started.
#[derive(Clone, Debug, thiserror::Error)]
#[error("no runtime for ONNX graphs: {reason}")]
pub struct RuntimeError {
    reason: String,
}

impl Runtime {
    /// The engine of this process, chosen at the first call.
    ///
    /// # Errors
    /// When another part of the process already owns an `ort` environment.
    pub fn get() -> Result<&'static Self, RuntimeError> {
        static RUNTIME: OnceLock<Result<Runtime, RuntimeError>> = OnceLock::new();
        RUNTIME.get_or_init(Self::start).as_ref().map_err(Clone::clone)
    }

    /// Name and version for people: `tract 0.23`, or `ONNX Runtime 1.24.1, /path/libonnxruntime.so`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Why `ORT_DYLIB_PATH` was not honored, when it was set and could not be.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    fn start() -> Result<Self, RuntimeError> {
        let Some(path) = std::env::var_os(DYLIB_VARIABLE).filter(|path| !path.is_empty()) else {
            return Self::start_tract(None);
        };
        match ort::init_from(Path::new(&path)) {
            Ok(builder) => {
                let environment = build(builder)?;
                let path = Path::new(&path);
                let name = format!("ONNX Runtime {}, {}", onnx_runtime_version(path), path.display());
                Ok(Self { environment, engine: Engine::OnnxRuntime, name, warning: None })
            }
            Err(error) => Self::start_tract(Some(format!(
                "{DYLIB_VARIABLE} does not name a usable ONNX Runtime, so tract is used: {error}"
            ))),
        }
    }

    fn start_tract(warning: Option<String>) -> Result<Self, RuntimeError> {
        if !ort::set_api(ort_tract::api()) {
            return Err(RuntimeError {
                reason: "another part of this process already chose ort's backend".into(),
            });
        }
        let environment = build(ort::init())?;
        Ok(Self { environment, engine: Engine::Tract, name: format!("tract {}", tract_version()), warning })
    }
}

fn build(builder: EnvironmentBuilder) -> Result<Environment, RuntimeError> {
    builder
        .with_name("stylegaussian")
        .with_telemetry(false)
        .build()
        .map_err(|error| RuntimeError { reason: error.to_string() })
}

/// From the file's name (`libonnxruntime.so.1.24.1`), else from `ORT Build Info: git-branch=rel-1.24.1, ...`: `ort`
/// does not tell the version otherwise, and not every build's branch is named after it.
fn onnx_runtime_version(path: &Path) -> String {
    let file = path.canonicalize().unwrap_or_else(|_| path.into());
    let in_name = file.file_name().and_then(|name| version_in(&name.to_string_lossy()));
    let in_info = || between(ort::info(), "git-branch=", ',').and_then(version_in);
    in_name.or_else(in_info).unwrap_or_else(|| "of unknown version".into())
}

/// The first `1.24` or `1.24.1` in a text.
fn version_in(text: &str) -> Option<String> {
    let mut numbers =
        text.split(|c: char| !c.is_ascii_digit() && c != '.').map(|part| part.trim_matches('.'));
    numbers.find(|number| number.contains('.')).map(String::from)
}

/// From `ORT Build Info: backend=ort-tract, version=0.5.0+0.23`: what follows the plus is tract's version.
fn tract_version() -> &'static str {
    between(ort::info(), "version=", ',').map_or("", |version| version.rsplit('+').next().unwrap_or(version))
}

fn between<'a>(text: &'a str, start: &str, end: char) -> Option<&'a str> {
    let (_, rest) = text.split_once(start)?;
    rest.split(end).next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_found_in_file_names_and_branches() {
        assert_eq!(version_in("libonnxruntime.so.1.24.1").as_deref(), Some("1.24.1"));
        assert_eq!(version_in("libonnxruntime.1.25.0.dylib").as_deref(), Some("1.25.0"));
        assert_eq!(version_in("rel-1.24").as_deref(), Some("1.24"));
        assert_eq!(version_in("onnxruntime.dll"), None);
        assert_eq!(between("backend=ort-tract, version=0.5.0+0.23", "version=", ','), Some("0.5.0+0.23"));
    }
}
