// What the kernels of the style pass share: one KNN convolution's shape and buffers.
//
// Activations are planes of 8 channels: plane c / 8 holds the channels c of all rows, as the files `style_read_*` and
// `style_write_*` say. Rows are gathered by neighbor index from anywhere in a plane, so what is too large for one binding
// splits by plane and not by row: a dispatch sees `n_group_planes` of the layer's `n_input_planes`, and sums over dispatches.
//
// Rows are those of a block: some Gaussians, then the neighbors that its layers need beside them, each layer one
// neighborhood less than the one before. Only the scene's own arrays, the first layer's input and the colors, are numbered by
// Gaussian; `gaussians` leads there.

struct KnnLayer {
    // Rows of a plane of the input and of the output.
    input_rows: u32,
    output_rows: u32,
    // The rows of this dispatch: first_row .. first_row + n_rows of the block, whose neighbor lists are bound.
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
    // What the Gaussian's own color is multiplied with before it is added.
    residual: f32,
    // 1 where the block is not the whole scene, and rows of the input are Gaussians.
    input_is_scene: u32,
    // 1 where the block is not the whole scene, and rows of the output are Gaussians.
    output_is_scene: u32,
    padding: vec2<u32>,
}

@group(0) @binding(0) var<uniform> layer: KnnLayer;
// [n_rows, K], rows of the block
@group(0) @binding(1) var<storage, read> neighbors: array<u32>;
// [K * n_input_planes * 8 + 1, weight_stride]: for each neighbor and input channel all output channels; then the bias.
@group(0) @binding(2) var<storage, read> weights: array<vec4<f32>>;
// [n_rows, n_columns / 4]: sums over planes that do not fit one binding
@group(0) @binding(5) var<storage, read_write> sums: array<vec4<f32>>;
// The Gaussian of each row of the block; not read where that is the whole scene.
@group(0) @binding(7) var<storage, read> gaussians: array<u32>;

fn unpack_half4(packed: vec2<u32>) -> vec4<f32> {
    return vec4<f32>(unpack2x16float(packed.x), unpack2x16float(packed.y));
}

// Beyond the largest f16 the result of packing is undefined.
fn pack_half4(value: vec4<f32>) -> vec2<u32> {
    let finite = clamp(value, vec4<f32>(-65504.0), vec4<f32>(65504.0));
    return vec2<u32>(pack2x16float(finite.xy), pack2x16float(finite.zw));
}

// Where the input keeps row `row` of the block.
fn input_row(row: u32) -> u32 {
    if layer.input_is_scene != 0u {
        return gaussians[row];
    }
    return row;
}

// Where the output keeps row `row` of the dispatch.
fn output_row(row: u32) -> u32 {
    if layer.output_is_scene != 0u {
        return gaussians[layer.first_row + row];
    }
    return layer.first_row + row;
}

// The first row of weights of neighbor `slot` and of the plane `group_plane` among those bound.
fn weight_row(slot: u32, group_plane: u32) -> u32 {
    return (slot * layer.n_input_planes + layer.first_group_plane + group_plane) * 8u;
}

fn bias(column_quad: u32) -> vec4<f32> {
    return weights[layer.k * layer.n_input_planes * 8u * layer.weight_stride + column_quad];
}
