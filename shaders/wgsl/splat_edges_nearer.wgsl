// The depth on the nearer side of edges, and the near plane elsewhere.

@vertex
fn splat_edges_nearer_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return covering(corner);
}

@fragment
fn splat_edges_nearer_fragment(@builtin(position) position: vec4<f32>) -> @builtin(frag_depth) f32 {
    let samples = samples_at(vec2<i32>(position.xy));
    return select(NO_EDGE, min(samples.nearest, NEAREST), is_edge(samples));
}
