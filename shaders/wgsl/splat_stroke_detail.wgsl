// The strokes of a splat, pixel by pixel. CPU twin: `stylegaussian::strokes::StrokeRecord`.

/// The uniforms of a draw with strokes.
struct StrokeDraw {
    /// Share of finer strokes that are added where a painting is magnified.
    near: f32,
    /// 1 if there is relief, else 0.
    n_lights: u32,
    /// 1 if strokes keep their size on screen, else 0.
    is_stable: u32,
    /// Binary logarithm of their size.
    scale_octaves: f32,
}

@group(1) @binding(0) var<uniform> stroke_draw: StrokeDraw;
/// One for each record; all zero for a splat without strokes.
@group(1) @binding(1) var<storage, read> stroke_records: array<vec4<u32>>;
@group(1) @binding(2) var fine_detail: texture_2d_array<f32>;
@group(1) @binding(3) var wide_detail: texture_2d_array<f32>;
@group(1) @binding(4) var mirrored: sampler;

/// A number of the uniforms that branches depend on, as for `flags` of `splat_footprint`.
fn hidden(number: u32) -> u32 {
    return select(number, 0u, arrayLength(&stroke_records) == 0u);
}

/// Whether strokes keep their size on screen.
fn is_stable() -> bool {
    return hidden(stroke_draw.is_stable) > 0u;
}

/// The affine map from a splat's pixels to a painting.
struct Strokes {
    /// Place at the splat's center, and its change for a pixel to the right and for one down. The painting is
    /// the unit square.
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

/// The place in the painting at `d` pixels from the splat's center.
fn place_at(strokes: Strokes, d: vec2<f32>) -> vec2<f32> {
    return strokes.place + strokes.step_x * d.x + strokes.step_y * d.y;
}

/// Octaves that a splat shows beside the first: finer strokes from 0.4 octaves before their own distance on, or
/// those that are stable on screen.
fn n_octaves_of(strokes: Strokes) -> f32 {
    let n = clamp(ceil(0.6 - strokes.level) - 1.0, 0.0, MOST_OCTAVES);
    let n_finer = select(0.0, n, strokes.gains.x > 0.0 && stroke_draw.near > 0.0);
    return select(n_finer, STABLE_OCTAVES - 1.0, is_stable());
}

/// The share of an octave of strokes that are stable on screen: see `stylegaussian::strokes::stable_shares`.
fn stable_share(strokes: Strokes, octave: f32) -> f32 {
    let part = clamp(-1.0 - strokes.level - stroke_draw.scale_octaves, 0.0, 1.0);
    let rest = 1.0 - part;
    let shares = vec3(0.5 * rest * rest, 0.5 + part * rest, 0.5 * part * part);
    return shares[u32(octave)] * inverseSqrt(dot(shares, shares));
}

/// Fine detail in the painting's own size (octave 0) or finer, with its share.
fn fine_octave(strokes: Strokes, at: vec2<f32>, octave: f32) -> vec3<f32> {
    let level = max(strokes.level + octave, 0.0);
    let detail = textureSampleLevel(fine_detail, mirrored, at * exp2(octave), strokes.layer, level).rgb;
    // All of an octave is there from 0.2 octaves after its own distance on.
    var share = 1.0;
    if octave > 0.0 {
        share = clamp((0.6 - strokes.level - octave) / 0.8, 0.0, 1.0) * pow(stroke_draw.near, octave);
    }
    if is_stable() {
        share = stable_share(strokes, octave);
    }
    return share * detail;
}

/// Wide detail, which comes with the first octave, or with each of those that are stable on screen.
fn wide_octave(strokes: Strokes, at: vec2<f32>, octave: f32) -> vec3<f32> {
    var share = select(0.0, 1.0, octave == 0.0);
    var place = at;
    var level = strokes.level - WIDE_LEVEL;
    if is_stable() {
        share = stable_share(strokes, octave);
        place = at * exp2(octave);
        level += octave;
    }
    return share * textureSampleLevel(wide_detail, mirrored, place, strokes.layer, max(level, 0.0)).rgb;
}
