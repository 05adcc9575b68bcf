//! An ONNX graph ready to run: `[1, C, H, W]` in, `[1, D, h, w]` out, from any number of threads.

use std::sync::{Mutex, PoisonError};

use ort::{
    session::{Session, builder::GraphOptimizationLevel},
    value::{Outlet, TensorElementType, TensorRef},
};
use tract_linalg::multithread::{Executor, multithread_tract_scope};

use crate::runtime::{Engine, Runtime, RuntimeError};

/// Most values that a graph may take, or a step of it make, when it is tried: 1 GiB. VGG's largest step makes 2^18 of
/// 64x64 pixels.
pub(crate) const MAX_VALUES: usize = 1 << 28;

/// A graph of one image-like input and one image-like output.
pub struct Network {
    name: String,
    onnx: Vec<u8>,
    runtime: &'static Runtime,
    /// ONNX Runtime: the one session, which uses all cores by itself. tract: sessions at rest, one per thread so far.
    sessions: Mutex<Vec<Session>>,
    input: [Option<usize>; 3],
    output_channels: Option<usize>,
}

/// Values `[1, channels, height, width]`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// Number of planes.
    pub channels: usize,
    /// Rows of each plane.
    pub height: usize,
    /// Columns of each plane.
    pub width: usize,
    /// `[channels, height, width]`.
    pub values: Vec<f32>,
}

/// An ONNX graph could not be loaded or run.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// No engine.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The engine refused the graph.
    #[error("{name}: {runtime} cannot load this ONNX graph: {reason}")]
    Load {
        /// The graph's file.
        name: String,
        /// The engine.
        runtime: String,
        /// What the engine said.
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
        /// What the engine said.
        reason: String,
    },
    /// The graph is not of the kind that is needed here.
    #[error("{name}: the ONNX graph's {what} is {found}, expected {expected}")]
    Signature {
        /// The graph's file.
        name: String,
        /// Which part.
        what: &'static str,
        /// What the file has.
        found: String,
        /// What is needed.
        expected: String,
    },
}

impl Network {
    /// Loads a graph; `name` is for messages.
    ///
    /// # Errors
    /// When the bytes are no ONNX graph that the engine can run, or when it is not one f32 tensor `[1, C, H, W]` to
    /// one f32 tensor `[1, D, h, w]` (unknown sizes are allowed).
    pub fn load(name: impl Into<String>, onnx: Vec<u8>) -> Result<Self, NetworkError> {
        let name = name.into();
        let runtime = Runtime::get()?;
        let session = start(&name, &onnx, runtime)?;
        let [_, channels, height, width] = image_like(&name, "input", session.inputs())?;
        let fixed = [channels, height, width].into_iter().flatten();
        if fixed.map(|size| size as f64).product::<f64>() > MAX_VALUES as f64 {
            return Err(NetworkError::Signature {
                name,
                what: "input",
                found: shape_text(&[channels, height, width]),
                expected: format!("at most {MAX_VALUES} values"),
            });
        }
        let [_, output_channels, ..] = image_like(&name, "output", session.outputs())?;
        Ok(Self {
            onnx,
            runtime,
            sessions: Mutex::new(vec![session]),
            input: [channels, height, width],
            output_channels,
            name,
        })
    }

