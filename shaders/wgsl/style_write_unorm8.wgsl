// Output in planes of bytes: activations in 0..1, in steps of 1/255.

/// Bound planes `[planes, output_rows, 2]`, 4 bytes each.
@group(0) @binding(4) var<storage, read_write> outputs: array<u32>;

/// Writes four channels of a row. `quad` counts from the first channel of the first bound plane.
fn write_channels(quad: u32, row: u32, value: vec4<f32>) {
    outputs[(quad / 2u * layer.output_rows + row) * 2u + quad % 2u] = pack4x8unorm(value);
}
