// Draws the sorted splats back to front, premultiplied over: one quad per splat. CPU twin:
// `stylegaussian::splat`, module `composite`.

struct Quad {
    @builtin(position) position: vec4<f32>,
    /// The geometry half of the record: center in pixels of the target, slope, row_precision.
    @location(0) @interpolate(flat) geometry: vec4<f32>,
    @location(1) @interpolate(flat) y_precision: f32,
    @location(2) @interpolate(flat) color: vec4<f32>,
}

@vertex
fn splat_draw_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) instance: u32) -> Quad {
    let record = record_of(instance);
    let geometry = geometry_halves[record];
    let splat = unpacked(geometry, color_halves[record]);
    return Quad(corner_of(splat, corner), geometry, splat.y_precision, vec4(splat.color, splat.opacity));
}

@fragment
fn splat_draw_fragment(quad: Quad) -> @location(0) vec4<f32> {
    let d = quad.position.xy - quad.geometry.xy;
    let alpha = alpha_at(d, quad.geometry, quad.y_precision, quad.color.a);
    // Corners of the parallelogram are outside of the ellipse.
    if alpha < MIN_ALPHA {
        discard;
    }
    return vec4(quad.color.rgb * alpha, alpha);
}
