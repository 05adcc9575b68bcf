//! Work in the background: the only place that starts any.
//!
//! It runs on threads of our own, because Bevy's pool for computations has one thread on up to five cores, and
//! a game's own tasks would wait behind a painting. Each [`Lane`] does one thing after another, on a few
//! threads of low priority ([`StyleThreads`]). Dropping what [`Workers::start`] returns stops the computation.
//! Pipelines alone are compiled in tasks of Bevy ([`Background::start`]). A browser has no threads: there, a
//! worker (`browser`) lays on paint, and all else is a task on the page's only one.

#[cfg(target_family = "wasm")]
pub(crate) mod browser;
#[cfg(any(test, target_family = "wasm"))]
mod script;
#[cfg_attr(target_family = "wasm", path = "work/no_threads.rs")]
mod threads;

use std::{
    num::NonZero,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use async_lock::OnceCell;
use bevy::{prelude::*, tasks::AsyncComputeTaskPool};
use stylegaussian::work::{Canceled, Work};

use threads::Lanes;

/// Threads of long computations: painting, surfaces, encoding, bakes, reading scenes. Set it at any time; the
/// next computation follows it.
///
/// Each of four groups has so many threads of its own: scenes, styles, bakes, and what is shorter, such as
/// looks. They are started when first used. A browser has none.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Resource, Clone, Debug, Default, PartialEq)]
pub struct StyleThreads {
    /// Threads of each group, at least 1.
    pub count: usize,
    /// Priority of the threads, from 0 (lowest) to 99; usual ones have about 50. On Linux the niceness is
    /// 19 - 0.4 of it. Best effort: if the system refuses it, threads have the usual priority.
    pub priority: u8,
}

impl Default for StyleThreads {
    /// A quarter of the cores, with niceness 5 on Linux. If all cores are busy, such a thread gets a third of
    /// the time of a usual one (weights 335 and 1024 of the kernel's scheduler). At the lowest priority it
    /// would stand still beside a renderer that is a CPU.
    fn default() -> Self {
        // The rest is the game's, which has a main and a render thread at least.
        let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
        Self { count: (cores / 4).max(1), priority: 35 }
    }
}

/// A group of computations, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lane {
    /// Scenes: reading, packing, indexes.
    Scenes,
    /// Styles: canvases, encoding, surfaces, paint, decoding.
    Styles,
    /// Bakes, which take minutes.
    #[cfg_attr(not(feature = "refine"), allow(dead_code, reason = "`StyleRefine` alone bakes"))]
    Bakes,
    /// Shorter work, which must not wait for the others: reading looks, masks and other small files, mixing
    /// looks, moving strokes to pins, first colors.
    Short,
}

/// Starts computations. Clones share threads.
#[derive(Resource, Clone, Default)]
pub(crate) struct Workers(Arc<Lanes>);

/// A computation of a lane.
type Job = Box<dyn FnOnce() + Send>;

/// A computation that was started. Dropping it cancels the computation.
pub(crate) struct Running<T> {
    work: Work,
    result: Arc<OnceCell<Result<T, Canceled>>>,
}

impl<T> Drop for Running<T> {
    fn drop(&mut self) {
        self.work.cancel();
    }
}

impl<T> Running<T> {
    /// The result, or `None` until it is there. [`Canceled`] if the computation panicked.
    pub(crate) fn get(&self) -> Option<&Result<T, Canceled>> {
        self.result.get()
    }

    /// Share of the computation that is done, 0..1.
    pub(crate) fn done(&self) -> f32 {
        if self.result.is_initialized() { 1.0 } else { self.work.done() }
    }

    /// Waits for the result.
    pub(crate) async fn wait(&self) -> &Result<T, Canceled> {
        self.result.wait().await
    }
}

impl<T: Send + Sync + 'static> Running<T> {
    /// A computation, and the job that does it.
    fn new(compute: impl FnOnce(&Work) -> Result<T, Canceled> + Send + 'static) -> (Self, Job) {
        let running = Self { work: Work::default(), result: Arc::default() };
        let (work, result) = (running.work.clone(), Arc::clone(&running.result));
        let job = move || {
            // Those that wait in the queue may be canceled before they begin.
            let computed = work.check().and_then(|()| {
                // The panic has been printed. It must not end the thread that others wait for.
                catch_unwind(AssertUnwindSafe(|| compute(&work))).unwrap_or(Err(Canceled))
            });
            // Nobody else sets it.
            let _ = result.try_set(computed);
        };
        (running, Box::new(job))
    }
}

