// Output in planes of f16.

/// Bound planes `[planes, output_rows, 2]`, 4 f16 each.
@group(0) @binding(4) var<storage, read_write> outputs: array<vec2<u32>>;

/// Writes four channels of a row. `quad` counts from the first channel of the first bound plane.
fn write_channels(quad: u32, row: u32, value: vec4<f32>) {
    outputs[(quad / 2u * layer.output_rows + row) * 2u + quad % 2u] = pack_half4(value);
}
