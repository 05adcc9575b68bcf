// One smoothing pass behind the last layer: the mean color of each Gaussian's neighborhood. The last pass of a
// residual decoder also adds a share of the base color. CPU twin: `stylegaussian::decoder::smoothing_pass`.

/// Colors before the pass `[N]`, 4 f16 each.
@group(0) @binding(3) var<storage, read> colors: array<vec2<u32>>;
/// Colors after the pass `[N]`, 4 f16 each.
@group(0) @binding(4) var<storage, read_write> means: array<vec2<u32>>;
/// Base colors of the Gaussians `[N]`, 4 f16 each; a single one if the decoder is not residual.
@group(0) @binding(6) var<storage, read> base_colors: array<vec2<u32>>;

@compute @workgroup_size(COLOR_WORKGROUP_SIZE)
fn style_smoothing_pass(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let row = invocation.x;
    if row >= layer.n_rows {
        return;
    }
    var sum = vec4(0.0);
    for (var i = 0u; i < layer.k; i++) {
        sum += unpack_half4(colors[input_row(neighbors[row * layer.k + i])]);
    }
    // Summed in f32. In f16, as colors are stored, each addition would round to 11 bits.
    var mean = sum / f32(layer.k);
    let gaussian = output_row(row);
    if layer.residual != 0.0 {
        mean += layer.residual * unpack_half4(base_colors[gaussian]);
    }
    means[gaussian] = pack_half4(vec4(mean.rgb, 1.0));
}
