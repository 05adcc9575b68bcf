// Light on the thickness of paint, pixel by pixel. CPU twin: `stylegaussian::strokes::StrokeRelief`.

/// How light falls on each record's paint, if `stroke_draw.n_lights` is 1.
@group(1) @binding(5) var<storage, read> relief_records: array<vec4<u32>>;

/// How light falls on the paint of a splat. Directions are in the painting's axes on the surface, x right and y
/// down, z out of it toward the eye.
struct Relief {
    /// Unit direction to the light.
    light: vec3<f32>,
    /// Unit direction midway between the light and the eye.
    half_way: vec3<f32>,
    /// Factor of the height.
    strength: f32,
    /// Texels in y to one in x.
    aspect: f32,
}

fn unpacked_relief(record: vec4<u32>) -> Relief {
    let z = unpack2x16snorm(record.y);
    let factors = unpack2x16float(record.w);
    return Relief(
        vec3(unpack2x16snorm(record.x), z.x),
        vec3(unpack2x16snorm(record.z), z.y),
        factors.x,
        factors.y,
    );
}

/// The luminance of fine detail.
fn height_at(strokes: Strokes, at: vec2<f32>, level: f32) -> f32 {
    return dot(textureSampleLevel(fine_detail, mirrored, at, strokes.layer, level).rgb, LUMINANCE);
}

/// The gradient of the height of fine detail at a place: differences over a texel of a blurrier level, from
/// three corners around the place.
fn gradient_at(strokes: Strokes, at: vec2<f32>, level_of_color: f32) -> vec2<f32> {
    let level = max(level_of_color, 0.0) + BLURRIER;
    let texel = exp2(level) / FINE_SIDE;
    let first = at - texel / 3.0;
    let here = height_at(strokes, first, level);
    let right = height_at(strokes, first + vec2(texel, 0.0), level);
    let below = height_at(strokes, first + vec2(0.0, texel), level);
    return THICKNESS * vec2(right - here, below - here) / exp2(level);
}

fn shine(cosine: f32) -> f32 {
    // The logarithm of 0 is not finite on every GPU.
    return pow(max(cosine, 1e-6), SHININESS);
}

/// The change of a color by light on paint with this gradient of its height: 0 if that is 0.
fn shade(relief: Relief, gradient: vec2<f32>, color: vec3<f32>) -> vec3<f32> {
    let steep = relief.strength * gradient * vec2(1.0, relief.aspect);
    let slope = steep * inverseSqrt(1.0 + dot(steep, steep) / (STEEPEST * STEEPEST));
    let normal = vec3(-slope, 1.0) * inverseSqrt(1.0 + dot(slope, slope));
    let diffuse = max(dot(normal, relief.light), 0.0) - max(relief.light.z, 0.0);
    let gloss = shine(dot(normal, relief.half_way)) - shine(relief.half_way.z);
    let in_light = clamp(relief.light.z / IN_LIGHT, 0.0, 1.0);
    let added = color * diffuse + GLOSS * in_light * gloss;
    return select(vec3(0.0), added, any(steep != vec2(0.0)));
}

/// The change of a splat's color by light at a place in the painting: on its own octave, or on one of those
/// that are stable on screen.
fn lit(strokes: Strokes, relief: Relief, at: vec2<f32>, octave: f32, color: vec3<f32>) -> vec3<f32> {
    let share = select(1.0, stable_share(strokes, octave), is_stable());
    let gradient = gradient_at(strokes, at * exp2(octave), strokes.level + octave);
    return shade(relief, share * strokes.gains.x * gradient, color);
}
