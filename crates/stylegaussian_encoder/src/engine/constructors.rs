//! tract's list of kernels in a browser, where nothing fills it by itself.
//!
//! tract gathers its kernels with the crate `inventory`: each announces itself in a constructor, which systems
//! run as they load a program. A wasm module's constructors run if something calls them, and rustc does not see
//! to it.

use std::sync::Once;

#[expect(unsafe_code, reason = "a function of the linker")]
unsafe extern "C" {
    /// Runs all constructors of the module. The linker writes it.
    fn __wasm_call_ctors();
}

static RUN: Once = Once::new();

/// Fills tract's list. Call it before tract; further calls do nothing.
pub(super) fn run() {
    #[expect(unsafe_code, reason = "only the linker knows the constructors")]
    // SAFETY: constructors of `inventory` may run again, if Bevy or the page has run them before. Rust has no
    // others.
    RUN.call_once(|| unsafe { __wasm_call_ctors() });
}
