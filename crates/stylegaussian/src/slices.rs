//! Long computations in slices, between which others may run: a page in a browser has one thread for computing
//! and drawing.
//!
//! A function `NAME_in_slices` awaits its `pause` between slices of some milliseconds. Whoever has threads lets
//! the pauses pass: [`at_once`].

use std::{
    future::Future,
    pin::pin,
    task::{Context, Poll, Waker},
};

/// Gaussians in a slice. The passes over a scene take 0.2 to 2 ms for a thousand of them in a browser, so a
/// slice is longer than it takes to look at the clock and shorter than a frame.
pub const SLICE: usize = 4096;

/// The result of a computation whose pauses never wait, such as one with `|| std::future::ready(())`.
///
/// # Panics
/// If it waits.
pub fn at_once<T>(computation: impl Future<Output = T>) -> T {
    match pin!(computation).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => panic!("found a pause that waits, expected none"),
    }
}
