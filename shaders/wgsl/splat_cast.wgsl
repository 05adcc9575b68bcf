// Draws cores of splats into depths of their own, where they are nearer to the light: one triangle for each.
// Triangles are no instances, which software adapters would draw one by one.

@group(0) @binding(0) var<storage, read> cores: array<SplatCore>;

const ROOT_3: f32 = 1.7320508;

struct Corner {
    @builtin(position) position: vec4<f32>,
    /// A place in the triangle, in which the core is the disc of radius 1.
    @location(0) place: vec2<f32>,
}

@vertex
fn splat_cast_vertex(@builtin(vertex_index) index: u32) -> Corner {
    let core = cores[index / 3u];
    let corner = index % 3u;
    // The equilateral triangle around that disc: (-sqrt(3), -1), (0, 2), (sqrt(3), -1).
    let place = vec2((f32(corner) - 1.0) * ROOT_3, select(-1f, 2f, corner == 1u));
    let at = core.center + vec2(core.width * place.x, 0.0) + core.slant * place.y;
    return Corner(vec4(at, core.depth, 1.0), place);
}

@fragment
fn splat_cast_fragment(corner: Corner) {
    if dot(corner.place, corner.place) > 1.0 {
        discard;
    }
}
