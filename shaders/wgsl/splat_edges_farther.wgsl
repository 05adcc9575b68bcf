// The depth on the farther side of edges, and which samples are on the nearer side.

struct Farther {
    @builtin(frag_depth) depth: f32,
    /// A bit for each sample on the nearer side.
    @location(0) nearer_samples: u32,
}

@vertex
fn splat_edges_farther_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return covering(corner);
}

@fragment
fn splat_edges_farther_fragment(@builtin(position) position: vec4<f32>) -> Farther {
    let pixel = vec2<i32>(position.xy);
    let samples = samples_at(pixel);
    if !is_edge(samples) {
        return Farther(samples.mean, 0u);
    }
    let middle = 0.5 * (samples.nearest + samples.farthest);
    var nearer = 0u;
    for (var i = 0; i < i32(textureNumSamples(depths)); i++) {
        nearer |= select(0u, 1u << u32(i), textureLoad(depths, pixel, i) > middle);
    }
    return Farther(samples.farthest, nearer);
}
