//! The WGSL of `stylegaussian_gpu`, and the Rust twins of its structs.
//!
//! Each file in `wgsl/` has one purpose. Kernels that share code are joined from several files here, one level
//! deep, behind constants that Rust writes. A kernel's entry point, its file and its label have the same name.
//!
//! The tests of this crate validate joined texts only: [`style::sources`] and [`splat::sources`] list every
//! variant that is ever compiled, and `layouts` every struct that both sides read or write.

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

/// The memory layout of a Rust struct that is the twin of the WGSL struct of the same name.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Name of the struct on both sides.
    pub name: &'static str,
    /// Size in bytes.
    pub size: usize,
    /// Name and offset in bytes of every member, in order.
    pub members: Vec<(&'static str, usize)>,
}

/// The [`Layout`] of a struct: `layout!(Camera { position, up })`. It does not compile if a member is missing.
#[macro_export]
macro_rules! layout {
    ($name:ident { $($member:ident),+ $(,)? }) => {{
        // A pattern must name every member, so that a missing one is a compile error.
        let $name { $($member: _),+ } = <$name as ::bytemuck::Zeroable>::zeroed();
        $crate::Layout {
            name: stringify!($name),
            size: ::std::mem::size_of::<$name>(),
            members: vec![$((stringify!($member), ::std::mem::offset_of!($name, $member))),+],
        }
    }};
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
