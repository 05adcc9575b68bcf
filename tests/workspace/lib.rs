//! Nothing but doc tests: the tests beside this file and the examples join the crates of the workspace.

/// The examples of the repository's README. They are not among the plugin's doc tests: its package does not
/// have that file.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
mod readme {}
