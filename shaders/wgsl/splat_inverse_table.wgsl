// The inverse of a tone mapping curve: for every display color, the scene color that comes out nearest to it.
// One invocation per texel; runs once per curve.
//
// Least squares by Levenberg and Marquardt (Marquardt, "An Algorithm for Least-Squares Estimation of Nonlinear
// Parameters", 1963). Unknowns are the logarithms of the three channels, so that none becomes negative.
// Differences are taken in sRGB's encoding, which is about uniform to the eye. Bright saturated colors have no
// inverse, because curves desaturate bright colors. Least squares then gives up some brightness and some
// saturation, whereas a clamped formula turns yellow into white.

/// The table: x / (1 + x) of the linear scene color x, over display colors sin(pi t / 2)^2, encoded as sRGB,
/// for t from 0 to 1. That axis is dense at black and at white, because inverses are steep there.
@group(0) @binding(0) var inverse_table: texture_storage_3d<rgba16float, write>;
/// Bevy's table of the curve, if it has one.
@group(0) @binding(1) var curve_table: texture_3d<f32>;
@group(0) @binding(2) var table_sampler: sampler;

/// One of the `CURVE_` constants.
override curve: u32;

/// Logarithms (to base 2) of the darkest and the brightest scene color.
const DARKEST: f32 = -14.0;
const BRIGHTEST: f32 = 8.0;
/// Half the step of difference quotients, in stops. It averages over the kinks of curves.
const DIFFERENCE: f32 = 1.0 / 16.0;
/// The largest step, in stops.
const MAX_STEP: f32 = 4.0;
const MAX_ITERATIONS: u32 = 32u;
/// A squared error that is invisible: a hundredth of a step of 8 bits in each channel.
const GOOD: f32 = 3.0 * (0.01 / 255.0) * (0.01 / 255.0);

/// Weight of the part of a color that a screen clamps. It keeps the slope from vanishing outside of the range,
/// so that the search finds its way back.
const CLAMPED_AWAY: f32 = 0.1;

/// sRGB's encoding (IEC 61966-2-1), continued outside of 0..1.
fn encoded(c: vec3<f32>) -> vec3<f32> {
    let clamped = saturate(c);
    let inside =
        select(1.055 * pow(clamped, vec3(1.0 / 2.4)) - 0.055, clamped * 12.92, clamped <= vec3(0.0031308));
    return inside + CLAMPED_AWAY * (max(c - 1.0, vec3(0.0)) + 12.92 * min(c, vec3(0.0)));
}

fn decoded(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, c <= vec3(0.04045));
}

/// The display color of a scene color that is given by logarithms.
fn shown(stops: vec3<f32>) -> vec3<f32> {
    return encoded(tone_mapped(exp2(stops)));
}

fn in_range(stops: vec3<f32>) -> vec3<f32> {
    return clamp(stops, vec3(DARKEST), vec3(BRIGHTEST));
}

/// The derivative of `shown` along channel `unit`.
fn slope(stops: vec3<f32>, unit: vec3<f32>) -> vec3<f32> {
    let step = DIFFERENCE * unit;
    return (shown(stops + step) - shown(stops - step)) / (2.0 * DIFFERENCE);
}

/// The solution of m x = b for a symmetric positive matrix m, by Cramer's rule.
fn solved(m: mat3x3<f32>, b: vec3<f32>) -> vec3<f32> {
    let det = dot(m[0], cross(m[1], m[2]));
    let x = vec3(dot(b, cross(m[1], m[2])), dot(m[0], cross(b, m[2])), dot(m[0], cross(m[1], b)));
    return select(vec3(0.0), x / det, abs(det) > 1e-30);
}

/// The scene color, as logarithms, that comes out nearest to `goal`.
fn inverse(goal: vec3<f32>) -> vec3<f32> {
    let display = decoded(goal);
    // Start from the color itself or from the inverse of a simple curve, whichever comes out nearer.
    var other = display / (1.02 - display);
    if curve == CURVE_PBR_NEUTRAL {
        other = inverse_pbr_neutral(display);
    }
    var stops = in_range(log2(max(display, vec3(1e-5))));
    let other_stops = in_range(log2(max(other, vec3(1e-5))));
    if distance(goal, shown(other_stops)) < distance(goal, shown(stops)) {
        stops = other_stops;
    }
    var missing = goal - shown(stops);
    var error = dot(missing, missing);
    var damping = 0.01;
    for (var i = 0u; i < MAX_ITERATIONS && error > GOOD; i++) {
        let jacobian = mat3x3(
            slope(stops, vec3(1.0, 0.0, 0.0)),
            slope(stops, vec3(0.0, 1.0, 0.0)),
            slope(stops, vec3(0.0, 0.0, 1.0)),
        );
        var normal = transpose(jacobian) * jacobian;
        normal[0][0] += damping;
        normal[1][1] += damping;
        normal[2][2] += damping;
        let step = clamp(solved(normal, transpose(jacobian) * missing), vec3(-MAX_STEP), vec3(MAX_STEP));
        let next = in_range(stops + step);
        let still_missing = goal - shown(next);
        let next_error = dot(still_missing, still_missing);
        if next_error < error {
            stops = next;
            missing = still_missing;
            error = next_error;
            // Less damping comes closer to Gauss-Newton, which converges faster near the solution.
            damping = max(0.2 * damping, 1e-7);
        } else {
            // The step was too long: closer to gradient descent.
            damping *= 5.0;
        }
    }
    return stops;
}

@compute @workgroup_size(4, 4, 4)
fn splat_inverse_table(@builtin(global_invocation_id) texel: vec3<u32>) {
    let size = textureDimensions(inverse_table);
    if any(texel >= size) {
        return;
    }
    // The inverse of the axis of `splat_composite`, which looks colors up by asin(sqrt(color)).
    let root = sin(radians(90.0) * vec3<f32>(texel) / vec3<f32>(size - 1u));
    let color = exp2(inverse(root * root));
    textureStore(inverse_table, texel, vec4(color / (1.0 + color), 1.0));
}
