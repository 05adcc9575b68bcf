// The least light of a picture that is to be tone-mapped, blended by the maximum. A tone mapping that divides
// by luminance makes no number of what is exactly black, and over that nothing can be blended any more.

/// The least number of 16 bits that no GPU rounds to 0. A screen shows it as a fifth of a step of 8 bits.
const LEAST_LIGHT: f32 = 6.1035156e-5;

@vertex
fn splat_lift_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    // (-1, -1), (3, -1), (-1, 3).
    let at = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(at * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn splat_lift_fragment() -> @location(0) vec4<f32> {
    return vec4(vec3(LEAST_LIGHT), 0.0);
}