/// The value of a computation that ends with it: nobody else waits for it.
pub(crate) async fn taken<T>(running: Running<Mutex<Option<T>>>) -> Result<T, Canceled> {
    match running.wait().await {
        Ok(value) => unpoisoned(value).take().ok_or(Canceled),
        Err(canceled) => Err(*canceled),
    }
}

/// Makes a value that [`taken`] takes.
pub(crate) fn for_one<T>(value: T) -> Result<Mutex<Option<T>>, Canceled> {
    Ok(Mutex::new(Some(value)))
}

impl Workers {
    /// Starts a computation after all that were started before it in its lane.
    pub(crate) fn start<T: Send + Sync + 'static>(
        &self,
        lane: Lane,
        compute: impl FnOnce(&Work) -> Result<T, Canceled> + Send + 'static,
    ) -> Running<T> {
        let (running, job) = Running::new(compute);
        self.0.queue(lane, job);
        running
    }

    /// As [`start`](Self::start), for computations that pause: in a browser, whose page has one thread, others
    /// run meanwhile.
    #[cfg(not(target_family = "wasm"))]
    pub(crate) fn start_async<T: Send + Sync + 'static, F: Future<Output = Result<T, Canceled>>>(
        &self,
        lane: Lane,
        compute: impl FnOnce(Work) -> F + Send + 'static,
    ) -> Running<T> {
        self.start(lane, |work| bevy::tasks::block_on(compute(work.clone())))
    }

    #[cfg(target_family = "wasm")]
    pub(crate) fn start_async<T: 'static, F: Future<Output = Result<T, Canceled>> + 'static>(
        &self,
        _: Lane,
        compute: impl FnOnce(Work) -> F + 'static,
    ) -> Running<T> {
        let running = Running { work: Work::default(), result: Arc::default() };
        let (work, result) = (running.work.clone(), Arc::clone(&running.result));
        let computation = async move {
            let computed = match work.check() {
                Ok(()) => compute(work).await,
                Err(canceled) => Err(canceled),
            };
            let _ = result.try_set(computed);
        };
        AsyncComputeTaskPool::get().spawn(computation).detach();
        running
    }

    /// Has further threads started by these settings.
    pub(crate) fn set(&self, threads: StyleThreads) {
        self.0.set(threads);
    }
}

/// Locks what no panic leaves half done.
fn unpoisoned<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Adds [`Workers`] to both worlds.
pub(crate) struct WorkPlugin;

impl Plugin for WorkPlugin {
    fn build(&self, app: &mut App) {
        let workers = Workers::default();
        app.init_resource::<StyleThreads>()
            .register_type::<StyleThreads>()
            .insert_resource(workers.clone())
            .add_systems(First, set_threads.run_if(resource_changed::<StyleThreads>));
        #[cfg(target_family = "wasm")]
        app.add_systems(Last, browser::stop_canceled);
        if let Some(render_app) = app.get_sub_app_mut(bevy::render::RenderApp) {
            render_app.insert_resource(workers);
        }
    }
}

fn set_threads(threads: Res<StyleThreads>, workers: Res<Workers>) {
    workers.set(*threads);
}

/// Pauses for a computation in [slices](stylegaussian::slices) of a task. On threads they pass at once. In a
/// browser, where tasks run on the page's only thread, a pause lets it draw and answer if the last one was 8 ms
/// ago.
#[cfg(not(target_family = "wasm"))]
pub(crate) fn pauses() -> impl FnMut() -> std::future::Ready<()> + Send + Sync {
    || std::future::ready(())
}

#[cfg(target_family = "wasm")]
pub(crate) use page::pauses;

/// Pauses in a browser.
#[cfg(target_family = "wasm")]
mod page {
    use std::{cell::Cell, rc::Rc, time::Duration};

    use bevy::platform::time::Instant;
    use js_sys::{Function, Promise};
    use wasm_bindgen::prelude::wasm_bindgen;
    use wasm_bindgen_futures::JsFuture;

    /// Time between pauses: less than a frame at 60 frames per second takes.
    const SLICE: Duration = Duration::from_millis(8);

    #[wasm_bindgen]
    extern "C" {
        #[wasm_bindgen(js_name = setTimeout)]
        fn set_timeout(call: &Function, milliseconds: i32);
    }

