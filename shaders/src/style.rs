//! Shaders of the style pass: hidden layers (`style_knn_conv`) and the last one (`style_color`).

use bytemuck::{Pod, Zeroable};

use crate::{Layout, Source, layout};

/// What both kernels share: the layer's shape and buffers.
pub const LAYER: &str = include_str!("../wgsl/style_layer.wgsl");
/// A hidden layer, without its number of columns.
pub const KNN_CONV: &str = include_str!("../wgsl/style_knn_conv.wgsl");
/// The last layer.
pub const COLOR: &str = include_str!("../wgsl/style_color.wgsl");

/// Gaussians that a workgroup of `style_knn_conv` computes.
pub const TILE_ROWS: u32 = 128;
/// Gaussians that a workgroup of `style_color` computes.
pub const COLOR_WORKGROUP_SIZE: u32 = 128;
/// Output channels that a workgroup of `style_knn_conv` computes, of each variant: 64 need 256 invocations, as many as
/// every adapter has; 32 leave none idle in the paper's narrowest hidden layer.
pub const TILE_COLUMNS: [u32; 2] = [32, 64];

/// Twin of the WGSL struct: the part of one layer that a dispatch computes. Fields are documented there.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[expect(missing_docs, reason = "the twin in WGSL documents every field")]
pub struct KnnLayer {
    pub n_gaussians: u32,
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
    pub is_residual: u32,
    pub padding: u32,
}

/// A hidden layer whose workgroups compute `tile_columns` output channels.
pub fn knn_conv(tile_columns: u32) -> Source {
    let wgsl = format!("const TILE_COLUMNS: u32 = {tile_columns}u;\n{LAYER}\n{KNN_CONV}");
    Source { label: "style_knn_conv", wgsl }
}

/// The last layer.
pub fn color() -> Source {
    Source { label: "style_color", wgsl: [LAYER, COLOR].join("\n") }
}

/// Every joined source of the style pass.
pub fn sources() -> Vec<Source> {
    let mut sources: Vec<Source> = TILE_COLUMNS.into_iter().map(knn_conv).collect();
    sources.push(color());
    sources
}

/// Every struct that the style pass shares with Rust.
pub fn layouts() -> Vec<Layout> {
    vec![layout!(KnnLayer {
        n_gaussians,
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
        is_residual,
        padding,
    })]
}
