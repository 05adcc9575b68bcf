//! The threads that bake, and the way of their results to the main thread.

use std::{
    num::NonZero,
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use bevy::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use stylegaussian::{Scene, look, strokes::Strokes};

use crate::style::{error::StyleError, images};

use super::engine::{Baking, Engine};

/// Everything that a bake is made from.
pub(super) struct Request {
    pub(super) scene: Arc<Scene>,
    /// The paintings' names for messages, their pixels and their weights.
    pub(super) paintings: Vec<(String, Image, f32)>,
    pub(super) steps: u32,
    /// Number of results, at least 1.
    pub(super) n_shown: u32,
    /// Share of the base colors in the results, 0..1.
    pub(super) content: f64,
    /// The strokes that are shown.
    pub(super) strokes: Option<Arc<Strokes>>,
}

/// A look that is better than the last one.
pub(super) struct Better {
    /// Colors `[N]` in scene order.
    pub(super) colors: Arc<[[f32; 3]]>,
    /// The strokes over them; those that are shown already if they are the same, which then stay as they are
    /// while colors fade.
    pub(super) strokes: Option<Arc<Strokes>>,
    /// Steps that gave them.
    pub(super) steps: u32,
}

/// A bake under way. Dropping it cancels the bake at its next step.
pub(crate) struct Running(Arc<Shared>);

#[derive(Default)]
struct Shared {
    is_canceled: AtomicBool,
    /// The newest result that nobody has taken.
    newest: Mutex<Option<Result<Better, StyleError>>>,
}

impl Running {
    /// The newest result, once.
    pub(super) fn take(&self) -> Option<Result<Better, StyleError>> {
        self.0.newest.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.0.is_canceled.store(true, Ordering::Relaxed);
    }
}

impl Shared {
    fn publish(&self, result: Result<Better, StyleError>) {
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
    }
}

/// Priority of the threads, of 0 to 99. On Linux it is niceness 5: where all cores are busy, such a thread gets
/// a third of the time of a usual one (weights 335 and 1024 of the kernel's scheduler). At the lowest priority
/// it would stand still beside a renderer that is a CPU.
#[cfg(not(target_family = "wasm"))]
const PRIORITY: u8 = 35;

/// The threads that bake: a quarter of the cores, at a low priority, for all entities together.
#[derive(Resource, Default)]
// Made at the first bake: games that refine nothing have no such threads.
pub(crate) struct RefineThreads(OnceLock<Option<ThreadPool>>);

impl RefineThreads {
    /// Number of threads.
    pub(super) fn count() -> usize {
        // The rest is the game's, which has a main and a render thread at least.
        (std::thread::available_parallelism().map_or(1, NonZero::get) / 4).max(1)
    }

    /// Queues a bake.
    pub(super) fn run(&self, engine: &Engine, request: Request) -> Running {
        let shared = Arc::<Shared>::default();
        let running = Running(Arc::clone(&shared));
        match self.0.get_or_init(build) {
            Some(pool) => {
                let engine = engine.clone();
                // The kernels of the bake find this pool by themselves, since they run inside of it.
                pool.spawn(move || bake(&engine, request, &shared));
            }
            None => shared.publish(Err(StyleError::Refine("no thread can be started".into()))),
        }
        running
    }
}

fn build() -> Option<ThreadPool> {
    let pool = ThreadPoolBuilder::new()
        .num_threads(RefineThreads::count())
        .thread_name(|index| format!("style refine {index}"))
        .start_handler(|_| lower_priority())
        // A panic has been printed by now, and without a handler rayon would end the game. The bake gives no
        // result.
        .panic_handler(|_| {})
        .build();
    pool.inspect_err(|error| error!("styles are not refined: {error}")).ok()
}

/// Gives this thread a low [`PRIORITY`]. Best effort: where it is not allowed, a few threads of usual priority
/// remain.
#[cfg(not(target_family = "wasm"))]
fn lower_priority() {
    use thread_priority::{ThreadPriority, ThreadPriorityValue, set_current_thread_priority};

    if let Ok(priority) = ThreadPriorityValue::try_from(PRIORITY) {
        let _ = set_current_thread_priority(ThreadPriority::Crossplatform(priority));
    }
}

/// Does nothing: a browser has no such threads, and none can be started.
#[cfg(target_family = "wasm")]
fn lower_priority() {}

/// Bakes until all steps are done or nobody wants the result any more.
fn bake(engine: &Engine, request: Request, shared: &Shared) {
    // Bakes that wait in the queue may be canceled before they begin.
    if shared.is_canceled.load(Ordering::Relaxed) {
        return;
    }
    if let Err(error) = try_bake(engine, request, shared) {
        shared.publish(Err(error));
    }
}

fn try_bake(engine: &Engine, request: Request, shared: &Shared) -> Result<(), StyleError> {
    let Request { scene, paintings, steps, n_shown, content, strokes } = request;
    let paintings =
        paintings.into_iter().map(|(name, image, weight)| Ok((images::decoded(name, image)?, weight)));
    let mut baking = engine.begin(&scene, paintings.collect::<Result<_, StyleError>>()?, steps)?;
    let strokes = strokes_of(&*baking, content, strokes);
    for step in 1..=steps {
        if shared.is_canceled.load(Ordering::Relaxed) {
            return Ok(());
        }
        baking.step(&scene);
        // The k-th result comes with the first step that has done k / n_shown of them all.
        let results = |steps_done: u32| u64::from(steps_done) * u64::from(n_shown) / u64::from(steps);
        if results(step) > results(step - 1) {
            let colors = look::mix(&scene.base_colors(), content, &[(baking.colors().to_vec(), 1.0)], None)?;
            shared.publish(Ok(Better { colors: colors.into(), strokes: strokes.clone(), steps: step }));
        }
    }
    Ok(())
}

/// The strokes of a bake beside a share of the base colors, or those that are `shown` if they are the same.
fn strokes_of(baking: &dyn Baking, content: f64, shown: Option<Arc<Strokes>>) -> Option<Arc<Strokes>> {
    let mut strokes = baking.strokes().clone();
    if strokes.seeds.is_empty() {
        return None;
    }
    if content > 0.0 {
        strokes.fade(1.0 - content as f32);
    }
    match shown {
        Some(shown) if *shown == strokes => Some(shown),
        _ => Some(Arc::new(strokes)),
    }
}
