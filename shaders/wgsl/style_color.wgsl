// The last layer: rgb_p = sum_k W_k x_{n(p,k)} + B, plus a share of the Gaussian's own color where the decoder is residual
// and averages no colors; no activation and no clamp. CPU twins: stylegaussian::decoder::knn_conv and the end of stylegaussian::fold::stylize.
//
// Three columns are too few to tile: an invocation decodes one Gaussian and reads weights that all of them read.

const COLOR_WORKGROUP_SIZE: u32 = 128u;

// [N], 4 f16 each
@group(0) @binding(4) var<storage, read_write> colors: array<vec2<u32>>;
// [N], 4 f16 each: the Gaussians' own colors; one of them where the decoder is not residual
@group(0) @binding(6) var<storage, read> base_colors: array<vec2<u32>>;

// Four channels' worth of the sum.
fn weighted(x: vec4<f32>, first_weight: u32) -> vec4<f32> {
    let weight = mat4x4<f32>(
        weights[first_weight],
        weights[first_weight + 1u],
        weights[first_weight + 2u],
        weights[first_weight + 3u],
    );
    return weight * x;
}

@compute @workgroup_size(COLOR_WORKGROUP_SIZE)
fn main(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let row = invocation.x;
    if row >= layer.n_rows {
        return;
    }
    var color = vec4<f32>(0.0);
    if layer.continues != 0u {
        color = sums[row];
    }
    for (var slot = 0u; slot < layer.k; slot++) {
        let neighbor = input_row(neighbors[row * layer.k + slot]);
        for (var plane = 0u; plane < layer.n_group_planes; plane++) {
            let channels = read_channels(plane, neighbor);
            let first_weight = weight_row(slot, plane);
            color += weighted(channels[0], first_weight);
            color += weighted(channels[1], first_weight + 4u);
        }
    }
    if layer.is_continued != 0u {
        sums[row] = color;
        return;
    }
    color += bias(0u);
    let gaussian = output_row(row);
    if layer.residual != 0.0 {
        color += layer.residual * unpack_half4(base_colors[gaussian]);
    }
    colors[gaussian] = pack_half4(vec4<f32>(color.rgb, 1.0));
}
