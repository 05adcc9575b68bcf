// The shape and the buffers of one KNN convolution, shared by the kernels of the style pass. Joined after the
// constants of `stylegaussian_shaders::style`.
//
// Activations are stored as planes of 8 channels: plane c / 8 holds channel c of all rows, in the number
// formats of the files `style_read_*` and `style_write_*`. Rows are gathered by neighbor index from anywhere in
// a plane. A layer that exceeds one binding is therefore split by plane and not by row: a dispatch sees
// `n_group_planes` of the layer's `n_input_planes`, and several dispatches add up their sums.
//
// Rows are numbered within a block: some Gaussians, followed by the neighbors that the layers need around them.
// Each layer computes one ring of neighbors fewer than the layer before it. Only the scene's own arrays (the
// input of the first layer and the colors) are numbered by Gaussian; `gaussians` maps rows to them.

/// The part of one layer that a dispatch computes.
struct KnnLayer {
    /// Rows of a plane of the input.
    input_rows: u32,
    /// Rows of a plane of the output.
    output_rows: u32,
    /// First row of this dispatch within its block. The bound neighbor lists start at this row.
    first_row: u32,
    /// Rows of this dispatch.
    n_rows: u32,
    /// K, the neighbors of a Gaussian.
    k: u32,
    /// Planes of the layer's whole input.
    n_input_planes: u32,
    /// The first bound plane of the input.
    first_group_plane: u32,
    /// Bound planes of the input.
    n_group_planes: u32,
    /// First column (output channel) of this dispatch: the first channel of the first bound output plane. A
    /// multiple of 8 if planes are written.
    first_column: u32,
    /// Columns of this dispatch. A multiple of 8 if planes are written.
    n_columns: u32,
    /// vec4 in a row of weights.
    weight_stride: u32,
    /// 1 if earlier dispatches left sums over other planes.
    continues: u32,
    /// 1 if later dispatches add other planes to the sums of this one.
    is_continued: u32,
    /// The activation: the sigmoid if 1, else x for x > 0 and slope * x for the rest.
    is_sigmoid: u32,
    /// Slope of the activation below 0.
    slope: f32,
    /// Factor of the base color that is added to the result; 0 adds none.
    residual: f32,
    /// 1 if the block is a part of the scene and rows of the input are Gaussians.
    input_is_scene: u32,
    /// 1 if the block is a part of the scene and rows of the output are Gaussians.
    output_is_scene: u32,
    /// Unused.
    padding: vec2<u32>,
}

@group(0) @binding(0) var<uniform> layer: KnnLayer;
/// Neighbor lists `[n_rows, K]`, as rows of the block.
@group(0) @binding(1) var<storage, read> neighbors: array<u32>;
/// `[K * n_input_planes * 8 + 1, weight_stride]`: all output channels for each neighbor and input channel, then
/// the bias.
@group(0) @binding(2) var<storage, read> weights: array<vec4<f32>>;
/// Sums over the planes that do not fit one binding `[n_rows, n_columns / 4]`.
@group(0) @binding(5) var<storage, read_write> sums: array<vec4<f32>>;
/// The Gaussian of each row of the block. Not read if the block is the whole scene.
@group(0) @binding(7) var<storage, read> gaussians: array<u32>;

fn unpack_half4(packed: vec2<u32>) -> vec4<f32> {
    return vec4(unpack2x16float(packed.x), unpack2x16float(packed.y));
}

fn pack_half4(value: vec4<f32>) -> vec2<u32> {
    // WGSL leaves the result of packing undefined beyond the largest f16.
    let finite = clamp(value, vec4(-65504.0), vec4(65504.0));
    return vec2(pack2x16float(finite.xy), pack2x16float(finite.zw));
}

/// Index in the input of row `row` of the block.
fn input_row(row: u32) -> u32 {
    if layer.input_is_scene != 0u {
        return gaussians[row];
    }
    return row;
}

/// Index in the output of row `row` of the dispatch.
fn output_row(row: u32) -> u32 {
    if layer.output_is_scene != 0u {
        return gaussians[layer.first_row + row];
    }
    return layer.first_row + row;
}

/// The first row of weights of the `i`-th neighbor and of bound plane `group_plane`.
fn weight_row(i: u32, group_plane: u32) -> u32 {
    return (i * layer.n_input_planes + layer.first_group_plane + group_plane) * PLANE_CHANNELS;
}

/// The bias of four columns.
fn bias(column_quad: u32) -> vec4<f32> {
    return weights[layer.k * layer.n_input_planes * PLANE_CHANNELS * layer.weight_stride + column_quad];
}
