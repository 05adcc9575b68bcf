// Puts the layer of splats over the picture: a triangle over the whole viewport.

/// The uniforms of the composite.
struct SplatComposite {
    /// The camera's factor on colors before tone mapping: 2^exposure of its color grading.
    exposure: f32,
}

@group(0) @binding(0) var<uniform> composite: SplatComposite;
/// The result of `splat_inverse_table`.
@group(0) @binding(2) var inverse_table: texture_3d<f32>;
@group(0) @binding(3) var table_sampler: sampler;

/// One of the `MODE_` constants.
override mode: u32;

/// From sRGB's encoding to linear (IEC 61966-2-1).
fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, c <= vec3(0.04045));
}

/// The brightest scene color that an inverse gives, in c = x / (1 + x). Curves never reach 1, or only from
/// hundreds on: undone as it is, one white splat would give as much light to bloom as a lamp.
const BRIGHTEST: f32 = 8.0 / (1.0 + 8.0);
/// Where the way to it begins, so that whites keep their differences. Darker colors are undone exactly.
const KNEE: f32 = 0.8;

/// Colors 0..1 as colors 0..`BRIGHTEST`: equal up to the knee, then ever slower, without a kink.
fn dimmed(c: vec3<f32>) -> vec3<f32> {
    let above = max(c - KNEE, vec3(0.0));
    let bend = 1.0 / (BRIGHTEST - KNEE) - 1.0 / (1.0 - KNEE);
    return min(c, vec3(KNEE)) + above / (1.0 + bend * above);
}

/// The inverse of Reinhard's c = x / (1 + x).
fn inverse_reinhard(c: vec3<f32>) -> vec3<f32> {
    let limited = dimmed(c);
    return limited / (1.0 - limited);
}

/// The inverse of Reinhard on the luminance (Rec. 709). Hue and saturation stay.
fn inverse_reinhard_luminance(c: vec3<f32>) -> vec3<f32> {
    let luminance = dot(c, vec3(0.2126, 0.7152, 0.0722));
    let limited = dimmed(vec3(luminance)).x;
    return c * (limited / max(luminance, 1e-6)) / (1.0 - limited);
}

/// The inverse of a curve that has none for all colors.
fn inverse_by_table(encoded: vec3<f32>) -> vec3<f32> {
    // The table's axes: see `splat_inverse_table`. Texel centers lie half a texel from the edges.
    let along = asin(sqrt(encoded)) / radians(90.0);
    let size = f32(TABLE_SIZE);
    let at = (along * (size - 1.0) + 0.5) / size;
    return inverse_reinhard(textureSampleLevel(inverse_table, table_sampler, at, 0.0).rgb);
}

/// A texel of the layer in the target's space, premultiplied.
fn composited(texel: vec4<f32>) -> vec4<f32> {
    if texel.a <= 0.0 {
        discard;
    }
    if mode == MODE_ENCODED {
        return texel;
    }
    // sRGB's decoding is only defined for colors that a screen can show.
    let encoded = clamp(texel.rgb / texel.a, vec3(0.0), vec3(1.0));
    var color = linear_from_srgb(encoded);
    switch mode {
        case MODE_REINHARD: { color = inverse_reinhard(color); }
        case MODE_REINHARD_LUMINANCE: { color = inverse_reinhard_luminance(color); }
        case MODE_TABLE: { color = inverse_by_table(encoded); }
        default: {}
    }
    if mode != MODE_LINEAR {
        color /= composite.exposure;
    }
    return vec4(color * texel.a, texel.a);
}

/// Corner 0, 1 or 2 of a triangle that covers the viewport: (-1, -1), (3, -1), (-1, 3).
fn covering(corner: u32) -> vec4<f32> {
    let at = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(at * 4.0 - 1.0, 0.0, 1.0);
}
