//! Shaders of the style pass: hidden layers (`style_knn_conv`), the last layer (`style_color`), and the
//! smoothing passes behind it (`style_smoothing_pass`).

use bytemuck::{Pod, Zeroable};

use crate::{Source, constants};

/// Channels in a plane of activations: 8 f16 are a `vec4<u32>`, the widest load of a shader.
pub const PLANE_CHANNELS: u32 = 8;
/// Gaussians that a workgroup of `style_knn_conv` computes.
pub const ROWS_PER_WORKGROUP: u32 = 128;
/// Output channels that a workgroup of `style_knn_conv` computes, one number for each variant. 64 columns need
/// 256 invocations, as many as every adapter has; 32 columns leave none idle in the paper's narrowest hidden
/// layer.
pub const COLUMNS_PER_WORKGROUP: [u32; 2] = [32, 64];
/// Gaussians that a workgroup of `style_color` or `style_smoothing_pass` computes.
pub const COLOR_WORKGROUP_SIZE: u32 = 128;

const LAYER: &str = include_str!("../wgsl/style_layer.wgsl");

/// The number format of a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NumberFormat {
    /// Four bytes.
    F32,
    /// Two bytes.
    F16,
    /// One byte, for numbers in 0..1.
    Unorm8,
}

impl NumberFormat {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::F32, Self::F16, Self::Unorm8];

    /// Bytes of a number.
    pub const fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
            Self::Unorm8 => 1,
        }
    }

    fn read(self) -> &'static str {
        match self {
            Self::F32 => include_str!("../wgsl/style_read_f32.wgsl"),
            Self::F16 => include_str!("../wgsl/style_read_f16.wgsl"),
            Self::Unorm8 => include_str!("../wgsl/style_read_unorm8.wgsl"),
        }
    }

    fn write(self) -> &'static str {
        match self {
            Self::F32 => include_str!("../wgsl/style_write_f32.wgsl"),
            Self::F16 => include_str!("../wgsl/style_write_f16.wgsl"),
            Self::Unorm8 => include_str!("../wgsl/style_write_unorm8.wgsl"),
        }
    }
}

/// The part of one layer that a dispatch computes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct KnnLayer {
    /// Rows of a plane of the input.
    pub input_rows: u32,
    /// Rows of a plane of the output.
    pub output_rows: u32,
    /// First row of this dispatch within its block. The bound neighbor lists start at this row.
    pub first_row: u32,
    /// Rows of this dispatch.
    pub n_rows: u32,
    /// K, the neighbors of a Gaussian.
    pub k: u32,
    /// Planes of the layer's whole input.
    pub n_input_planes: u32,
    /// The first bound plane of the input.
    pub first_group_plane: u32,
    /// Bound planes of the input.
    pub n_group_planes: u32,
    /// First column (output channel) of this dispatch: the first channel of the first bound output plane. A
    /// multiple of 8 if planes are written.
    pub first_column: u32,
    /// Columns of this dispatch. A multiple of 8 if planes are written.
    pub n_columns: u32,
    /// vec4 in a row of weights.
    pub weight_stride: u32,
    /// 1 if earlier dispatches left sums over other planes.
    pub continues: u32,
    /// 1 if later dispatches add other planes to the sums of this one.
    pub is_continued: u32,
    /// The activation: the sigmoid if 1, else x for x > 0 and slope * x for the rest.
    pub is_sigmoid: u32,
    /// Slope of the activation below 0.
    pub slope: f32,
    /// Factor of the base color that is added to the result; 0 adds none.
    pub residual: f32,
    /// 1 if the block is a part of the scene and rows of the input are Gaussians.
    pub input_is_scene: u32,
    /// 1 if the block is a part of the scene and rows of the output are Gaussians.
    pub output_is_scene: u32,
    /// Unused.
    pub padding: [u32; 2],
}

/// A shader from the constants above and its files.
fn source(label: &'static str, files: &[&str]) -> Source {
    let constants = constants(&[
        ("PLANE_CHANNELS", PLANE_CHANNELS),
        ("ROWS_PER_WORKGROUP", ROWS_PER_WORKGROUP),
        ("COLOR_WORKGROUP_SIZE", COLOR_WORKGROUP_SIZE),
    ]);
    Source { label, wgsl: constants + &files.join("\n") }
}

/// A hidden layer. Its workgroups compute `columns` output channels.
pub fn knn_conv(columns: u32, input: NumberFormat, output: NumberFormat) -> Source {
    let columns = constants(&[("COLUMNS_PER_WORKGROUP", columns)]);
    let kernel = include_str!("../wgsl/style_knn_conv.wgsl");
    source("style_knn_conv", &[&columns, LAYER, input.read(), output.write(), kernel])
}

/// The last layer.
pub fn color(input: NumberFormat) -> Source {
    source("style_color", &[LAYER, input.read(), include_str!("../wgsl/style_color.wgsl")])
}

/// A smoothing pass over colors, behind the last layer.
pub fn smoothing_pass() -> Source {
    source("style_smoothing_pass", &[LAYER, include_str!("../wgsl/style_smoothing_pass.wgsl")])
}

/// Every joined source of the style pass.
pub fn sources() -> Vec<Source> {
    let formats = NumberFormat::ALL;
    let pairs = formats.map(|input| formats.map(|output| (input, output)));
    let hidden = pairs
        .as_flattened()
        .iter()
        .flat_map(|&(input, output)| COLUMNS_PER_WORKGROUP.map(|columns| knn_conv(columns, input, output)));
    hidden.chain(formats.map(color)).chain([smoothing_pass()]).collect()
}
