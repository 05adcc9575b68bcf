// Draws the sorted splats back to front, premultiplied over: one quad per splat. CPU twin: `stylegaussian::splat`,
// module `composite`.

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


struct Quad {
    @builtin(position) position: vec4<f32>,
    /// The geometry half of the record: center in pixels of the target, slope, row_precision.
    @location(0) @interpolate(flat) geometry: vec4<f32>,
    @location(1) @interpolate(flat) y_precision: f32,
    @location(2) @interpolate(flat) color: vec4<f32>,
}

@vertex
fn splat_draw_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) instance: u32) -> Quad {
    // Indices go front to back, blending goes back to front.
    let record = record_indices[counts.n_visible - 1u - instance];
    let geometry = geometry_halves[record];
    let splat = unpacked(geometry, color_halves[record]);

    // The footprint is the ellipse q <= cutoff. The two terms that q squares are coordinates in which it is a circle.
    // The square around that circle is a parallelogram in pixels, and no parallelogram around the ellipse has a
    // smaller area.
    let square = vec2(f32(corner & 1u), f32(corner >> 1u)) * 2.0 - 1.0;
    let reach = sqrt(cutoff(splat.opacity));
    let dy = square.y * reach * inverseSqrt(splat.y_precision);
    let dx = square.x * reach * inverseSqrt(splat.row_precision) + splat.slope * dy;
    let pixel = splat.center + vec2(dx, dy) - view.viewport.xy;
    let ndc = (pixel / view.viewport.zw * 2.0 - 1.0) * vec2(1.0, -1.0);
    return Quad(vec4(ndc, splat.depth, 1.0), geometry, splat.y_precision, vec4(splat.color, splat.opacity));
}

@fragment
fn splat_draw_fragment(quad: Quad) -> @location(0) vec4<f32> {
    let d = quad.position.xy - quad.geometry.xy;
    let du = d.x - quad.geometry.z * d.y;
    let q = quad.geometry.w * du * du + quad.y_precision * d.y * d.y;
    let alpha = min(MAX_ALPHA, quad.color.a * exp(-0.5 * q));
    // Corners of the parallelogram are outside of the ellipse.
    if alpha < MIN_ALPHA {
        discard;
    }
    return vec4(quad.color.rgb * alpha, alpha);
}
