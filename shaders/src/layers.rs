//! The shaders that mix looks in space: `mix_layers` their colors, `mix_strokes` their strokes.

use bytemuck::{Pod, Zeroable};
use stylegaussian::strokes;

use crate::{Source, constants, float_constants};

/// Gaussians in a block.
pub const MIX_BLOCK: u32 = 64;
/// Invocations in a workgroup of `mix_layers`: a few blocks, because a workgroup costs something by itself.
pub const MIX_WORKGROUP: u32 = 256;
/// Layers that a dispatch mixes at most: one for each bit of a word.
pub const MIX_LAYERS: u32 = 32;
/// Looks that a dispatch reads at most: WebGPU guarantees 8 storage buffers, and 4 are taken.
pub const MIX_LOOKS: u32 = 4;
/// Added to the index of a block whose colors start as the captured ones.
pub const STARTS: u32 = 1 << 31;
/// `MixLayer::look` of a layer that shows the captured colors.
pub const NO_LOOK: u32 = u32::MAX;
/// `MixLayer::look` of a layer that changes the strokes below.
pub const BELOW: u32 = u32::MAX - 1;
/// `MixLayer::mask` of a layer without a mask.
pub const NO_MASK: u32 = u32::MAX;

/// The shape of a layer: all of space.
pub const SHAPE_EVERYTHING: u32 = 0;
/// The shape of a layer: y below 0.
pub const SHAPE_HALF_SPACE: u32 = 1;
/// The shape of a layer: radii.
pub const SHAPE_ELLIPSOID: u32 = 2;
/// The shape of a layer: half sizes.
pub const SHAPE_CUBOID: u32 = 3;
/// The shape of a layer: radius, half height.
pub const SHAPE_CYLINDER: u32 = 4;
/// The shape of a layer: radius, half length.
pub const SHAPE_CAPSULE: u32 = 5;
/// The shape of a layer: radius, height.
pub const SHAPE_CONE: u32 = 6;
/// The shape of a layer: major radius, minor radius.
pub const SHAPE_TORUS: u32 = 7;
/// The shape of a layer: size, level.
pub const SHAPE_NOISE: u32 = 8;

/// A look in a region.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MixLayer {
    /// Rows of the shape's space from the scene's.
    pub shape_from_scene_x: [f32; 4],
    /// The second row.
    pub shape_from_scene_y: [f32; 4],
    /// The third row.
    pub shape_from_scene_z: [f32; 4],
    /// Sizes of the shape.
    pub sizes: [f32; 4],
    /// Number of the look among those of the dispatch, [`NO_LOOK`] or [`BELOW`].
    pub look: u32,
    /// Channel of the mask, or [`NO_MASK`].
    pub mask: u32,
    /// Share of the colors below that is replaced within the region, 0..1.
    pub strength: f32,
    /// Width of the edge.
    pub softness: f32,
    /// 1 / softness, or 0 for a hard edge.
    pub inverse_softness: f32,
    /// The shape, one of the `SHAPE_` constants.
    pub shape: u32,
    /// Added to the seeds of the look's strokes, or to those that it changes.
    pub first_seed: u32,
    /// Factors of the strokes below that are changed, as f16: of the share that is shown, and of protection.
    pub factors: u32,
}

/// Layers that are mixed in one dispatch.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct MixStack {
    /// The layers, the lowest first.
    pub layers: [MixLayer; MIX_LAYERS as usize],
    /// Gaussians in the chunk.
    pub n_gaussians: u32,
    /// Index of the chunk's first Gaussian in its scene.
    pub first_gaussian: u32,
    /// Index of the first of the dispatch's blocks.
    pub first_block: u32,
    /// Number of the dispatch's blocks.
    pub n_blocks: u32,
}

/// A block of a dispatch.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct MixBlock {
    /// Its index in its chunk, and [`STARTS`] if it starts from the captured colors.
    pub index: u32,
    /// A bit for each layer that reaches it.
    pub touches: u32,
    /// A bit for each layer whose region it lies within.
    pub within: u32,
}

/// The shapes of regions, which other kernels join, too.
pub(crate) fn regions() -> String {
    let constants = constants(&[
        ("SHAPE_EVERYTHING", SHAPE_EVERYTHING),
        ("SHAPE_HALF_SPACE", SHAPE_HALF_SPACE),
        ("SHAPE_ELLIPSOID", SHAPE_ELLIPSOID),
        ("SHAPE_CUBOID", SHAPE_CUBOID),
        ("SHAPE_CYLINDER", SHAPE_CYLINDER),
        ("SHAPE_CAPSULE", SHAPE_CAPSULE),
        ("SHAPE_CONE", SHAPE_CONE),
        ("SHAPE_TORUS", SHAPE_TORUS),
    ]);
    constants + include_str!("../wgsl/regions.wgsl")
}

/// A kernel from the constants above, the regions, and its own file.
fn source(label: &'static str, more: &str, kernel: &str) -> Source {
    let constants = constants(&[
        ("MIX_BLOCK", MIX_BLOCK),
        ("MIX_WORKGROUP", MIX_WORKGROUP),
        ("MIX_LAYERS", MIX_LAYERS),
        ("STARTS", STARTS),
        ("NO_LOOK", NO_LOOK),
        ("NO_MASK", NO_MASK),
    ]);
    let wgsl = [&constants, more, &regions(), include_str!("../wgsl/mix_regions.wgsl"), kernel].join("\n");
    Source { label, wgsl }
}

/// The kernel that mixes colors.
pub fn mix_layers() -> Source {
    source("mix_layers", "", include_str!("../wgsl/mix_layers.wgsl"))
}

/// The kernel that mixes strokes.
pub fn mix_strokes() -> Source {
    let integers = constants(&[
        ("SEED_BITS", strokes::SEED_BITS),
        ("SEVEN_BITS", strokes::SEVEN_BITS),
        ("BELOW", BELOW),
    ]);
    let more = integers + &float_constants(&[("EDGE", strokes::EDGE)]);
    source("mix_strokes", &more, include_str!("../wgsl/mix_strokes.wgsl"))
}

/// Every joined source.
pub fn sources() -> Vec<Source> {
    vec![mix_layers(), mix_strokes()]
}
