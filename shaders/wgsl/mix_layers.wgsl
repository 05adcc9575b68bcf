// Lays looks over the colors of a scene. CPU twin, for layers of any number:
// `stylegaussian::layers::mix_layers`.

/// Colors `[N]`, 4 f16 each, premultiplied.
@group(0) @binding(1) var<storage, read_write> colors: array<vec2<u32>>;
/// Looks, in the layout of `colors`.
@group(0) @binding(5) var<storage, read> look_0: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read> look_1: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read> look_2: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read> look_3: array<vec2<u32>>;

/// The largest number of a color, the largest f16.
const MAX_COLOR: f32 = 65504.0;

fn unpack_color(words: vec2<u32>) -> vec4<f32> {
    return vec4(unpack2x16float(words.x), unpack2x16float(words.y));
}

/// The color of a Gaussian in a look.
fn look_color(look: u32, gaussian: u32) -> vec4<f32> {
    switch look {
        case 0u: { return unpack_color(look_0[gaussian]); }
        case 1u: { return unpack_color(look_1[gaussian]); }
        case 2u: { return unpack_color(look_2[gaussian]); }
        case 3u: { return unpack_color(look_3[gaussian]); }
        default: { return vec4(0.0); }
    }
}

@compute @workgroup_size(MIX_WORKGROUP)
fn mix_layers(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) n_workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // Many blocks take two dimensions of workgroups: one is limited to 65,535.
    let item = item_of(workgroup.y * n_workgroups.x + workgroup.x, lane);
    if !item.exists {
        return;
    }
    var color = vec4(0.0);
    if !starts(item) {
        color = unpack_color(colors[item.gaussian]);
    }
    for (var touches = item.block.touches; touches != 0u; touches &= touches - 1u) {
        let layer = firstTrailingBit(touches);
        color = mix(color, look_color(stack.layers[layer].look, item.gaussian), share_of(layer, item));
    }
    // WGSL leaves packing of larger numbers to f16 undefined.
    let limited = clamp(color, vec4(-MAX_COLOR), vec4(MAX_COLOR));
    colors[item.gaussian] = vec2(pack2x16float(limited.xy), pack2x16float(limited.zw));
}
