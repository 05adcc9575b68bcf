// Bevy's tone mapping curves without an exact inverse for all colors: linear scene color in, linear display
// color out (bevy_core_pipeline 0.19, tonemapping_shared.wgsl). Joined to kernels that declare `curve`, one of
// the `CURVE_` constants, and `curve_table` with `table_sampler`: Bevy's table of the curve, if it has one.

/// Luminance by Rec. 709.
fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3(0.2126, 0.7152, 0.0722));
}

/// Stephen Hill's fit of ACES, not yet clamped to 0..1.
fn aces_fitted(c: vec3<f32>) -> vec3<f32> {
    let v = vec3(
        dot(c, vec3(0.59719, 0.35458, 0.04823)),
        dot(c, vec3(0.07600, 0.90834, 0.01566)),
        dot(c, vec3(0.02840, 0.13383, 0.83777)),
    );
    let f = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
    return vec3(
        dot(f, vec3(1.60475, -0.53108, -0.07367)),
        dot(f, vec3(-0.10208, 1.10813, -0.00605)),
        dot(f, vec3(-0.00327, -0.07276, 1.07602)),
    );
}

/// The peak at which PBR Neutral's compression starts, and the rate of its desaturation.
const NEUTRAL_START: f32 = 0.8 - 0.04;
const NEUTRAL_DESATURATION: f32 = 0.15;

/// Khronos' PBR Neutral: a toe, then compression of the brightest channel towards 1 and desaturation.
fn pbr_neutral(c: vec3<f32>) -> vec3<f32> {
    let lowest = min(c.r, min(c.g, c.b));
    let above_toe = c - select(0.04, lowest - 6.25 * lowest * lowest, lowest < 0.08);
    let peak = max(above_toe.r, max(above_toe.g, above_toe.b));
    if peak < NEUTRAL_START {
        return above_toe;
    }
    let d = 1.0 - NEUTRAL_START;
    let new_peak = 1.0 - d * d / (peak + d - NEUTRAL_START);
    let gray = 1.0 - 1.0 / (NEUTRAL_DESATURATION * (peak - new_peak) + 1.0);
    return mix(above_toe * (new_peak / peak), vec3(new_peak), gray);
}

/// The inverse of PBR Neutral. It is exact for colors that the curve shows; others may get negative channels.
fn inverse_pbr_neutral(c: vec3<f32>) -> vec3<f32> {
    var above_toe = c;
    let peak = min(max(c.r, max(c.g, c.b)), 0.999);
    if peak >= NEUTRAL_START {
        let d = 1.0 - NEUTRAL_START;
        let old_peak = d * d / (1.0 - peak) - d + NEUTRAL_START;
        let gray = 1.0 - 1.0 / (NEUTRAL_DESATURATION * (old_peak - peak) + 1.0);
        above_toe = (c - peak * gray) / (1.0 - gray) * (old_peak / peak);
    }
    let lowest = max(min(above_toe.r, min(above_toe.g, above_toe.b)), 0.0);
    return above_toe + select(0.04, sqrt(lowest / 6.25) - lowest, lowest < 0.04);
}

/// Tomasz Stachowiak's "somewhat boring" transform.
fn somewhat_boring(c: vec3<f32>) -> vec3<f32> {
    let y = luminance(c);
    let chroma = vec2(dot(c, vec3(-0.1146, -0.3854, 0.5)), dot(c, vec3(0.5, -0.4542, -0.0458)));
    let bt = 1.0 - exp(-2.4 * length(chroma));
    let grayness = max((bt - 0.7) * 0.8, 0.0);
    let desaturated = mix(c, vec3(y), grayness * grayness);
    let by_luminance = c * ((1.0 - exp(-y)) / max(1e-5, y));
    let by_channel = 1.0 - exp(-desaturated);
    return 0.97 * mix(by_luminance, by_channel, bt * bt);
}

/// Bevy's table at `at`: 0 is the center of the first texel, 1 that of the last.
fn from_table(at: vec3<f32>) -> vec3<f32> {
    let size = f32(textureDimensions(curve_table).x);
    return textureSampleLevel(curve_table, table_sampler, (saturate(at) * (size - 1.0) + 0.5) / size, 0.0).rgb;
}

/// Coordinates in the tables of AgX and Filmic: stops from middle gray, from `lowest` to `highest` as 0 to 1.
fn normalized_stops(c: vec3<f32>, lowest: f32, highest: f32) -> vec3<f32> {
    let lifted = select(c, 0.00001525878 + c, c < vec3(0.00003051757));
    return (clamp(log2(lifted / 0.18), vec3(lowest), vec3(highest)) - lowest) / (highest - lowest);
}

fn agx(c: vec3<f32>) -> vec3<f32> {
    let inset = vec3(
        dot(c, vec3(0.84247906, 0.0784336, 0.07922375)),
        dot(c, vec3(0.04232824, 0.87846864, 0.07916613)),
        dot(c, vec3(0.04237565, 0.0784336, 0.87914297)),
    );
    return from_table(normalized_stops(inset, -10.0, 6.5));
}

fn tone_mapped(c: vec3<f32>) -> vec3<f32> {
    switch curve {
        case CURVE_ACES_FITTED: { return aces_fitted(c); }
        case CURVE_PBR_NEUTRAL: { return pbr_neutral(c); }
        case CURVE_SOMEWHAT_BORING: { return somewhat_boring(c); }
        case CURVE_AGX: { return agx(c); }
        case CURVE_TONY_MC_MAPFACE: { return from_table(c / (c + 1.0)); }
        case CURVE_BLENDER_FILMIC: { return from_table(normalized_stops(c, -11.0, 12.0)); }
        default: { return c; }
    }
}
