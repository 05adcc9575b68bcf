//! GPU objects that are built in the background: a frame waits neither for a shader compiler nor for the packing of a
//! scene.

use bevy::{
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, block_on, poll_once},
};

/// Whether a frame waits for what it needs, instead.
#[derive(Resource, Clone, Copy)]
pub(crate) struct AtOnce(pub(crate) bool);

/// Something that is being built, or is.
pub(crate) enum Built<T> {
    /// Not yet.
    Building(Task<T>),
    /// Ready for use.
    Ready(T),
}

impl<T: Send + 'static> Built<T> {
    /// Starts to build, or with `at_once` builds.
    pub(crate) fn start(at_once: bool, build: impl FnOnce() -> T + Send + 'static) -> Self {
        if at_once {
            return Self::Ready(build());
        }
        Self::Building(AsyncComputeTaskPool::get().spawn(async move { build() }))
    }

    /// What was built, once it is.
    pub(crate) fn poll(&mut self) -> Option<&T> {
        if let Self::Building(task) = self {
            *self = Self::Ready(block_on(poll_once(task))?);
        }
        self.get()
    }

    /// What was built, if [`poll`](Self::poll) has found it ready before.
    pub(crate) fn get(&self) -> Option<&T> {
        match self {
            Self::Ready(built) => Some(built),
            Self::Building(_) => None,
        }
    }
}
