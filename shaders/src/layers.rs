//! The shader that mixes looks in space: `mix_layers`.

use bytemuck::{Pod, Zeroable};

use crate::{Layout, Source, constants, layout};

/// Layers of one dispatch: 784 bytes of uniforms, and twice the volumes of a room of paintings.
pub const MAX_LAYERS: usize = 8;
/// Looks of one dispatch. With colors, Gaussians and masks these are 7 storage buffers, of the 8 that WebGPU grants.
pub const MAX_LOOKS: usize = 4;
/// Invocations in a workgroup of `mix_layers`.
pub const MIX_WORKGROUP: u32 = 128;
/// `MixLayer::look` of the captured colors.
pub const NO_LOOK: u32 = u32::MAX;
/// `MixLayer::mask` of a layer without a mask.
pub const NO_MASK: u32 = u32::MAX;

/// `MixLayer::shape`: all of space.
pub const SHAPE_EVERYTHING: u32 = 0;
/// `MixLayer::shape`: y below 0.
pub const SHAPE_HALF_SPACE: u32 = 1;
/// `MixLayer::shape`: radii.
pub const SHAPE_ELLIPSOID: u32 = 2;
/// `MixLayer::shape`: half sizes.
pub const SHAPE_CUBOID: u32 = 3;
/// `MixLayer::shape`: radius, half height.
pub const SHAPE_CYLINDER: u32 = 4;
/// `MixLayer::shape`: radius, half length.
pub const SHAPE_CAPSULE: u32 = 5;
/// `MixLayer::shape`: radius, height.
pub const SHAPE_CONE: u32 = 6;
/// `MixLayer::shape`: major radius, minor radius.
pub const SHAPE_TORUS: u32 = 7;
/// `MixLayer::shape`: size, level.
pub const SHAPE_NOISE: u32 = 8;

/// Colors in a region.
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
    /// One of the `SHAPE_` constants.
    pub shape: u32,
    /// Index of the look, or [`NO_LOOK`].
    pub look: u32,
    /// Channel of the mask, or [`NO_MASK`].
    pub mask: u32,
    /// Share of the colors below that is replaced within the region, 0..1.
    pub strength: f32,
    /// Width of the edge.
    pub softness: f32,
    /// 1 / softness, or 0 for a hard edge.
    pub inverse_softness: f32,
    /// Unused.
    pub padding: [u32; 2],
}

/// The layers of one dispatch.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LayerMix {
    /// Layers in use.
    pub n_layers: u32,
    /// Gaussians in the chunk.
    pub n_gaussians: u32,
    /// Index of the chunk's first Gaussian in its scene.
    pub first_gaussian: u32,
    /// 1 if the layers lie on the colors that are there, 0 if on the captured ones.
    pub continues: u32,
    /// The layers, the lowest first.
    pub layers: [MixLayer; MAX_LAYERS],
}

/// The kernel.
pub fn mix_layers() -> Source {
    let constants = constants(&[
        ("MAX_LAYERS", MAX_LAYERS as u32),
        ("MIX_WORKGROUP", MIX_WORKGROUP),
        ("NO_MASK", NO_MASK),
        ("SHAPE_EVERYTHING", SHAPE_EVERYTHING),
        ("SHAPE_HALF_SPACE", SHAPE_HALF_SPACE),
        ("SHAPE_ELLIPSOID", SHAPE_ELLIPSOID),
        ("SHAPE_CUBOID", SHAPE_CUBOID),
        ("SHAPE_CYLINDER", SHAPE_CYLINDER),
        ("SHAPE_CAPSULE", SHAPE_CAPSULE),
        ("SHAPE_CONE", SHAPE_CONE),
        ("SHAPE_TORUS", SHAPE_TORUS),
    ]);
    Source { label: "mix_layers", wgsl: constants + include_str!("../wgsl/mix_layers.wgsl") }
}

/// Every joined source.
pub fn sources() -> Vec<Source> {
    vec![mix_layers()]
}

/// Every struct that the shader shares with Rust.
pub fn layouts() -> Vec<Layout> {
    vec![
        layout!(MixLayer {
            shape_from_scene_x,
            shape_from_scene_y,
            shape_from_scene_z,
            sizes,
            shape,
            look,
            mask,
            strength,
            softness,
            inverse_softness,
            padding,
        }),
        layout!(LayerMix { n_layers, n_gaussians, first_gaussian, continues, layers }),
    ]
}
