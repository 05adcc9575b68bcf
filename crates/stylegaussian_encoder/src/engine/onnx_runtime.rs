//! ONNX Runtime, the engine for users who have its shared library: an ONNX graph as a session.

use std::sync::{Mutex, PoisonError};

use ort::{
    environment::Environment,
    session::{Session, builder::GraphOptimizationLevel},
    value::{self, TensorElementType, TensorRef},
};

use super::{Outlet, Planes, Signature};

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
        let session = open(environment, onnx).map_err(|error| error.to_string())?;
        let outlets = |outlets: &[value::Outlet]| outlets.iter().map(outlet).collect();
        let signature = Signature { inputs: outlets(session.inputs()), outputs: outlets(session.outputs()) };
        Ok((Self { session: Mutex::new(session) }, signature))
    }

    /// Runs the graph. The first output's shape and values.
    ///
    /// # Errors
    /// The reason of ONNX Runtime's refusal.
    pub(crate) fn run(&self, input: &Planes) -> Result<(Vec<usize>, Vec<f32>), String> {
        let text = |error: ort::Error| error.to_string();
        // Borrows the input: ONNX Runtime reads it in place.
        let tensor = TensorRef::from_array_view((input.shape(), &input.values[..])).map_err(text)?;
        // A session has no state that a panic of another thread could have left half done.
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let outputs = session.run(ort::inputs![tensor]).map_err(text)?;
        let (_, output) = outputs.iter().next().ok_or("it gave no output")?;
        let (shape, values) = output.try_extract_tensor::<f32>().map_err(text)?;
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
