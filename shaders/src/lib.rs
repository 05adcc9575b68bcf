//! The WGSL of `stylegaussian_gpu`, and the Rust twins of its structs.
//!
//! One file in `wgsl/` has one purpose; kernels that share code are joined from strings here, one level deep. What is
//! validated (see the crate's tests) is always the joined text, so [`style::sources`] and [`splat::sources`] list every
//! variant that is ever compiled, and their `layouts` every struct that both sides write or read.

pub mod splat;
pub mod style;

/// One joined shader.
#[derive(Clone, Debug)]
pub struct Source {
    /// The stem of the kernel's file, and its label on the GPU.
    pub label: &'static str,
    /// The joined text, as it is compiled.
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

/// The [`Layout`] of a struct: `layout!(Camera { position, up })`. Leaving a member out fails to compile.
#[macro_export]
macro_rules! layout {
    ($name:ident { $($member:ident),+ $(,)? }) => {{
        // A pattern that names every member: one that is missing here is a compile error.
        let $name { $($member: _),+ } = <$name as ::bytemuck::Zeroable>::zeroed();
        $crate::Layout {
            name: stringify!($name),
            size: ::std::mem::size_of::<$name>(),
            members: vec![$((stringify!($member), ::std::mem::offset_of!($name, $member))),+],
        }
    }};
}
