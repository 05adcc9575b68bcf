// Quads around splats: what the draws with and without strokes share.

/// The uniforms of the draw.
struct SplatDraw {
    /// Left, top, width and height of the viewport, in pixels of the target.
    viewport: vec4<f32>,
}

@group(0) @binding(0) var<uniform> view: SplatDraw;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
/// Record indices of the visible splats, front to back.
@group(0) @binding(2) var<storage, read> record_indices: array<u32>;
@group(0) @binding(3) var<storage, read> geometry_halves: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> color_halves: array<vec4<u32>>;

/// The record of a quad.
fn record_of(instance: u32) -> u32 {
    // Indices go front to back, blending goes back to front.
    return record_indices[counts.n_visible - 1u - instance];
}

/// A corner of the quad around `splat`, in clip space.
fn corner_of(splat: Splat, corner: u32) -> vec4<f32> {
    let square = vec2(f32(corner & 1u), f32(corner >> 1u)) * 2.0 - 1.0;
    // The two terms that q squares are coordinates in which the footprint is a disc. The square around that
    // disc is a parallelogram in pixels, and no parallelogram around the ellipse has a smaller area.
    let reach = sqrt(cutoff(splat.opacity));
    let dy = square.y * reach * inverseSqrt(splat.y_precision);
    let dx = square.x * reach * inverseSqrt(splat.row_precision) + splat.slope * dy;
    let pixel = splat.center + vec2(dx, dy) - view.viewport.xy;
    let ndc = (pixel / view.viewport.zw * 2.0 - 1.0) * vec2(1.0, -1.0);
    return vec4(ndc, splat.depth, 1.0);
}

/// The alpha of a splat at `d` pixels from its center. `geometry` is the geometry half of its record.
fn alpha_at(d: vec2<f32>, geometry: vec4<f32>, y_precision: f32, opacity: f32) -> f32 {
    let du = d.x - geometry.z * d.y;
    let q = geometry.w * du * du + y_precision * d.y * d.y;
    return min(MAX_ALPHA, opacity * exp(-0.5 * q));
}
