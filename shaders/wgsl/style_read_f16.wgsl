// Input in planes of f16.

/// Bound planes `[n_group_planes, input_rows]`, 8 f16 each.
@group(0) @binding(3) var<storage, read> inputs: array<vec4<u32>>;

/// The 8 channels of a row in a plane.
fn read_channels(plane: u32, row: u32) -> mat2x4<f32> {
    let packed = inputs[plane * layer.input_rows + row];
    return mat2x4(unpack_half4(packed.xy), unpack_half4(packed.zw));
}
