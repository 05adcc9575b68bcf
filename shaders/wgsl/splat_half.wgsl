// Layers of half the width and height: what their two shaders share. CPU twin: `stylegaussian::splat`, module
// `half`. A low pixel stands for two by two pixels of the whole layer.

/// The uniforms.
struct SplatHalf {
    /// Left, top, width and height of the whole viewport, in pixels of the target. That of the low layer starts
    /// at its corner.
    viewport: vec4<f32>,
    /// Depths that differ by much more than x d + y, at depth d, are those of two surfaces.
    limit: vec2<f32>,
    padding: vec2<f32>,
}

@group(0) @binding(0) var<uniform> whole: SplatHalf;

/// Depths from here on are no surface: nothing is before the near plane.
const NO_SURFACE: f32 = 1.0;

/// The corner of the whole viewport.
fn first_pixel() -> vec2<i32> {
    return vec2<i32>(whole.viewport.xy);
}

/// Width and height of the whole viewport.
fn whole_size() -> vec2<i32> {
    return vec2<i32>(whole.viewport.zw);
}

/// Corner 0, 1 or 2 of a triangle that covers the viewport: (-1, -1), (3, -1), (-1, 3).
fn covering(corner: u32) -> vec4<f32> {
    let at = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(at * 4.0 - 1.0, 0.0, 1.0);
}
