//! The engine that runs the graphs: tract, or ONNX Runtime if the user names its library.
//!
//! tract is pure Rust, built in, and keeps no state in the process. If the environment variable `ORT_DYLIB_PATH` names
//! a shared library of ONNX Runtime 1.24 or later, that is loaded instead, once per process and at the first use. If it
//! cannot be used, tract takes over and [`Runtime::warning`] says why. Both give the same features to about 2e-5; ONNX
//! Runtime is three to four times faster.

use std::{
    env,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use ort::environment::Environment;

use crate::engine::tract;

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

    /// The reason why the library named by `ORT_DYLIB_PATH` is not used; `None` if it is used, or if none is named.
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
        let builder = match ort::init_from(path) {
            Ok(builder) => builder,
            Err(error) => {
                return Self::tract(Some(format!(
                    "{DYLIB_VARIABLE} does not name a usable ONNX Runtime, so tract is used: {error}"
                )));
            }
        };
        // ort allows one environment in a process and hands it to nobody but its maker. If another part of the program
        // has made it, that part keeps it.
        // Telemetry is a default of ONNX Runtime on Windows. A library must not turn it on for its users.
        match builder.with_name("stylegaussian").with_telemetry(false).build() {
            Ok(environment) => {
                let name = format!("ONNX Runtime {}, {}", onnx_runtime_version(path), path.display());
                Self { environment: Some(environment), name, warning: None }
            }
            Err(error) => Self::tract(Some(format!(
                "ONNX Runtime ({DYLIB_VARIABLE}={}) cannot be started here, so tract is used: {error}",
                path.display()
            ))),
        }
    }
}

/// From the file's name (`libonnxruntime.so.1.24.1`), else from `ORT Build Info: git-branch=rel-1.24.1, ...`: `ort`
/// has no other source of the version, and not every build's branch is named after it.
fn onnx_runtime_version(path: &Path) -> String {
    // Through symbolic links: `libonnxruntime.so` is usually a link to the file with the version.
    let file = path.canonicalize().unwrap_or_else(|_| path.into());
    let in_name = file.file_name().and_then(|name| version_in(&name.to_string_lossy()));
    let in_info = || between(ort::info(), "git-branch=", ',').and_then(version_in);
    in_name.or_else(in_info).unwrap_or_else(|| "of unknown version".into())
}

/// The first `1.24` or `1.24.1` in a text.
fn version_in(text: &str) -> Option<String> {
    let mut numbers =
        text.split(|c: char| !c.is_ascii_digit() && c != '.').map(|part| part.trim_matches('.'));
    // A single number may be anything, such as the 64 of an architecture.
    numbers.find(|number| number.contains('.')).map(String::from)
}

/// The text after `start` and before the next `end`.
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
        let info = "ORT Build Info: git-branch=rel-1.24.1, git-commit-id=0";
        assert_eq!(between(info, "git-branch=", ','), Some("rel-1.24.1"));
    }
}
