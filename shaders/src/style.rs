//! Shaders of the style pass.

use crate::{Layout, Source};

/// Every joined source of the style pass.
pub fn sources() -> Vec<Source> {
    Vec::new()
}

/// Every struct that the style pass shares with Rust.
pub fn layouts() -> Vec<Layout> {
    Vec::new()
}
