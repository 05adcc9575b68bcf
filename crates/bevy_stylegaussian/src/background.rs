//! Values that are built in the background, so that a frame waits neither for a shader compiler nor for the packing of a
//! scene.

use bevy::{
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, futures::check_ready},
};

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
