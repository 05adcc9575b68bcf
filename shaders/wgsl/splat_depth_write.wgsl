// Writes iso depths into a depth attachment: a triangle over the whole viewport. The attachment's test keeps
// what is nearer, sample by sample.

@group(0) @binding(0) var<uniform> iso: SplatIso;
@group(0) @binding(1) var<storage, read> iso_depths: array<f32>;

@vertex
fn splat_depth_write_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    // (-1, -1), (3, -1), (-1, 3).
    let at = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(at * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn splat_depth_write_fragment(@builtin(position) position: vec4<f32>) -> @builtin(frag_depth) f32 {
    let depth = iso_depths[place_of(vec2<u32>((position.xy - iso.place) / iso.step), iso)];
    if depth <= 0.0 {
        discard;
    }
    return depth;
}
