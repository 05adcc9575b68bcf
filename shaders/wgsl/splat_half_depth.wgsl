// The depth that a low pixel is tested against: by turns, as on a chessboard, the farthest of its pixels and
// the nearest. So the four low pixels around a pixel have seen both sides of an edge that runs through them.

/// Depth of meshes on the farther side of edges, reverse z.
@group(0) @binding(1) var farther: texture_depth_2d;
/// The same on the nearer side, `NO_SURFACE` where there is only one.
@group(0) @binding(2) var nearer: texture_depth_2d;

@vertex
fn splat_half_depth_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return covering(corner);
}

@fragment
fn splat_half_depth_fragment(@builtin(position) position: vec4<f32>) -> @builtin(frag_depth) f32 {
    let low = vec2<i32>(position.xy);
    var nearest = 0.0;
    var farthest = NO_SURFACE;
    for (var i = 0; i < 4; i++) {
        let pixel = first_pixel() + min(2 * low + vec2(i & 1, i >> 1u), whole_size() - 1);
        let far = textureLoad(farther, pixel, 0);
        let near = textureLoad(nearer, pixel, 0);
        farthest = min(farthest, far);
        nearest = max(nearest, select(near, far, near >= NO_SURFACE));
    }
    return select(farthest, nearest, ((low.x + low.y) & 1) == 1);
}
