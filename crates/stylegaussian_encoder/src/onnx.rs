//! ONNX graphs of others, with the feature `onnx`: `[1, C, H, W]` in, `[1, D, h, w]` out, from any number of
//! threads.
//!
//! The engine is tract, which is pure Rust and built in. If `ORT_DYLIB_PATH` names a shared library of ONNX
//! Runtime (1.24 or later), that is used instead; see [`runtime`].

mod engine;
mod onnx_runtime;
pub mod runtime;
mod tract;

pub use engine::Planes;

use engine::{MAX_VALUES, Outlet, Signature};
use runtime::Runtime;

/// A graph of one image-like input and one image-like output, ready to run.
pub struct Graph {
    name: String,
    engine: Engine,
    input: [Option<usize>; 3],
}

/// A loaded graph, by the engine that runs it.
enum Engine {
    Tract(tract::Graph),
    OnnxRuntime(onnx_runtime::Graph),
}

/// An ONNX graph could not be loaded or run.
#[derive(Debug, thiserror::Error)]
pub enum OnnxError {
    /// The engine refused the graph.
    #[error("{name}: {runtime} cannot load this ONNX graph: {reason}")]
    Load {
        /// The graph's file.
        name: String,
        /// The engine.
        runtime: String,
        /// The engine's message.
        reason: String,
    },
    /// The engine failed while running the graph.
    #[error("{name}: {runtime} cannot run this ONNX graph on an input of {input:?}: {reason}")]
    Run {
        /// The graph's file.
        name: String,
        /// The engine.
        runtime: String,
        /// Shape of the input.
        input: Vec<usize>,
        /// The engine's message.
        reason: String,
    },
    /// The graph's input or output has another type or shape than needed here.
    #[error("{name}: the ONNX graph's {what} is {found}, expected {expected}")]
    Signature {
        /// The graph's file.
        name: String,
        /// The part of the graph: its input or its output.
        what: &'static str,
        /// The file's type and shape.
        found: String,
        /// The type and shape that are needed.
        expected: String,
    },
}

impl Engine {
    fn load(runtime: &Runtime, onnx: &[u8]) -> Result<(Self, Signature), String> {
        Ok(match runtime.environment() {
            None => {
                let (graph, signature) = tract::Graph::load(onnx)?;
                (Self::Tract(graph), signature)
            }
            Some(environment) => {
                let (graph, signature) = onnx_runtime::Graph::load(environment, onnx)?;
                (Self::OnnxRuntime(graph), signature)
            }
        })
    }

    fn run(&self, input: &Planes) -> Result<(Vec<usize>, Vec<f32>), String> {
        match self {
            Self::Tract(graph) => graph.run(input),
            Self::OnnxRuntime(graph) => graph.run(input),
        }
    }
}

impl Graph {
    /// Loads a graph; `name` is for messages.
    ///
    /// # Errors
    /// If the bytes are no ONNX graph that the engine can run, if a step of it needs an absurd amount of
    /// memory, or if it does not lead from one f32 tensor `[1, C, H, W]` to one f32 tensor `[1, D, h, w]` (open
    /// sizes are allowed).
    pub fn load(name: impl Into<String>, onnx: Vec<u8>) -> Result<Self, OnnxError> {
        let (name, runtime) = (name.into(), Runtime::get());
        let (engine, signature) = match Engine::load(runtime, &onnx) {
            Ok(loaded) => loaded,
            Err(reason) => return Err(OnnxError::Load { name, runtime: runtime.name().into(), reason }),
        };
        let input = image_like(&name, "input", &signature.inputs)?;
        // ONNX Runtime would take this input; the probe would have to allocate it.
        // In f64, since the product of three sizes from a file may overflow a `usize`.
        if input.iter().flatten().map(|&size| size as f64).product::<f64>() > MAX_VALUES as f64 {
            return Err(OnnxError::Signature {
                name,
                what: "input",
                found: shape_text(&input),
                expected: format!("at most {MAX_VALUES} values"),
            });
        }
        image_like(&name, "output", &signature.outputs)?;
        Ok(Self { name, engine, input })
    }

    /// The engine.
    pub fn runtime(&self) -> &'static Runtime {
        Runtime::get()
    }

    /// Channels, height and width of the input; `None` for each that the graph leaves open.
    pub fn input(&self) -> [Option<usize>; 3] {
        self.input
    }

    /// Runs the graph on planes of one image.
    ///
    /// # Errors
    /// If the input's shape is not the graph's, or if the engine fails.
    pub fn run(&self, input: &Planes) -> Result<Planes, OnnxError> {
        self.check_input(input)?;
        let (shape, values) = self.engine.run(input).map_err(|reason| OnnxError::Run {
            name: self.name.clone(),
            runtime: self.runtime().name().into(),
            input: input.shape().to_vec(),
            reason,
        })?;
        match shape[..] {
            [1, channels, height, width] if channels > 0 && height > 0 && width > 0 => {
                Ok(Planes { channels, height, width, values })
            }
            _ => Err(self.signature("output", format!("{shape:?}"), "[1, channels, height, width]".into())),
        }
    }

    /// A gray RGB image of this size, or of the graph's own size if it fixes one.
    pub(crate) fn gray(&self, height: usize, width: usize) -> Planes {
        let [_, fixed_height, fixed_width] = self.input;
        // Three channels in any case: a graph of another number is refused by `check_input`, with a message.
        let (height, width) = (fixed_height.unwrap_or(height), fixed_width.unwrap_or(width));
        Planes { channels: 3, height, width, values: vec![0.5; 3 * height * width] }
    }

    fn check_input(&self, input: &Planes) -> Result<(), OnnxError> {
        let found = [input.channels, input.height, input.width];
        let fits = self.input.iter().zip(found).all(|(fixed, size)| fixed.is_none_or(|fixed| fixed == size));
        // The fields are public, so their product may overflow.
        let n_values = found.iter().try_fold(1_usize, |product, &size| product.checked_mul(size));
        if fits && n_values == Some(input.values.len()) && !input.values.is_empty() {
            return Ok(());
        }
        Err(self.signature(
            "input [channels, height, width]",
            shape_text(&self.input),
            format!("{found:?}, as the given {} values are meant", input.values.len()),
        ))
    }

    fn signature(&self, what: &'static str, found: String, expected: String) -> OnnxError {
        OnnxError::Signature { name: self.name.clone(), what, found, expected }
    }
}

/// Channels, height and width of the only input or output, if it is one f32 tensor `[1, C, H, W]`; `None` for
/// each that is open.
fn image_like(name: &str, what: &'static str, outlets: &[Outlet]) -> Result<[Option<usize>; 3], OnnxError> {
    let wrong = |found: String| OnnxError::Signature {
        name: name.into(),
        what,
        found,
        expected: "one f32 tensor [1, channels, height, width]".into(),
    };
    let [outlet] = outlets else {
        return Err(wrong(format!("{} tensors", outlets.len())));
    };
    match outlet.shape[..] {
        [None | Some(0 | 1), channels, height, width] if outlet.is_f32 => Ok([channels, height, width]),
        _ => Err(wrong(outlet.description.clone())),
    }
}

/// `[3, any, any]`.
fn shape_text(shape: &[Option<usize>]) -> String {
    let sizes: Vec<String> =
        shape.iter().map(|size| size.map_or_else(|| "any".into(), |size| size.to_string())).collect();
    format!("[{}]", sizes.join(", "))
}