    pub(crate) fn pauses() -> impl FnMut() -> std::pin::Pin<Box<dyn Future<Output = ()>>> {
        let resumed = Rc::new(Cell::new(Instant::now()));
        move || {
            let resumed = Rc::clone(&resumed);
            Box::pin(async move {
                if resumed.get().elapsed() >= SLICE {
                    // A promise that is kept at once would be kept before the page draws; a timeout comes
                    // after.
                    let timeout = Promise::new(&mut |keep, _| set_timeout(&keep, 0));
                    let _ = JsFuture::from(timeout).await;
                    resumed.set(Instant::now());
                }
            })
        }
    }
}

/// If true, pipelines and scenes are built on the render thread and the frame waits for them.
#[derive(Resource, Clone, Copy)]
pub(crate) struct SynchronousCompilation(pub(crate) bool);

/// A value that is being built, or is ready.
pub(crate) enum Background<T> {
    /// The computation. Dropping the value cancels it.
    Building(Running<T>),
    /// The value.
    Ready(T),
}

impl<T: Send + Sync + 'static> Background<T> {
    /// Compiles pipelines at once if `synchronous`, otherwise in a task of Bevy.
    pub(crate) fn start(
        synchronous: SynchronousCompilation,
        compile: impl FnOnce() -> T + Send + 'static,
    ) -> Self {
        if synchronous.0 {
            return Self::Ready(compile());
        }
        let (running, job) = Running::new(move |_| Ok(compile()));
        // Bevy compiles its own there. The driver does it, not we, and nothing is drawn before: a lane would
        // have it wait for a scene, at a low priority.
        AsyncComputeTaskPool::get().spawn(async move { job() }).detach();
        Self::Building(running)
    }

    /// The value, or `None` if it is still being built.
    pub(crate) fn get(&self) -> Option<&T> {
        match self {
            Self::Ready(value) => Some(value),
            Self::Building(running) => running.get()?.as_ref().ok(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{
        sync::mpsc,
        time::{Duration, Instant},
    };

    use bevy::tasks::block_on;

    use super::*;

    #[test]
    fn a_lane_does_one_thing_after_another() {
        let (workers, (send, received)) = (Workers::default(), mpsc::channel());
        let all: Vec<_> = (0..20)
            .map(|i| {
                let send = send.clone();
                workers.start(Lane::Styles, move |_| {
                    // A job that waits for others of its pool does not begin the next one meanwhile.
                    rayon::join(|| std::thread::sleep(Duration::from_millis(1)), || ());
                    send.send(i).unwrap();
                    Ok(i)
                })
            })
            .collect();
        for (i, running) in all.iter().enumerate() {
            assert_eq!(*block_on(running.wait()), Ok(i));
        }
        assert_eq!(received.try_iter().collect::<Vec<_>>(), Vec::from_iter(0..20));
    }

    #[test]
    fn what_is_dropped_is_stopped_at_once_and_a_panic_ends_only_itself() {
        let workers = Workers::default();
        let (send, stopped) = mpsc::channel();
        let forever = workers.start(Lane::Styles, move |work: &Work| -> Result<(), Canceled> {
            while work.at(0.5).is_ok() {
                std::thread::sleep(Duration::from_millis(1));
            }
            send.send(Instant::now()).unwrap();
            Err(Canceled)
        });
        let never = workers.start(Lane::Styles, |_| -> Result<(), Canceled> { panic!("it was canceled") });
        let panics = workers.start(Lane::Styles, |_| -> Result<(), Canceled> { panic!("on purpose") });
        let last = workers.start(Lane::Styles, |_| Ok(7));
        let begun = Instant::now();
        while forever.done() < 0.5 {
            assert!(begun.elapsed().as_secs() < 60, "it never began");
            std::thread::yield_now();
        }
        assert!(last.get().is_none(), "it waits for its turn");
        drop(never);
        let dropped = Instant::now();
        drop(forever);
        assert!(stopped.recv().unwrap() - dropped < Duration::from_millis(50));
        assert_eq!(*block_on(panics.wait()), Err(Canceled));
        assert_eq!(*block_on(last.wait()), Ok(7));
        assert_eq!(last.done(), 1.0);
    }

    #[test]
    fn lanes_do_not_wait_for_one_another_and_follow_the_settings() {
        let workers = Workers::default();
        workers.set(StyleThreads { count: 3, priority: 10 });
        let (send, wait) = mpsc::channel::<()>();
        let bake = workers.start(Lane::Bakes, move |_| {
            let _ = wait.recv();
            Ok(())
        });
        let style = workers.start(Lane::Styles, |_| Ok(rayon::current_num_threads()));
        assert_eq!(*block_on(style.wait()), Ok(3));
        assert!(bake.get().is_none());
        send.send(()).unwrap();
        assert_eq!(*block_on(bake.wait()), Ok(()));
    }
}
