// The last layer: rgb_p = sum_k W_k x_{n(p,k)} + B, without activation and without clamping. A residual decoder
// without smoothing passes adds a share of the base color here. CPU twins: `stylegaussian::decoder::knn_conv`
// and the end of `stylegaussian::fold::stylize`.
//
// Three columns are too few to share through workgroup memory. An invocation decodes one Gaussian; all
// invocations read the same weights at the same time, which caches serve well.

/// Colors `[N]`, 4 f16 each.
@group(0) @binding(4) var<storage, read_write> colors: array<vec2<u32>>;
/// Base colors of the Gaussians `[N]`, 4 f16 each; a single one if the decoder is not residual.
@group(0) @binding(6) var<storage, read> base_colors: array<vec2<u32>>;

/// The part of the sum that belongs to four channels.
fn weighted(x: vec4<f32>, first_weight: u32) -> vec4<f32> {
    let weight = mat4x4(
        weights[first_weight],
        weights[first_weight + 1u],
        weights[first_weight + 2u],
        weights[first_weight + 3u],
    );
    return weight * x;
}

@compute @workgroup_size(COLOR_WORKGROUP_SIZE)
fn style_color(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let row = invocation.x;
    if row >= layer.n_rows {
        return;
    }
    var color = vec4(0.0);
    if layer.continues != 0u {
        color = sums[row];
    }
    for (var i = 0u; i < layer.k; i++) {
        let neighbor = input_row(neighbors[row * layer.k + i]);
        for (var plane = 0u; plane < layer.n_group_planes; plane++) {
            let channels = read_channels(plane, neighbor);
            // One vec4 per channel: the last layer has a single vec4 in a row of weights.
            let first_weight = weight_row(i, plane);
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
    colors[gaussian] = pack_half4(vec4(color.rgb, 1.0));
}
