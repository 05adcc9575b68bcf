//! Shaders of the splat pass.

use crate::{Layout, Source};

/// Every joined source of the splat pass.
pub fn sources() -> Vec<Source> {
    Vec::new()
}

/// Every struct that the splat pass shares with Rust.
pub fn layouts() -> Vec<Layout> {
    Vec::new()
}
