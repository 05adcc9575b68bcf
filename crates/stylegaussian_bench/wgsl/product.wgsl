// The plain product that the style pass is compared with: c = a b, all three [n, n], f32, n a multiple of 128.
// Tiles, steps and registers are those of `style_knn_conv`; what is missing is the gather, the unpacking and
// the activation.

// n / 4.
override n_quads: u32;

@group(0) @binding(0) var<storage, read> a: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> b: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> c: array<vec4<f32>>;

const TILE_ROWS: u32 = 128u;
const COLUMN_QUADS: u32 = 16u;
const LANE_ROWS: u32 = 16u;
const WORKGROUP_SIZE: u32 = 256u;
const STEP_QUADS: u32 = 4u;
const ROW_STRIDE: u32 = 5u;

var<workgroup> tile_a: array<vec4<f32>, TILE_ROWS * ROW_STRIDE>;
var<workgroup> tile_b: array<vec4<f32>, 4u * STEP_QUADS * COLUMN_QUADS>;

fn four_rows(first_row: u32, quad: u32) -> mat4x4<f32> {
    let start = first_row * ROW_STRIDE + quad;
    let step = LANE_ROWS * ROW_STRIDE;
    return mat4x4<f32>(
        tile_a[start],
        tile_a[start + step],
        tile_a[start + 2u * step],
        tile_a[start + 3u * step],
    );
}

fn four_columns(quad: u32, column: u32) -> mat4x4<f32> {
    let start = quad * 4u * COLUMN_QUADS + column;
    return mat4x4<f32>(
        tile_b[start],
        tile_b[start + COLUMN_QUADS],
        tile_b[start + 2u * COLUMN_QUADS],
        tile_b[start + 3u * COLUMN_QUADS],
    );
}

@compute @workgroup_size(WORKGROUP_SIZE)
fn product(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) invocation: u32) {
    let first_row = workgroup.x * TILE_ROWS;
    let first_column = workgroup.y * COLUMN_QUADS;
    let lane_row = invocation % LANE_ROWS;
    let lane_column = invocation / LANE_ROWS;
    var first_half = mat4x4<f32>();
    var second_half = mat4x4<f32>();
    for (var step = 0u; step < n_quads; step += STEP_QUADS) {
        for (var i = invocation; i < TILE_ROWS * STEP_QUADS; i += WORKGROUP_SIZE) {
            let row = i / STEP_QUADS;
            tile_a[row * ROW_STRIDE + i % STEP_QUADS] = a[(first_row + row) * n_quads + step + i % STEP_QUADS];
        }
        let row = invocation / COLUMN_QUADS;
        tile_b[invocation] = b[(4u * step + row) * n_quads + first_column + invocation % COLUMN_QUADS];
        workgroupBarrier();
        for (var quad = 0u; quad < STEP_QUADS; quad++) {
            let weights = four_columns(quad, lane_column);
            first_half += weights * four_rows(lane_row, quad);
            second_half += weights * four_rows(lane_row + 4u * LANE_ROWS, quad);
        }
        workgroupBarrier();
    }
    let column = first_column + lane_column;
    let row = first_row + lane_row;
    for (var i = 0u; i < 4u; i++) {
        c[(row + i * LANE_ROWS) * n_quads + column] = first_half[i];
        c[(row + (4u + i) * LANE_ROWS) * n_quads + column] = second_half[i];
    }
}
