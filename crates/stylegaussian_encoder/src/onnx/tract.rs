//! tract, the engine that is built in: an ONNX graph as an optimized plan.
//!
//! tract panics over some malformed graphs, and over some sizes of the input. Every call into it catches panics
//! and returns them as errors, so a user's file cannot end the program.

use tract_linalg::multithread::{Executor, multithread_tract_scope};
use tract_onnx::{prelude::*, tract_hir::infer::Factoid};

use super::engine::{MAX_VALUES, Outlet, Planes, Signature};
use crate::{
    guard::{guarded, one_line},
    image::PROBE_SIDE,
};

/// tract's version, for people. A test compares it with the workspace's manifest.
pub(crate) const VERSION: &str = "0.23";

/// A graph ready to run. All threads share it: each run has a state of its own.
pub(crate) struct Graph {
    plan: Arc<TypedRunnableModel>,
}

impl Graph {
    /// Parses and optimizes a graph of one input and one output.
    ///
    /// # Errors
    /// The reason of tract's refusal or panic; or that a step needs an absurd amount of memory.
    pub(crate) fn load(onnx: &[u8]) -> Result<(Self, Signature), String> {
        caught(|| {
            let plan = plan(onnx)?;
            let model = plan.model();
            let outlets = |ids: &[OutletId]| -> Result<Vec<Outlet>, String> {
                ids.iter().map(|&id| model.outlet_fact(id).map(outlet).map_err(text)).collect()
            };
            let signature = Signature { inputs: outlets(&model.inputs)?, outputs: outlets(&model.outputs)? };
            Ok((Self { plan }, signature))
        })
    }

    /// Runs the graph. The first output's shape and values.
    ///
    /// # Errors
    /// The reason of tract's refusal or panic, or that the input is too small for the graph.
    pub(crate) fn run(&self, input: &Planes) -> Result<(Vec<usize>, Vec<f32>), String> {
        // The panic is caught inside, because the scope restores its thread's executor only on return.
        multithread_tract_scope(executor(), || {
            caught(|| {
                check_sizes(self.plan.model(), input.shape())?;
                let input = Tensor::from_shape(&input.shape(), &input.values).map_err(text)?;
                let outputs = self.plan.run(tvec!(input.into())).map_err(text)?;
                let output = outputs.first().ok_or("it gave no output")?;
                let values =
                    output.try_as_plain_ram().and_then(|plain| plain.as_slice::<f32>()).map_err(text)?;
                Ok((output.shape().to_vec(), values.to_vec()))
            })
        })
    }
}

/// The threads of a run's matrix products: rayon's, since a single image would leave the other cores idle. If
/// the caller is one of them, it works alone. A thread of rayon's that waits for a product takes up other work,
/// perhaps another run, which would find tract's scratch memory of this thread borrowed, and panic.
fn executor() -> Executor {
    if rayon::current_thread_index().is_some() { Executor::SingleThread } else { Executor::RayonGlobal }
}

fn plan(onnx: &[u8]) -> Result<Arc<TypedRunnableModel>, String> {
    let reader = tract_onnx::onnx();
    let proto = reader.proto_model_for_read(&mut &*onnx).map_err(text)?;
    let (n_inputs, n_outputs) =
        proto.graph.as_ref().map_or((0, 0), |graph| (graph.input.len(), graph.output.len()));
    if (n_inputs, n_outputs) != (1, 1) {
        return Err(format!("it has {n_inputs} inputs and {n_outputs} outputs, expected one of each"));
    }
    let parsed = reader.parse(&proto, None).map_err(text)?;
    if !parsed.unresolved_inputs.is_empty() {
        return Err(format!("nothing gives its values {:?}", parsed.unresolved_inputs));
    }
    // Before optimization, which may compute constants of any size.
    check_memory(parsed.model.clone())?;
    parsed.model.into_optimized().and_then(|model| model.into_runnable()).map_err(text)
}

