//! Shaders of iso depth: from the lists of tiles, or by quads in slices.

use bytemuck::{Pod, Zeroable};

use super::{
    text::{QUADS, RECORDS, source},
    tiles::{ROWS, TILES},
};
use crate::{Source, constants};

/// Slices that quads are drawn in. On the demo scene, twice as many bring the mean error from 0.26% of the
/// distance to 0.18%, and half as many to 0.35%. Each costs a pass over the pixels.
pub const N_SLICES: u32 = 16;
/// Invocations along a side of a workgroup of `splat_slices_cross`.
pub const SLICES_SIDE: u32 = 8;

const DEPTH: &str = include_str!("../../wgsl/splat_depth.wgsl");
const SLICES: &str = include_str!("../../wgsl/splat_slices.wgsl");

/// The uniforms of all kernels of iso depth.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatIso {
    /// Left, top, width and height of the viewport that splats are drawn in, in its own pixels.
    pub viewport: [f32; 4],
    /// Left and top of the picture in the depth attachment, in pixels of that.
    pub place: [f32; 2],
    /// Pixels of the attachment along a side of one of the viewport.
    pub step: f32,
    /// Share of the light, 0.02..1.
    pub threshold: f32,
    /// The slice that is drawn.
    pub slice: u32,
    /// Unused.
    pub padding_0: u32,
    /// Unused.
    pub padding_1: u32,
    /// Unused.
    pub padding_2: u32,
}

fn slice_constants() -> String {
    constants(&[("N_SLICES", N_SLICES), ("SLICES_SIDE", SLICES_SIDE)])
}

/// Finds iso depths from the lists of tiles.
pub fn tiles() -> Source {
    let (untested, kernel) = (
        include_str!("../../wgsl/splat_tiles_untested.wgsl"),
        include_str!("../../wgsl/splat_tiles_depth.wgsl"),
    );
    source("splat_tiles_depth", &[RECORDS, TILES, untested, ROWS, DEPTH, kernel])
}

/// Writes the draw of a slice.
pub fn slices_commands() -> Source {
    let kernel = include_str!("../../wgsl/splat_slices_commands.wgsl");
    source("splat_slices_commands", &[&slice_constants(), RECORDS, SLICES, kernel])
}

/// Draws a slice into its moments of depth.
pub fn slices_draw() -> Source {
    let draw = include_str!("../../wgsl/splat_slices_draw.wgsl");
    source("splat_slices_draw", &[&slice_constants(), RECORDS, QUADS, DEPTH, SLICES, draw])
}

/// Finds where a slice brings the light under the threshold.
pub fn slices_cross() -> Source {
    let kernel = include_str!("../../wgsl/splat_slices_cross.wgsl");
    source("splat_slices_cross", &[&slice_constants(), RECORDS, DEPTH, SLICES, kernel])
}

/// Writes iso depths into a depth attachment.
pub fn write() -> Source {
    source("splat_depth_write", &[DEPTH, include_str!("../../wgsl/splat_depth_write.wgsl")])
}
