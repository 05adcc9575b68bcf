// Draws the splats of one slice, front to back, into their moments of depth.

@group(1) @binding(0) var<uniform> iso: SplatIso;
@group(1) @binding(1) var<storage, read> iso_depths: array<f32>;

struct SliceQuad {
    @builtin(position) position: vec4<f32>,
    /// The geometry half of the record: center in pixels of the target, slope, row_precision.
    @location(0) @interpolate(flat) geometry: vec4<f32>,
    /// y_precision, opacity, and u.
    @location(1) @interpolate(flat) shape: vec3<f32>,
}

@vertex
fn splat_slices_draw_vertex(
    @builtin(vertex_index) corner: u32,
    @builtin(instance_index) instance: u32,
) -> SliceQuad {
    let first = iso.slice * slice_length(counts.n_visible);
    let rank = first + instance;
    if rank >= counts.n_visible {
        // A quad without area.
        return SliceQuad(vec4(0.0, 0.0, 0.0, 1.0), vec4(0.0), vec3(0.0));
    }
    let record = record_indices[rank];
    let geometry = geometry_halves[record];
    let splat = unpacked(geometry, color_halves[record]);
    let nearest = bitcast<f32>(color_halves[record_indices[first]].y);
    let u = log2(max(nearest, FARTHEST_DEPTH) / max(splat.depth, FARTHEST_DEPTH));
    return SliceQuad(corner_of(splat, corner), geometry, vec3(splat.y_precision, splat.opacity, u));
}

@fragment
fn splat_slices_draw_fragment(quad: SliceQuad) -> @location(0) vec4<f32> {
    // The moments have the size of the viewport, and their own corner.
    let pixel = vec2<u32>(quad.position.xy);
    let d = quad.position.xy + iso.viewport.xy - quad.geometry.xy;
    let alpha = alpha_at(d, quad.geometry, quad.shape.x, quad.shape.y);
    // Nothing behind the surface matters.
    if alpha < MIN_ALPHA || (iso.slice > 0u && iso_depths[place_of(pixel, iso)] > 0.0) {
        discard;
    }
    let u = quad.shape.z;
    return vec4(alpha * u, alpha * u * u, 0.0, alpha);
}
