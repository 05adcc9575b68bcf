// Input in planes of f32.

/// Bound planes `[n_group_planes, input_rows, 2]`, 4 f32 each.
@group(0) @binding(3) var<storage, read> inputs: array<vec4<f32>>;

/// The 8 channels of a row in a plane.
fn read_channels(plane: u32, row: u32) -> mat2x4<f32> {
    let first = 2u * (plane * layer.input_rows + row);
    return mat2x4(inputs[first], inputs[first + 1u]);
}
