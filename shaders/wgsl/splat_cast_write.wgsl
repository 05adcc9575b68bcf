// Writes the depths of cores into a shadow map: a triangle over the whole viewport. The map's test keeps what
// is nearer to the light.

@group(0) @binding(0) var depths: texture_depth_2d;

struct Corner {
    @builtin(position) position: vec4<f32>,
    /// A place in the picture, (0, 0) at the top left and (1, 1) at the bottom right.
    @location(0) place: vec2<f32>,
}

@vertex
fn splat_cast_write_vertex(@builtin(vertex_index) corner: u32) -> Corner {
    // (-1, -1), (3, -1), (-1, 3).
    let at = vec2(f32(corner & 1u), f32(corner >> 1u));
    return Corner(vec4(at * 4.0 - 1.0, 0.0, 1.0), vec2(2.0 * at.x, 1.0 - 2.0 * at.y));
}

@fragment
fn splat_cast_write_fragment(corner: Corner) -> @builtin(frag_depth) f32 {
    let size = vec2<f32>(textureDimensions(depths));
    return textureLoad(depths, vec2<i32>(corner.place * size), 0);
}
