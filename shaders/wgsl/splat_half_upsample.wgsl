// The whole layer of a low one. A pixel takes the four low pixels around it by their distance, and by whether
// they were tested against the surface that it shows itself.

/// Depth of meshes at each pixel of the target, reverse z.
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var low_layer: texture_2d<f32>;
/// The result of `splat_half_depth`.
@group(0) @binding(3) var low_depths: texture_depth_2d;

/// The least difference of depths that counts, so that nothing is divided by 0 where both are infinitely far.
const LEAST_TOLERANCE: f32 = 1e-30;

/// The agreement of two depths, 1 if they are equal. Of two surfaces it is so small that only a pixel without
/// any other takes them, but never 0.
fn agreement(a: f32, b: f32) -> f32 {
    let tolerance = max(whole.limit.x * max(a, b) + whole.limit.y, LEAST_TOLERANCE);
    let off = (a - b) / tolerance;
    // No exponential: that would be 0 for all four low pixels of some pixels.
    let near = 1.0 / (1.0 + off * off);
    return near * near;
}

/// The sum of low pixels by their weights, and that of the weights.
struct Weighted {
    texel: vec4<f32>,
    weight: f32,
}

fn weighted(sum: Weighted, low: vec2<i32>, share: f32, depth: f32) -> Weighted {
    let weight = share * agreement(depth, textureLoad(low_depths, low, 0));
    return Weighted(sum.texel + weight * textureLoad(low_layer, low, 0), sum.weight + weight);
}

@vertex
fn splat_half_upsample_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return covering(corner);
}

@fragment
fn splat_half_upsample_fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let in_target = vec2<i32>(position.xy);
    let depth = textureLoad(depths, in_target, 0);
    if depth >= NO_SURFACE {
        discard;
    }
    let pixel = in_target - first_pixel();
    let own = pixel / 2;
    // The other column and row of low pixels are those before even pixels, and behind odd ones.
    let last = (whole_size() + 1) / 2 - 1;
    let other = clamp(own + 2 * (pixel & vec2(1)) - 1, vec2(0), last);
    var sum = Weighted(vec4(0.0), 0.0);
    sum = weighted(sum, own, 9.0 / 16.0, depth);
    sum = weighted(sum, vec2(other.x, own.y), 3.0 / 16.0, depth);
    sum = weighted(sum, vec2(own.x, other.y), 3.0 / 16.0, depth);
    sum = weighted(sum, other, 1.0 / 16.0, depth);
    return sum.texel / sum.weight;
}