/// Infers the size of everything that the graph would compute for an image of [`PROBE_SIDE`], without computing
/// it. A file of a few bytes can ask for terabytes.
fn check_memory(model: InferenceModel) -> Result<(), String> {
    let shape = model.input_fact(0).map_err(text)?.shape.clone();
    // A size that the graph fixes must be kept: any other would contradict the graph.
    let fixed = |axis: usize| {
        let size = shape.dim(axis)?.concretize()?.to_i64().ok()?;
        usize::try_from(size).ok()
    };
    let input = [1, fixed(1).unwrap_or(3), fixed(2).unwrap_or(PROBE_SIDE), fixed(3).unwrap_or(PROBE_SIDE)];
    let model = model.with_input_fact(0, f32::fact(input).into()).and_then(|model| model.into_typed());
    let model = model.map_err(text)?;
    let mut facts = model.nodes().iter().flat_map(|node| &node.outputs);
    let is_small =
        |shape: &ShapeFact| shape.volume().to_i64().is_ok_and(|volume| volume <= MAX_VALUES as i64);
    if facts.all(|output| is_small(&output.fact.shape)) {
        return Ok(());
    }
    Err(format!("for an input of {input:?} a step of it makes more than {MAX_VALUES} values"))
}

/// Checks that every step of the graph makes values of an input of this shape. tract does not: a convolution
/// over less than its kernel reads past its input, which no `catch_unwind` survives.
fn check_sizes(model: &TypedModel, input: [usize; 4]) -> Result<(), String> {
    let mut sizes = SymbolValues::default();
    for (size, value) in model.input_fact(0).map_err(text)?.shape.iter().zip(input) {
        if let TDim::Sym(symbol) = size {
            // Open sizes are symbols. With their values, the size of each step is a number.
            sizes.set(symbol, value as i64);
        }
    }
    // Constants may be empty, such as the region of interest that exporters give to a Resize.
    let is_possible = |size: &TDim| {
        let least = if matches!(size, TDim::Val(_)) { 0 } else { 1 };
        // A size that depends on values is not known beforehand.
        size.eval_to_i64(&sizes).ok().is_none_or(|size| size >= least)
    };
    for node in model.nodes() {
        if let Some(output) = node.outputs.iter().find(|output| !output.fact.shape.iter().all(is_possible)) {
            let sizes: Vec<String> =
                output.fact.shape.iter().map(|size| size.eval(&sizes).to_string()).collect();
            return Err(format!("it is too small: step `{}` would make [{}]", node.name, sizes.join(", ")));
        }
    }
    Ok(())
}

fn outlet(fact: &TypedFact) -> Outlet {
    let size = |size: &TDim| size.to_i64().ok().and_then(|size| usize::try_from(size).ok());
    let is_f32 = fact.datum_type == f32::datum_type();
    Outlet { is_f32, shape: fact.shape.iter().map(size).collect(), description: format!("{fact:?}") }
}

/// tract's error with its causes, without the zero bytes that names in a damaged file may bring into it.
fn text(error: TractError) -> String {
    // `{:#}` prints the whole chain of causes.
    one_line(format_args!("{error:#}")).replace('\0', "")
}

/// Turns a panic of `work` into an error.
fn caught<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    guarded(work).unwrap_or_else(|message| Err(format!("the graph is malformed ({message})")))
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use super::*;

    #[test]
    fn version_is_the_manifests() {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../Cargo.toml");
        let manifest = fs::read_to_string(manifest).unwrap();
        let lines: Vec<&str> = manifest
            .lines()
            .filter(|line| line.starts_with("tract-") && !line.contains("opt-level"))
            .collect();
        assert_eq!(lines.len(), 2);
        assert!(lines.iter().all(|line| line.contains(&format!("\"{VERSION}\""))), "{lines:?}");
    }

    #[test]
    fn panics_become_errors() {
        assert_eq!(caught(|| Ok(7)), Ok(7));
        let index = std::hint::black_box(3);
        let error = caught(|| Ok([1, 2][index])).unwrap_err();
        assert!(error.starts_with("the graph is malformed (index out of bounds"), "{error}");
    }
}
