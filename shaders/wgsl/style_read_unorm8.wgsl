// Input in planes of bytes: activations in 0..1, in steps of 1/255.

/// Bound planes `[n_group_planes, input_rows]`, 8 bytes each.
@group(0) @binding(3) var<storage, read> inputs: array<vec2<u32>>;

/// The 8 channels of a row in a plane.
fn read_channels(plane: u32, row: u32) -> mat2x4<f32> {
    let packed = inputs[plane * layer.input_rows + row];
    return mat2x4(unpack4x8unorm(packed.x), unpack4x8unorm(packed.y));
}
