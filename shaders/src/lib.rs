//! The WGSL of `stylegaussian_gpu`, and the Rust twins of its structs.
//!
//! Each file in `wgsl/` has one purpose. Kernels that share code are joined from several files here, one level
//! deep, behind constants that Rust writes. A kernel's entry point, its file and its label have the same name.
//!
//! The tests of this crate validate joined texts only: [`style::sources`] and [`splat::sources`] list every
//! variant that is ever compiled. They compare every struct that both sides read or write.

pub mod layers;
pub mod mesh;
pub mod paint;
pub mod splat;
pub mod style;

/// One joined shader.
#[derive(Clone, Debug)]
pub struct Source {
    /// The stem of the kernel's file. It is also the kernel's entry point and its label on the GPU; shaders
    /// with two entry points append `_vertex` and `_fragment`.
    pub label: &'static str,
    /// The joined text that is compiled.
    pub wgsl: String,
}

/// WGSL declarations of `u32` constants.
fn constants(constants: &[(&str, u32)]) -> String {
    constants.iter().map(|(name, value)| format!("const {name}: u32 = {value}u;\n")).collect()
}

/// WGSL declarations of `f32` constants.
fn float_constants(constants: &[(&str, f32)]) -> String {
    // `{:?}` writes the shortest digits that parse to the same f32.
    constants.iter().map(|(name, value)| format!("const {name}: f32 = {value:?}f;\n")).collect()
}
