//! Shaders of the style pass: hidden layers (`style_knn_conv`), the last one (`style_color`), and the averages behind it
//! (`style_smoothing_pass`).

use bytemuck::{Pod, Zeroable};

use crate::{Layout, Source, layout};

/// What all kernels share: the layer's shape and buffers.
pub const LAYER: &str = include_str!("../wgsl/style_layer.wgsl");
/// A hidden layer, without its number of columns and without how its input and output are kept.
pub const KNN_CONV: &str = include_str!("../wgsl/style_knn_conv.wgsl");
/// The last layer, without how its input is kept.
pub const COLOR: &str = include_str!("../wgsl/style_color.wgsl");

/// An average of colors over windows, behind the last layer.
pub const SMOOTHING_PASS: &str = include_str!("../wgsl/style_smoothing_pass.wgsl");

/// How a plane keeps a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Storage {
    /// Four bytes.
    F32,
    /// Two bytes.
    F16,
    /// One byte, for numbers in 0..1.
    Unorm8,
}

impl Storage {
    /// All of them.
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

/// Gaussians that a workgroup of `style_knn_conv` computes.
pub const TILE_ROWS: u32 = 128;
/// Gaussians that a workgroup of `style_color` or `style_smoothing_pass` computes.
pub const COLOR_WORKGROUP_SIZE: u32 = 128;
/// Output channels that a workgroup of `style_knn_conv` computes, of each variant: 64 need 256 invocations, as many as
/// every adapter has; 32 leave none idle in the paper's narrowest hidden layer.
pub const TILE_COLUMNS: [u32; 2] = [32, 64];

/// Twin of the WGSL struct: the part of one layer that a dispatch computes. Fields are documented there.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[expect(missing_docs, reason = "the twin in WGSL documents every field")]
pub struct KnnLayer {
    pub input_rows: u32,
    pub output_rows: u32,
    pub first_row: u32,
    pub n_rows: u32,
    pub k: u32,
    pub n_input_planes: u32,
    pub first_group_plane: u32,
    pub n_group_planes: u32,
    pub first_column: u32,
    pub n_columns: u32,
    pub weight_stride: u32,
    pub continues: u32,
    pub is_continued: u32,
    pub is_sigmoid: u32,
    pub slope: f32,
    pub residual: f32,
    pub input_is_scene: u32,
    pub output_is_scene: u32,
    pub padding: [u32; 2],
}

/// A hidden layer whose workgroups compute `tile_columns` output channels.
pub fn knn_conv(tile_columns: u32, input: Storage, output: Storage) -> Source {
    let columns = format!("const TILE_COLUMNS: u32 = {tile_columns}u;");
    let wgsl = [&columns, LAYER, input.read(), output.write(), KNN_CONV].join("\n");
    Source { label: "style_knn_conv", wgsl }
}

/// The last layer.
pub fn color(input: Storage) -> Source {
    Source { label: "style_color", wgsl: [LAYER, input.read(), COLOR].join("\n") }
}

/// An average of colors over windows.
pub fn smoothing_pass() -> Source {
    Source { label: "style_smoothing_pass", wgsl: [LAYER, SMOOTHING_PASS].join("\n") }
}

/// Every joined source of the style pass.
pub fn sources() -> Vec<Source> {
    let pairs = Storage::ALL.map(|input| Storage::ALL.map(|output| (input, output)));
    let hidden = pairs.as_flattened().iter();
    let hidden =
        hidden.flat_map(|&(input, output)| TILE_COLUMNS.map(|columns| knn_conv(columns, input, output)));
    hidden.chain(Storage::ALL.map(color)).chain([smoothing_pass()]).collect()
}

/// Every struct that the style pass shares with Rust.
pub fn layouts() -> Vec<Layout> {
    vec![layout!(KnnLayer {
        input_rows,
        output_rows,
        first_row,
        n_rows,
        k,
        n_input_planes,
        first_group_plane,
        n_group_planes,
        first_column,
        n_columns,
        weight_stride,
        continues,
        is_continued,
        is_sigmoid,
        slope,
        residual,
        input_is_scene,
        output_is_scene,
        padding,
    })]
}
