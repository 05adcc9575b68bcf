// One hidden layer: y_p = activation(sum_k W_k x_{n(p,k)} + B), computed as a product of gathered rows with the
// weights. CPU twin: `stylegaussian::decoder::knn_conv`.
//
// A workgroup computes ROWS_PER_WORKGROUP Gaussians times COLUMNS_PER_WORKGROUP channels, an invocation 8 x 4
// of them. The inner dimension is the sequence of all (neighbor, plane) pairs. A step takes two pairs, which
// are 16 channels. Both operands of a step lie in workgroup memory, (128 * 5 + 16 * COLUMNS_PER_WORKGROUP / 4)
// * 16 bytes: 14 KiB for 64 columns, within the 16 KiB that WebGPU guarantees.

/// Rows that neighboring invocations of one column compute: together they write 16 consecutive Gaussians.
const LANE_ROWS: u32 = 16u;
const COLUMN_QUADS: u32 = COLUMNS_PER_WORKGROUP / 4u;
const WORKGROUP_SIZE: u32 = LANE_ROWS * COLUMN_QUADS;
/// Channels of a step: two planes.
const STEP_CHANNELS: u32 = 2u * PLANE_CHANNELS;
/// vec4 from one row to the next. Four hold 16 channels; the fifth keeps rows out of each other's memory banks.
const ROW_STRIDE: u32 = 5u;

/// Gathered input of a step `[row, channel / 4]`.
var<workgroup> shared_inputs: array<vec4<f32>, ROWS_PER_WORKGROUP * ROW_STRIDE>;
/// Weights of a step `[channel, column / 4]`.
var<workgroup> shared_weights: array<vec4<f32>, STEP_CHANNELS * COLUMN_QUADS>;

/// Gathers two planes of every row of the workgroup.
fn load_inputs(first_pair: u32, workgroup_row: u32, invocation: u32) {
    for (var i = invocation; i < 2u * ROWS_PER_WORKGROUP; i += WORKGROUP_SIZE) {
        let row = i % ROWS_PER_WORKGROUP;
        let pair = first_pair + i / ROWS_PER_WORKGROUP;
        // Zeros beyond the last row and the last pair: the product then needs no bounds.
        var channels = mat2x4<f32>();
        if workgroup_row + row < layer.n_rows && pair < layer.k * layer.n_group_planes {
            let neighbor = neighbors[(workgroup_row + row) * layer.k + pair / layer.n_group_planes];
            channels = read_channels(pair % layer.n_group_planes, input_row(neighbor));
        }
        let destination = row * ROW_STRIDE + i / ROWS_PER_WORKGROUP * 2u;
        shared_inputs[destination] = channels[0];
        shared_inputs[destination + 1u] = channels[1];
    }
}

/// Copies the weights of two planes and of every column of the workgroup.
fn load_weights(first_pair: u32, workgroup_quad: u32, invocation: u32) {
    for (var i = invocation; i < STEP_CHANNELS * COLUMN_QUADS; i += WORKGROUP_SIZE) {
        let channel = i / COLUMN_QUADS;
        let pair = first_pair + channel / PLANE_CHANNELS;
        let quad = workgroup_quad + i % COLUMN_QUADS;
        var weight = vec4(0.0);
        if pair < layer.k * layer.n_group_planes && quad < layer.weight_stride {
            let first_row = weight_row(pair / layer.n_group_planes, pair % layer.n_group_planes);
            weight = weights[(first_row + channel % PLANE_CHANNELS) * layer.weight_stride + quad];
        }
        shared_weights[i] = weight;
    }
}

/// Four of the 16 shared channels of four rows. A row becomes a column of the matrix.
fn four_rows(first_row: u32, channel_quad: u32) -> mat4x4<f32> {
    let start = first_row * ROW_STRIDE + channel_quad;
    let step = LANE_ROWS * ROW_STRIDE;
    return mat4x4(
        shared_inputs[start],
        shared_inputs[start + step],
        shared_inputs[start + 2u * step],
        shared_inputs[start + 3u * step],
    );
}

/// Four columns of four channels. A channel becomes a column of the matrix.
fn four_channels(channel_quad: u32, quad: u32) -> mat4x4<f32> {
    let start = channel_quad * 4u * COLUMN_QUADS + quad;
    return mat4x4(
        shared_weights[start],
        shared_weights[start + COLUMN_QUADS],
        shared_weights[start + 2u * COLUMN_QUADS],
        shared_weights[start + 3u * COLUMN_QUADS],
    );
}

fn activated(x: vec4<f32>) -> vec4<f32> {
    if layer.is_sigmoid != 0u {
        return 1.0 / (1.0 + exp(-x));
    }
    return select(layer.slope * x, x, x > vec4(0.0));
}

/// Ends the sum of one row and four columns. `quad` counts from the dispatch's first column.
fn finish(row: u32, quad: u32, sum: vec4<f32>) {
    if row >= layer.n_rows || quad * 4u >= layer.n_columns {
        return;
    }
    let sum_index = row * (layer.n_columns / 4u) + quad;
    var total = sum;
    if layer.continues != 0u {
        total += sums[sum_index];
    }
    if layer.is_continued != 0u {
        sums[sum_index] = total;
        return;
    }
    let y = activated(total + bias(layer.first_column / 4u + quad));
    write_channels(quad, layer.first_row + row, y);
}

@compute @workgroup_size(WORKGROUP_SIZE)
fn style_knn_conv(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) invocation: u32,
) {
    let workgroup_row = workgroup.x * ROWS_PER_WORKGROUP;
    let workgroup_quad = workgroup.y * COLUMN_QUADS;
    let lane_row = invocation % LANE_ROWS;
    let lane_quad = invocation / LANE_ROWS;

    // Rows lane_row + 16 i of the workgroup, i = 0..4 in the first and 4..8 in the second. A row is a column of
    // the matrix, so that one product of matrices updates 16 sums.
    var first_half = mat4x4<f32>();
    var second_half = mat4x4<f32>();
    let n_pairs = layer.k * layer.n_group_planes;
    for (var pair = 0u; pair < n_pairs; pair += 2u) {
        load_inputs(pair, workgroup_row, invocation);
        load_weights(pair, layer.first_column / 4u + workgroup_quad, invocation);
        workgroupBarrier();
        for (var channel_quad = 0u; channel_quad < STEP_CHANNELS / 4u; channel_quad++) {
            let weight = four_channels(channel_quad, lane_quad);
            first_half += weight * four_rows(lane_row, channel_quad);
            second_half += weight * four_rows(lane_row + 4u * LANE_ROWS, channel_quad);
        }
        // The next step overwrites the shared operands.
        workgroupBarrier();
    }

    let row = workgroup_row + lane_row;
    let quad = workgroup_quad + lane_quad;
    finish(row, quad, first_half[0]);
    finish(row + LANE_ROWS, quad, first_half[1]);
    finish(row + 2u * LANE_ROWS, quad, first_half[2]);
    finish(row + 3u * LANE_ROWS, quad, first_half[3]);
    finish(row + 4u * LANE_ROWS, quad, second_half[0]);
    finish(row + 5u * LANE_ROWS, quad, second_half[1]);
    finish(row + 6u * LANE_ROWS, quad, second_half[2]);
    finish(row + 7u * LANE_ROWS, quad, second_half[3]);
}
