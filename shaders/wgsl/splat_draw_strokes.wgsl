// Draws the sorted splats like `splat_draw`, with strokes over their colors. CPU twin:
// `stylegaussian::splat::render_strokes`.

struct Quad {
    @builtin(position) position: vec4<f32>,
    /// The geometry half of the record: center in pixels of the target, slope, row_precision.
    @location(0) @interpolate(flat) geometry: vec4<f32>,
    @location(1) @interpolate(flat) y_precision: f32,
    @location(2) @interpolate(flat) color: vec4<f32>,
    /// The strokes as they are stored: unpacked, they would take two more locations.
    @location(3) @interpolate(flat) strokes: vec4<u32>,
    /// And the light on them.
    @location(4) @interpolate(flat) relief: vec4<u32>,
}

@vertex
fn splat_draw_strokes_vertex(
    @builtin(vertex_index) corner: u32,
    @builtin(instance_index) instance: u32,
) -> Quad {
    let record = record_of(instance);
    let geometry = geometry_halves[record];
    let splat = unpacked(geometry, color_halves[record]);
    let color = vec4(splat.color, splat.opacity);
    var relief = vec4(0u);
    if hidden(stroke_draw.n_lights) > 0u {
        relief = relief_records[record];
    }
    return Quad(corner_of(splat, corner), geometry, splat.y_precision, color, stroke_records[record], relief);
}

/// The detail at `d` pixels from the splat's center.
fn stroke_detail(strokes: Strokes, d: vec2<f32>) -> vec3<f32> {
    let at = place_at(strokes, d);
    var sum = vec3(0.0);
    if is_stable() {
        for (var octave = 0.0; octave < STABLE_OCTAVES; octave += 1.0) {
            sum += strokes.gains.x * fine_octave(strokes, at, octave);
            sum += strokes.gains.y * wide_octave(strokes, at, octave);
        }
        return sum;
    }
    if strokes.gains.x > 0.0 {
        var fine = fine_octave(strokes, at, 0.0);
        let n_octaves = n_octaves_of(strokes);
        for (var octave = 1.0; octave <= n_octaves; octave += 1.0) {
            fine += fine_octave(strokes, at, octave);
        }
        sum += strokes.gains.x * fine;
    }
    if strokes.gains.y > 0.0 {
        sum += strokes.gains.y * wide_octave(strokes, at, 0.0);
    }
    return sum;
}

@fragment
fn splat_draw_strokes_fragment(quad: Quad) -> @location(0) vec4<f32> {
    let d = quad.position.xy - quad.geometry.xy;
    let alpha = alpha_at(d, quad.geometry, quad.y_precision, quad.color.a);
    // Corners of the parallelogram are outside of the ellipse.
    if alpha < MIN_ALPHA {
        discard;
    }
    var rgb = quad.color.rgb;
    if alpha >= LEAST_ALPHA && has_strokes(quad.strokes) {
        let strokes = unpacked_strokes(quad.strokes);
        rgb += stroke_detail(strokes, d);
        if hidden(stroke_draw.n_lights) > 0u {
            let relief = unpacked_relief(quad.relief);
            let n_octaves = select(1.0, STABLE_OCTAVES, is_stable());
            for (var octave = 0.0; octave < n_octaves; octave += 1.0) {
                rgb += lit(strokes, relief, place_at(strokes, d), octave, quad.color.rgb);
            }
        }
    }
    return vec4(rgb * alpha, alpha);
}
