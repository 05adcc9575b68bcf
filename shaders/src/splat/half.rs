//! Shaders of layers of half the width and height.

use bytemuck::{Pod, Zeroable};

use super::text::source;
use crate::Source;

const HALF: &str = include_str!("../../wgsl/splat_half.wgsl");

/// Finds the depths that low pixels are tested against.
pub fn depth() -> Source {
    source("splat_half_depth", &[HALF, include_str!("../../wgsl/splat_half_depth.wgsl")])
}

/// Makes the whole layer of a low one.
pub fn upsample() -> Source {
    source("splat_half_upsample", &[HALF, include_str!("../../wgsl/splat_half_upsample.wgsl")])
}

/// The uniforms of both.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatHalf {
    /// Left, top, width and height of the whole viewport, in pixels of the target.
    pub viewport: [f32; 4],
    /// Depths that differ by much more than x d + y, at depth d, are those of two surfaces.
    pub limit: [f32; 2],
    /// Unused.
    pub padding: [f32; 2],
}
