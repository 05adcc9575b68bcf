//! ONNX Runtime, the engine for users who have its shared library: an ONNX graph as a session.

use std::{
    path::Path,
    sync::{Mutex, PoisonError},
};

pub(crate) use ort::environment::Environment;
use ort::{
    session::{Session, builder::GraphOptimizationLevel},
    value::{self, TensorElementType, TensorRef},
};

use super::{
    engine::{Outlet, Planes, Signature},
    runtime::DYLIB_VARIABLE,
};
use crate::guard::one_line;

/// A graph ready to run. Runs take turns: a session uses all cores by itself.
pub(crate) struct Graph {
    session: Mutex<Session>,
}

impl Graph {
    /// Opens a session for a graph.
    ///
    /// # Errors
    /// The reason of ONNX Runtime's refusal.
    pub(crate) fn load(environment: &Environment, onnx: &[u8]) -> Result<(Self, Signature), String> {
        let session = open(environment, onnx).map_err(one_line)?;
        let outlets = |outlets: &[value::Outlet]| outlets.iter().map(outlet).collect();
        let signature = Signature { inputs: outlets(session.inputs()), outputs: outlets(session.outputs()) };
        Ok((Self { session: Mutex::new(session) }, signature))
    }

    /// Runs the graph. The first output's shape and values.
    ///
    /// # Errors
    /// The reason of ONNX Runtime's refusal.
    pub(crate) fn run(&self, input: &Planes) -> Result<(Vec<usize>, Vec<f32>), String> {
        // Borrows the input: ONNX Runtime reads it in place.
        let tensor = TensorRef::from_array_view((input.shape(), &input.values[..])).map_err(one_line)?;
        // A session has no state that a panic of another thread could have left half done.
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let outputs = session.run(ort::inputs![tensor]).map_err(one_line)?;
        let (_, output) = outputs.iter().next().ok_or("it gave no output")?;
        let (shape, values) = output.try_extract_tensor::<f32>().map_err(one_line)?;
        // A negative size cannot be a result. As 0, the caller refuses it.
        let size = |&size: &i64| usize::try_from(size).unwrap_or(0);
        Ok((shape.iter().map(size).collect(), values.to_vec()))
    }
}

fn open(environment: &Environment, onnx: &[u8]) -> ort::Result<Session> {
    let builder = Session::builder(environment)?;
    builder.with_optimization_level(GraphOptimizationLevel::All)?.commit_from_memory(onnx)
}

fn outlet(outlet: &value::Outlet) -> Outlet {
    let (element, shape) = (outlet.dtype().tensor_type(), outlet.dtype().tensor_shape());
    // ONNX Runtime gives -1 for a size that the graph leaves open.
    let size = |&size: &i64| usize::try_from(size).ok();
    Outlet {
        is_f32: element == Some(TensorElementType::Float32),
        shape: shape.map(|shape| shape.iter().map(size).collect()).unwrap_or_default(),
        description: format!("{element:?} {shape:?}"),
    }
}

/// Opens the shared library at `path`, once per process. The environment, and name and version for people.
///
/// # Errors
/// The reason why tract is to be used instead.
pub(crate) fn start(path: &Path) -> Result<(Environment, String), String> {
    let builder = ort::init_from(path).map_err(|error| {
        format!("{DYLIB_VARIABLE} does not name a usable ONNX Runtime, so tract is used: {}", one_line(error))
    })?;
    // ort allows one environment in a process and hands it to nobody but its maker. If another part of the
    // program has made it, that part keeps it. Telemetry is a default of ONNX Runtime on Windows. A library
    // must not turn it on for its users.
    let environment = builder.with_name("stylegaussian").with_telemetry(false).build().map_err(|error| {
        let path = path.display();
        format!(
            "ONNX Runtime ({DYLIB_VARIABLE}={path}) cannot be started here, so tract is used: {}",
            one_line(error)
        )
    })?;
    Ok((environment, format!("ONNX Runtime {}, {}", onnx_runtime_version(path), path.display())))
}

/// From the file's name (`libonnxruntime.so.1.24.1`), else from `ORT Build Info: git-branch=rel-1.24.1, ...`:
/// `ort` has no other source of the version, and not every build's branch is named after it.
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
