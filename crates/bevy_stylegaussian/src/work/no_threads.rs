//! Lanes of a browser, whose page has one thread.

use std::sync::Arc;

use bevy::tasks::AsyncComputeTaskPool;

use super::{Job, Lane, StyleThreads};

/// No threads: a job is a task on the page's only one.
#[derive(Default)]
pub(super) struct Lanes;

impl Lanes {
    /// Has no threads to set.
    pub(super) fn set(&self, _: StyleThreads) {}

    /// Does a job soon.
    pub(super) fn queue(self: &Arc<Self>, _: Lane, job: Job) {
        AsyncComputeTaskPool::get().spawn(async move { job() }).detach();
    }
}
