//! Values that are built in the background, so that a frame waits neither for a shader compiler nor for the
//! packing of a scene.

use bevy::{
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, futures::check_ready},
};

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

/// A value that is being built by a task, or is ready.
pub(crate) enum Background<T> {
    /// The task that builds it.
    // Dropping the value drops the task, and Bevy cancels a task that is dropped.
    Building(Task<T>),
    /// The value.
    Ready(T),
}

impl<T: Send + 'static> Background<T> {
    /// Starts a task that builds a value.
    pub(crate) fn spawn(build: impl FnOnce() -> T + Send + 'static) -> Self {
        Self::Building(AsyncComputeTaskPool::get().spawn(async move { build() }))
    }

    /// Builds a value at once if `synchronous`, otherwise starts a task that does.
    pub(crate) fn start(
        synchronous: SynchronousCompilation,
        build: impl FnOnce() -> T + Send + 'static,
    ) -> Self {
        if synchronous.0 { Self::Ready(build()) } else { Self::spawn(build) }
    }

    /// The value, or `None` if it is still being built.
    pub(crate) fn poll(&mut self) -> Option<&T> {
        if let Self::Building(task) = self {
            // A finished task must not be polled again, so its value replaces it at once.
            *self = Self::Ready(check_ready(task)?);
        }
        self.get()
    }

    /// The value, or `None` if no [`poll`](Self::poll) has found it ready yet.
    pub(crate) fn get(&self) -> Option<&T> {
        match self {
            Self::Ready(value) => Some(value),
            Self::Building(_) => None,
        }
    }
}
