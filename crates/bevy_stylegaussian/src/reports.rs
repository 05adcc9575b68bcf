//! Messages from the render world to the main world.

use std::sync::{Arc, Mutex, PoisonError};

use bevy::prelude::*;

/// A queue of reports. Both worlds hold the same one: the render world pushes, the main world takes.
#[derive(Resource)]
pub(crate) struct Reports<T>(Arc<Mutex<Vec<T>>>);

// By hand: a derived `Clone` would ask for `T: Clone`. The same holds for `Default`.
impl<T> Clone for Reports<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T> Default for Reports<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T> Reports<T> {
    /// Adds a report.
    pub(crate) fn push(&self, report: T) {
        // A panic elsewhere cannot leave a vector of reports half written, so a poisoned lock is still good.
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(report);
    }

    /// Removes and returns all reports, oldest first.
    pub(crate) fn take(&self) -> Vec<T> {
        // The lock is held for a swap or a push and never while another is taken, so the worlds cannot block
        // each other.
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
