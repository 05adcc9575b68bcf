//! Long computations that tell how far they are, and stop soon if nobody wants them any more.

use std::{
    fmt,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
};

/// Nobody wants the result of a computation any more, so there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("canceled")]
pub struct Canceled;

/// Progress of a computation, and whether it is still wanted. Clones are of the same computation.
#[derive(Clone, Debug)]
pub struct Work {
    state: Arc<State>,
    /// Where this part of the computation begins, and its length: shares of the whole, 0..1.
    begin: f32,
    length: f32,
}

#[derive(Default)]
struct State {
    is_canceled: AtomicBool,
    /// Bits of an `f32`, 0..1. They are those of 0 at first, and of positive numbers they have the numbers'
    /// order.
    done: AtomicU32,
    /// Hears of each larger share.
    tell: Option<Box<Tell>>,
}

type Tell = dyn Fn(f32) + Send + Sync;

impl fmt::Debug for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("State").field("is_canceled", &self.is_canceled).field("done", &self.done).finish()
    }
}

impl Default for Work {
    fn default() -> Self {
        Self { state: Arc::default(), begin: 0.0, length: 1.0 }
    }
}

impl Work {
    /// A computation that calls `tell` with each larger share of it that is done, on the thread that computes.
    pub fn telling(tell: impl Fn(f32) + Send + Sync + 'static) -> Self {
        Self { state: Arc::new(State { tell: Some(Box::new(tell)), ..State::default() }), ..Self::default() }
    }

    /// Tells the computation to stop.
    pub fn cancel(&self) {
        self.state.is_canceled.store(true, Ordering::Relaxed);
    }

    /// Whether it was told to stop.
    pub fn is_canceled(&self) -> bool {
        self.state.is_canceled.load(Ordering::Relaxed)
    }

    /// Share of the whole computation that is done, 0..1.
    pub fn done(&self) -> f32 {
        f32::from_bits(self.state.done.load(Ordering::Relaxed))
    }

    /// Tells that a share of this part is done, 0..1. Threads may tell in any order: the largest share counts.
    ///
    /// # Errors
    /// If nobody wants the result any more.
    pub fn at(&self, share: f32) -> Result<(), Canceled> {
        let done = (self.begin + self.length * share.clamp(0.0, 1.0)).clamp(0.0, 1.0);
        let before = self.state.done.fetch_max(done.to_bits(), Ordering::Relaxed);
        if let Some(tell) = self.state.tell.as_ref().filter(|_| done.to_bits() > before) {
            tell(done);
        }
        self.check()
    }

    /// As [`at`](Self::at), without progress.
    ///
    /// # Errors
    /// If nobody wants the result any more.
    pub fn check(&self) -> Result<(), Canceled> {
        if self.is_canceled() { Err(Canceled) } else { Ok(()) }
    }

    /// Whether another one is of the same computation.
    pub fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.state, &other.state)
    }

    /// The part of this one between two shares of it, 0..1.
    #[must_use]
    pub fn part(&self, from: f32, to: f32) -> Self {
        Self {
            state: Arc::clone(&self.state),
            begin: self.begin + self.length * from,
            length: self.length * (to - from),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_tell_shares_of_the_whole() {
        let work = Work::default();
        assert_eq!(work.done(), 0.0);
        let second = work.part(0.5, 1.0);
        second.at(0.5).unwrap();
        assert_eq!(work.done(), 0.75);
        // A slower thread is late.
        work.part(0.0, 0.5).at(1.0).unwrap();
        assert_eq!(work.done(), 0.75);
        second.part(0.5, 1.0).at(1.0).unwrap();
        assert_eq!(work.done(), 1.0);
        assert!(second.is_same(&work) && !work.is_same(&Work::default()));
    }

    #[test]
    fn larger_shares_are_told() {
        let (send, told) = std::sync::mpsc::channel();
        let work = Work::telling(move |share| send.send(share).unwrap());
        for share in [0.0, 0.25, 0.5, 0.5, 0.25] {
            work.part(0.0, 0.5).at(share).unwrap();
        }
        assert_eq!(told.try_iter().collect::<Vec<_>>(), [0.125, 0.25]);
    }

    #[test]
    fn all_parts_are_canceled() {
        let work = Work::default();
        let part = work.part(0.0, 0.5);
        assert_eq!(part.at(0.1), Ok(()));
        work.clone().cancel();
        assert_eq!(part.at(0.2), Err(Canceled));
        assert_eq!(part.check(), Err(Canceled));
        assert!(work.is_canceled());
    }
}
