//! Panics of other libraries over a user's file, returned as errors, and the messages of both on one line.
//!
//! Decoders of images and the graph engine panic over some malformed files. Every call that shows them a user's
//! file catches that. The panic hook of the process still hears of it first and prints a message by default.
//! The hook belongs to the program, which can ask [`is_guarded`] whether a panic will become an error.

use std::{
    cell::Cell,
    fmt,
    panic::{self, AssertUnwindSafe},
};

thread_local! {
    /// Guarded calls that this thread is in.
    static DEPTH: Cell<u32> = const { Cell::new(0) };
}

/// Whether this thread is in a call whose panic becomes an error.
pub fn is_guarded() -> bool {
    DEPTH.get() > 0
}

/// The message of another library on one line, as all of ours are: some end theirs with a new line.
pub(crate) fn one_line(message: impl fmt::Display) -> String {
    message.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Runs `work`. If it panics, the error is the panic's message.
///
/// # Errors
/// As `work`, or if it panics.
pub(crate) fn guarded<T, E>(work: impl FnOnce() -> Result<T, E>) -> Result<Result<T, E>, String> {
    DEPTH.set(DEPTH.get() + 1);
    // Unwind safe: unfinished results are dropped with the panic, and shared data is only read.
    let outcome = panic::catch_unwind(AssertUnwindSafe(work));
    DEPTH.set(DEPTH.get() - 1);
    outcome.map_err(|payload| {
        // `panic!` with arguments carries a `String`, without any a `&str`.
        let message = payload.downcast_ref::<String>().map(String::as_str);
        one_line(message.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("no reason given"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_become_errors() {
        assert_eq!(guarded(|| Ok::<_, ()>(7)), Ok(Ok(7)));
        assert_eq!(guarded(|| Ok::<_, ()>(is_guarded())), Ok(Ok(true)));
        let index = std::hint::black_box(3);
        let error = guarded(|| Ok::<_, ()>([1, 2][index])).unwrap_err();
        assert!(error.starts_with("index out of bounds"), "{error}");
        // Comparisons have a line for each side.
        let error = guarded(|| {
            assert_eq!(index, 4);
            Ok::<_, ()>(())
        });
        assert_eq!(error.unwrap_err(), "assertion `left == right` failed left: 3 right: 4");
        assert!(!is_guarded());
    }
}
