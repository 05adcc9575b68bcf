// What the kernels of the style pass share: one KNN convolution's shape and buffers.
//
// Activations are planes of 8 channels: plane c / 8 holds the channels c of all N Gaussians, 8 f16 (one vec4<u32>) for
// each. Rows are gathered by neighbor index from anywhere in the scene, so what is too large for one binding splits by
// plane and not by Gaussian: a dispatch sees `n_group_planes` of the layer's `n_input_planes`, and sums over dispatches.

struct KnnLayer {
    // N, the Gaussians of the scene and of every plane.
    n_gaussians: u32,
    // The rows of this dispatch: Gaussians first_row .. first_row + n_rows, whose neighbor lists are bound.
    first_row: u32,
    n_rows: u32,
    // K, the neighbors of a Gaussian.
    k: u32,
    // Planes of the layer's whole input, and those of them that are bound.
    n_input_planes: u32,
    first_group_plane: u32,
    n_group_planes: u32,
    // The columns (output channels) of this dispatch, both multiples of 8 where planes are written. The first of them is
    // the first channel of the first bound output plane.
    first_column: u32,
    n_columns: u32,
    // vec4 in a row of weights.
    weight_stride: u32,
    // 1 where earlier dispatches left sums over other planes, and where later ones go on with this one's.
    continues: u32,
    is_continued: u32,
    // Activation: the sigmoid where 1, otherwise x for x > 0 and slope * x for the rest.
    is_sigmoid: u32,
    slope: f32,
    // 1 where the color is an offset from the Gaussian's own.
    is_residual: u32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> layer: KnnLayer;
// [n_rows, K]
@group(0) @binding(1) var<storage, read> neighbors: array<u32>;
// [K * n_input_planes * 8 + 1, weight_stride]: for each neighbor and input channel all output channels; then the bias.
@group(0) @binding(2) var<storage, read> weights: array<vec4<f32>>;
// [n_group_planes, N], 8 f16 each
@group(0) @binding(3) var<storage, read> inputs: array<vec4<u32>>;
// [planes, N, 2], 4 f16 each; or the colors [N]
@group(0) @binding(4) var<storage, read_write> outputs: array<vec2<u32>>;
// [n_rows, n_columns / 4]: sums over planes that do not fit one binding
@group(0) @binding(5) var<storage, read_write> sums: array<vec4<f32>>;

fn unpack_half4(packed: vec2<u32>) -> vec4<f32> {
    return vec4<f32>(unpack2x16float(packed.x), unpack2x16float(packed.y));
}

// Beyond the largest f16 the result of packing is undefined.
fn pack_half4(value: vec4<f32>) -> vec2<u32> {
    let finite = clamp(value, vec4<f32>(-65504.0), vec4<f32>(65504.0));
    return vec2<u32>(pack2x16float(finite.xy), pack2x16float(finite.zw));
}

// The first row of weights of neighbor `slot` and of the plane `group_plane` among those bound.
fn weight_row(slot: u32, group_plane: u32) -> u32 {
    return (slot * layer.n_input_planes + layer.first_group_plane + group_plane) * 8u;
}

fn bias(column_quad: u32) -> vec4<f32> {
    return weights[layer.k * layer.n_input_planes * 8u * layer.weight_stride + column_quad];
}