    /// What messages call it: its file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The engine.
    pub fn runtime(&self) -> &'static Runtime {
        self.runtime
    }

    /// Channels, height and width of the input, where the graph fixes them.
    pub fn input(&self) -> [Option<usize>; 3] {
        self.input
    }

    /// Channels of the output, where the graph states them.
    pub fn output_channels(&self) -> Option<usize> {
        self.output_channels
    }

    /// Runs the graph on planes of one image.
    ///
    /// # Errors
    /// When the input's shape is not the graph's, or the engine fails.
    pub fn run(&self, input: &Planes) -> Result<Planes, NetworkError> {
        self.check_input(input)?;
        match self.runtime.engine {
            Engine::OnnxRuntime => {
                let mut sessions = self.lock();
                match sessions.first_mut() {
                    Some(session) => self.run_session(session, input),
                    None => Err(self.run_error(input, "its session is gone")),
                }
            }
            Engine::Tract => {
                let resting = self.lock().pop();
                let mut session = match resting {
                    Some(session) => session,
                    None => start(&self.name, &self.onnx, self.runtime)?,
                };
                // Products on all cores, by the threads that everything else here uses: one image alone would leave the
                // others idle.
                let output =
                    multithread_tract_scope(Executor::RayonGlobal, || self.run_session(&mut session, input));
                let mut sessions = self.lock();
                if sessions.len() < rayon::current_num_threads() {
                    sessions.push(session);
                }
                output
            }
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<Session>> {
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn check_input(&self, input: &Planes) -> Result<(), NetworkError> {
        let found = [input.channels, input.height, input.width];
        let fits = self.input.iter().zip(found).all(|(fixed, size)| fixed.is_none_or(|fixed| fixed == size));
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

    fn run_session(&self, session: &mut Session, input: &Planes) -> Result<Planes, NetworkError> {
        let shape = [1, input.channels, input.height, input.width];
        let failed = |error: ort::Error| self.run_error(input, &error.to_string());
        let tensor = TensorRef::from_array_view((shape, &input.values[..])).map_err(failed)?;
        let outputs = session.run(ort::inputs![tensor]).map_err(failed)?;
        let (_, value) = outputs.iter().next().ok_or_else(|| self.run_error(input, "it gave no output"))?;
        let (shape, values) = value.try_extract_tensor::<f32>().map_err(failed)?;
        match shape[..] {
            [1, channels, height, width] if channels > 0 && height > 0 && width > 0 => Ok(Planes {
                channels: channels as usize,
                height: height as usize,
                width: width as usize,
                values: values.to_vec(),
            }),
            _ => Err(self.signature("output", format!("{shape:?}"), "[1, channels, height, width]".into())),
        }
    }

    fn run_error(&self, input: &Planes, reason: &str) -> NetworkError {
        NetworkError::Run {
            name: self.name.clone(),
            runtime: self.runtime.name().into(),
            input: vec![1, input.channels, input.height, input.width],
            reason: reason.into(),
        }
    }

    fn signature(&self, what: &'static str, found: String, expected: String) -> NetworkError {
        NetworkError::Signature { name: self.name.clone(), what, found, expected }
    }
}

fn start(name: &str, onnx: &[u8], runtime: &'static Runtime) -> Result<Session, NetworkError> {
    let failed =
        |reason: String| NetworkError::Load { name: name.into(), runtime: runtime.name().into(), reason };
    Session::builder(&runtime.environment)
        .map_err(|error| failed(error.to_string()))?
        .with_optimization_level(GraphOptimizationLevel::All)
        .map_err(|error| failed(error.to_string()))?
        .commit_from_memory(onnx)
        .map_err(|error| failed(error.to_string()))
}

/// The shape of the only input or output, `None` where it is unknown, when it is one f32 tensor `[1, _, _, _]`.
fn image_like(
    name: &str,
    what: &'static str,
    outlets: &[Outlet],
) -> Result<[Option<usize>; 4], NetworkError> {
    let wrong = |found: String| NetworkError::Signature {
        name: name.into(),
        what,
        found,
        expected: "one f32 tensor [1, channels, height, width]".into(),
    };
    let [outlet] = outlets else {
        return Err(wrong(format!("{} tensors", outlets.len())));
    };
    let shape = outlet.dtype().tensor_shape().map(|shape| shape.to_vec());
    match (outlet.dtype().tensor_type(), shape.as_deref()) {
        (Some(TensorElementType::Float32), Some(&[batch, ref sizes @ ..]))
            if sizes.len() == 3 && batch <= 1 =>
        {
            let known = |size: i64| usize::try_from(size).ok();
            Ok([known(batch), known(sizes[0]), known(sizes[1]), known(sizes[2])])
        }
        (element, shape) => Err(wrong(format!("{element:?} {shape:?}"))),
    }
}

/// `[3, any, any]`.
fn shape_text(shape: &[Option<usize>]) -> String {
    let sizes: Vec<String> =
        shape.iter().map(|size| size.map_or_else(|| "any".into(), |size| size.to_string())).collect();
    format!("[{}]", sizes.join(", "))
}
