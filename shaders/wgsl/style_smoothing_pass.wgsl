// The mean color of each Gaussian's window, and in the end a share of its own color: one of the averages behind the last
// layer. CPU twin: stylegaussian::decoder::smoothing_pass.

const COLOR_WORKGROUP_SIZE: u32 = 128u;

// [N], 4 f16 each: colors before and after.
@group(0) @binding(3) var<storage, read> colors: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> means: array<vec2<u32>>;
// [N], 4 f16 each: the Gaussians' own colors; one of them where the decoder is not residual
@group(0) @binding(6) var<storage, read> base_colors: array<vec2<u32>>;

@compute @workgroup_size(COLOR_WORKGROUP_SIZE)
fn main(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let row = invocation.x;
    if row >= layer.n_rows {
        return;
    }
    var sum = vec4<f32>(0.0);
    for (var slot = 0u; slot < layer.k; slot++) {
        sum += unpack_half4(colors[input_row(neighbors[row * layer.k + slot])]);
    }
    var mean = sum / f32(layer.k);
    let gaussian = output_row(row);
    if layer.residual != 0.0 {
        mean += layer.residual * unpack_half4(base_colors[gaussian]);
    }
    means[gaussian] = pack_half4(vec4<f32>(mean.rgb, 1.0));
}
