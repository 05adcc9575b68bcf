// The strokes of a splat, pixel by pixel. CPU twin: `stylegaussian::strokes::StrokeRecord`.

/// The uniforms of a draw with strokes.
struct StrokeDraw {
    /// Share of finer strokes that are added where a painting is magnified.
    near: f32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

@group(1) @binding(0) var<uniform> stroke_draw: StrokeDraw;
/// One for each record; all zero for a splat without strokes.
@group(1) @binding(1) var<storage, read> stroke_records: array<vec4<u32>>;
@group(1) @binding(2) var fine_detail: texture_2d_array<f32>;
@group(1) @binding(3) var wide_detail: texture_2d_array<f32>;
@group(1) @binding(4) var mirrored: sampler;

/// The affine map from a splat's pixels to a painting.
struct Strokes {
    /// Place at the splat's center, and its change for a pixel to the right and for one down. The painting is the unit square.
    place: vec2<f32>,
    step_x: vec2<f32>,
    step_y: vec2<f32>,
    /// Gains of fine and of wide detail.
    gains: vec2<f32>,
    layer: u32,
    /// Binary logarithm of the texels of fine detail to a pixel.
    level: f32,
}

/// Whether a record has gains.
fn has_strokes(record: vec4<u32>) -> bool {
    return (record.w & 0xffffu) != 0u;
}

fn unpacked_strokes(record: vec4<u32>) -> Strokes {
    let place = vec2<f32>(vec2(record.x & 0xffffu, record.x >> 16u)) / 65536.0;
    let look = unpack4x8unorm(record.w);
    return Strokes(
        place * (PERIOD / FINE_SIDE),
        unpack2x16float(record.y) / FINE_SIDE,
        unpack2x16float(record.z) / FINE_SIDE,
        look.xy * MAX_GAIN,
        (record.w >> 16u) & 0xffu,
        mix(LEAST_LEVEL, MOST_LEVEL, look.w),
    );
}

/// Fine detail of a place, with finer strokes where the painting is magnified.
fn fine_at(strokes: Strokes, at: vec2<f32>) -> vec3<f32> {
    let level = strokes.level;
    var fine = textureSampleLevel(fine_detail, mirrored, at, strokes.layer, max(level, 0.0)).rgb;
    var gain = stroke_draw.near;
    var k = 1.0;
    // An octave comes in from 0.4 octaves before its own distance to 0.2 after it.
    while k <= MOST_OCTAVES && -level - k + 0.6 > 0.0 {
        let share = min((-level - k + 0.6) / 0.8, 1.0);
        let finer = textureSampleLevel(fine_detail, mirrored, at * exp2(k), strokes.layer, max(level + k, 0.0)).rgb;
        fine += finer * (gain * share);
        gain *= stroke_draw.near;
        k += 1.0;
    }
    return fine;
}

/// The detail at `d` pixels from the splat's center.
fn stroke_detail(strokes: Strokes, d: vec2<f32>) -> vec3<f32> {
    let at = strokes.place + strokes.step_x * d.x + strokes.step_y * d.y;
    var sum = vec3(0.0);
    if strokes.gains.x > 0.0 {
        sum += strokes.gains.x * fine_at(strokes, at);
    }
    if strokes.gains.y > 0.0 {
        let level = max(strokes.level - WIDE_LEVEL, 0.0);
        sum += strokes.gains.y * textureSampleLevel(wide_detail, mirrored, at, strokes.layer, level).rgb;
    }
    return sum;
}
