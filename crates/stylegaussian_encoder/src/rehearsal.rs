//! Runs a foreign ONNX graph on tract once where a panic can be caught.
//!
//! tract panics over some malformed graphs, and over some sizes of the input. Behind ort's C interface a panic ends the
//! process, so a graph that is not ours first goes through tract's own interface, by the same steps that ort-tract
//! takes. What runs here runs there.

use std::{
    panic::{self, AssertUnwindSafe},
    sync::{Arc, Mutex, PoisonError},
    thread,
};

use tract_onnx::{pb::ValueInfoProto, prelude::*, tract_hir::infer::Factoid};

use crate::{
    encoder::{MIN_SIDE, PROBE_SIDE},
    network::MAX_VALUES,
};

/// Loads and runs a graph `[1, 3, H, W]` and gives the least side of an image that it takes.
///
/// Where the graph leaves height and width open it has to take any size above that, so an odd one is tried as well.
///
/// # Errors
/// What tract objected to, or panicked over; or that a step would need an absurd amount of memory.
pub(crate) fn rehearse(onnx: &[u8]) -> Result<u32, String> {
    let rehearsal = caught(|| Rehearsal::load(onnx))?;
    let run = |height, width| caught(|| rehearsal.run(height, width));
    run(PROBE_SIDE, PROBE_SIDE)?;
    if rehearsal.fixed[1..] != [None, None] {
        return Ok(MIN_SIDE);
    }
    run(PROBE_SIDE + 1, PROBE_SIDE + 7)?;
    let sides = [MIN_SIDE, 2 * MIN_SIDE, 4 * MIN_SIDE];
    let least = sides.into_iter().find(|&side| run(side as usize, side as usize).is_ok());
    Ok(least.unwrap_or(PROBE_SIDE as u32))
}

/// A graph ready to run.
struct Rehearsal {
    plan: Arc<TypedRunnableModel>,
    /// Channels, height and width, where the graph fixes them.
    fixed: [Option<usize>; 3],
}

impl Rehearsal {
    fn load(onnx: &[u8]) -> Result<Self, String> {
        let reader = tract_onnx::onnx();
        let proto = reader.proto_model_for_read(&mut &*onnx).map_err(text)?;
        let (inputs, outputs) =
            proto.graph.as_ref().map_or((&[][..], &[][..]), |graph| (&graph.input, &graph.output));
        let named = |values: &[ValueInfoProto]| values.len() == 1 && !values[0].name.contains('\0');
        if !named(inputs) || !named(outputs) {
            return Err(format!(
                "it has {} inputs and {} outputs, expected one of each",
                inputs.len(),
                outputs.len()
            ));
        }
        let parsed = reader.parse(&proto, None).map_err(text)?;
        if !parsed.unresolved_inputs.is_empty() {
            return Err(format!("nothing gives its values {:?}", parsed.unresolved_inputs));
        }
        let shape = parsed.model.input_fact(0).map_err(text)?.shape.clone();
        let fixed = |axis: usize| {
            let size = shape.dim(axis)?.concretize()?.to_i64().ok()?;
            usize::try_from(size).ok()
        };
        let fixed = [fixed(1), fixed(2), fixed(3)];
        check_memory(parsed.model.clone(), input_shape(fixed, PROBE_SIDE, PROBE_SIDE))?;
        let model = parsed.model.into_optimized().map_err(text)?;
        let plan = model.with_input_names([&inputs[0].name]).map_err(text)?.into_runnable().map_err(text)?;
        Ok(Self { plan, fixed })
    }

    /// Runs an image of this size, where the graph does not fix another one.
    fn run(&self, height: usize, width: usize) -> Result<(), String> {
        let shape = input_shape(self.fixed, height, width);
        let gray = vec![0.5_f32; shape.iter().product()];
        let input = Tensor::from_shape(&shape, &gray).map_err(text)?;
        self.plan.run(tvec!(input.into())).map(drop).map_err(text)
    }
}

fn input_shape(fixed: [Option<usize>; 3], height: usize, width: usize) -> [usize; 4] {
    [1, fixed[0].unwrap_or(3), fixed[1].unwrap_or(height), fixed[2].unwrap_or(width)]
}

/// Works out the size of everything the graph would compute, without computing it.
fn check_memory(model: InferenceModel, input: [usize; 4]) -> Result<(), String> {
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

/// tract's error with its causes, without the zero bytes that a C string cannot hold.
fn text(error: TractError) -> String {
    format!("{error:#}").replace('\0', "")
}

/// Turns a panic of `work` into an error, and keeps this thread's panic message from being printed.
fn caught<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    static HOOK: Mutex<()> = Mutex::new(());
    let _one_at_a_time = HOOK.lock().unwrap_or_else(PoisonError::into_inner);
    let previous = Arc::new(panic::take_hook());
    let (others, this_thread) = (Arc::clone(&previous), thread::current().id());
    panic::set_hook(Box::new(move |info| {
        if thread::current().id() != this_thread {
            others(info);
        }
    }));
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    panic::set_hook(Box::new(move |info| previous(info)));
    result.unwrap_or_else(|payload| {
        let message = payload.downcast_ref::<String>().map(String::as_str);
        let message =
            message.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("no reason given");
        Err(format!("the graph is malformed ({message})"))
    })
}
